//! The sampling pattern of pictures, and functions that build short arrays in registers.

/// The number of samples along each side of a pixel.
pub(crate) const SAMPLES: usize = 3;

/// The number of pixel rows in a band. With a usual picture width, the samples of a band fit into the cache of a processor core.
pub(crate) const BAND: usize = 8;

/// Builds an array of three items one by one. The compiler keeps these items in registers, unlike those of `array::map`.
#[inline(always)]
pub(crate) fn array3<T>(make: impl Fn(usize) -> T) -> [T; 3] {
    [make(0), make(1), make(2)]
}

/// Builds an array of four items, which is the number that one vector instruction processes. If only three items are needed, the last is 0.
#[inline(always)]
pub(crate) fn array4<T>(make: impl Fn(usize) -> T) -> [T; 4] {
    [make(0), make(1), make(2), make(3)]
}

/// Appends a zero to an array of three numbers.
#[inline(always)]
pub(crate) fn pad<T: Copy + Default>([a, b, c]: [T; 3]) -> [T; 4] {
    [a, b, c, T::default()]
}
