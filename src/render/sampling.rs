//! How a picture is sampled, and short arrays that the compiler keeps in registers.

/// Samples along each side of a pixel.
pub(crate) const SAMPLES: usize = 3;

/// Rows of pixels in a band: few enough that a band's samples fit in a core's cache at usual widths.
pub(crate) const BAND: usize = 8;

/// Three things, made one by one: the compiler keeps them in registers, which it does not for those of `array::map`.
#[inline(always)]
pub(crate) fn each<T>(make: impl Fn(usize) -> T) -> [T; 3] {
    [make(0), make(1), make(2)]
}

/// Four things: as many numbers as one instruction computes. The last is 0 where only three are meant.
#[inline(always)]
pub(crate) fn four<T>(make: impl Fn(usize) -> T) -> [T; 4] {
    [make(0), make(1), make(2), make(3)]
}

/// Three numbers and a zero.
#[inline(always)]
pub(crate) fn padded<T: Copy + Default>([a, b, c]: [T; 3]) -> [T; 4] {
    [a, b, c, T::default()]
}
