//! Vector instructions: numerical kernels that are compiled for several vector widths, and functions for their loops.
//!
//! The program runs on every x86-64 machine, and the vectors that all of them have hold two `f64`. A [`Kernel`] is also compiled for
//! vectors of four and of eight `f64`; the version is chosen at run time. The bits of a result must not depend on the version, and fusing a
//! multiplication with an addition changes the bits. So these operations are fused in all versions of a [`FusedKernel`], and in no version
//! of any other kernel.
//!
//! A fused multiplication and addition is rounded only once, and has the same bits on every machine. Results would differ only if a
//! compiler or library fused operations on some machines but not on others. Free-form deformation consists mainly of multiplications and
//! additions; fusing reduces its time to two thirds. Processors without an instruction for fusing (x86-64 before 2013, some cheap later
//! ones) compute it with integers, which is slow, so a lint forbids `mul_add` in all other code. The function of the C library would be ten
//! times as slow as the integer version.

#![allow(
    unsafe_code,
    reason = "calling code for a detected feature is unsafe; each use has its proof"
)]

use std::marker::PhantomData;

/// A loop over plain numbers. `run` and all functions that the loop calls must be marked `#[inline(always)]`; otherwise they are not
/// compiled for wide vectors.
pub trait Kernel {
    /// Runs the loop over the kernel's numbers.
    fn run(self);
}

/// Runs a kernel with the widest vectors of the present machine.
pub fn widest(kernel: impl Kernel) {
    if let Some(kernel) = wide(kernel) {
        kernel.run();
    }
}

/// A kernel whose multiplications and additions are fused.
pub trait FusedKernel {
    /// Runs the loop. The rules of [`Kernel`] apply.
    fn run<F: MulAdd>(self);
}

/// Runs a fused kernel as [`widest`] does.
pub fn widest_fused(kernel: impl FusedKernel) {
    if let Some(WithMulAdd(kernel, _)) = wide(WithMulAdd(kernel, PhantomData::<Instruction>)) {
        if cfg!(target_arch = "aarch64") {
            kernel.run::<Instruction>();
        } else {
            kernel.run::<Software>();
        }
    }
}

/// A fused kernel, together with the implementation of [`MulAdd`] that it uses.
struct WithMulAdd<K, F>(K, PhantomData<F>);

impl<K: FusedKernel, F: MulAdd> Kernel for WithMulAdd<K, F> {
    #[inline(always)]
    fn run(self) {
        self.0.run::<F>();
    }
}

/// An implementation of `a * b + c` with a single rounding. The correctly rounded result is unique, so all implementations give the same
/// bits.
pub trait MulAdd {
    /// Returns `a * b + c`, rounded once.
    fn mul_add(a: f64, b: f64, c: f64) -> f64;
}

/// Uses the processor's fused multiply-add instruction. Every aarch64 has it, and with few exceptions every x86-64 since 2013.
#[derive(Clone, Copy, Debug)]
pub struct Instruction;

impl MulAdd for Instruction {
    #[expect(clippy::disallowed_methods, reason = "only run where there is the instruction")]
    #[inline(always)]
    fn mul_add(a: f64, b: f64, c: f64) -> f64 {
        a.mul_add(b, c)
    }
}

/// A software implementation with integers, which takes about 10 ns per call.
#[derive(Clone, Copy, Debug)]
pub struct Software;

impl MulAdd for Software {
    fn mul_add(a: f64, b: f64, c: f64) -> f64 {
        libm::fma(a, b, c)
    }
}

/// Runs a kernel with wide vectors, or returns the kernel if the machine has no wide vectors.
fn wide<K: Kernel>(kernel: K) -> Option<K> {
    #[cfg(target_arch = "x86_64")]
    {
        if is_x86_feature_detected!("avx512f") && is_x86_feature_detected!("avx512vl") {
            // SAFETY: the features were detected above.
            unsafe { with_avx512(kernel) };
            return None;
        }
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
            // SAFETY: the features were detected above.
            unsafe { with_avx2(kernel) };
            return None;
        }
    }
    Some(kernel)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn with_avx2(kernel: impl Kernel) {
    kernel.run();
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512vl")]
fn with_avx512(kernel: impl Kernel) {
    kernel.run();
}

/// An array of numbers for the loop of a kernel, aligned to the processor's cache lines.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
pub struct Lanes<const N: usize>(pub [f64; N]);

impl<const N: usize> Lanes<N> {
    /// An array of zeros.
    pub const ZERO: Self = Self([0.0; N]);
}

/// If this constant is added to a small number, the lowest bits of the sum are the nearest integer plus 1023.
const ROUND: f64 = (3_u64 << 51) as f64 + 1023.0;

/// The coefficients of the polynomial that interpolates `2^x` at the 12 Chebyshev points of -1/2 to 1/2. The error is at most 2e-17,
/// including the rounding of the coefficients, which were computed with 60 digits.
const POWERS: [f64; 12] = [
    1.0,
    std::f64::consts::LN_2,
    0.24022650695910158,
    0.055504108664821625,
    0.009618129107587256,
    0.001333355814640647,
    0.00015403530463724353,
    1.5252733841556773e-05,
    1.3215432535912375e-06,
    1.0178057087733941e-07,
    7.074194297288521e-09,
    4.4558179083360645e-10,
];

/// `2^x` for `x` below 1023.5, for the loop of a [`Kernel`]. There is no branch and no table, and the bits are the same on every machine.
///
/// The error is at most 2 units in the last place, and 0 for integers. Below -1022, where subnormal numbers lose digits, the result stays
/// at `2^-1022`, about 2e-308. From 1023.5 on the result is wrong. NaN stays NaN.
#[inline(always)]
pub fn exp2<F: MulAdd>(x: f64) -> f64 {
    exp2_of_normal::<F>(if x < MIN_EXPONENT { MIN_EXPONENT } else { x })
}

/// The minimum exponent for which the power of 2 is a normal number.
pub const MIN_EXPONENT: f64 = -1022.0;

/// [`exp2`] for `x` of at least [`MIN_EXPONENT`]; for smaller `x` the result is wrong. The function saves one operation where `x` is known
/// to be in range.
///
/// The integer closest to `x` becomes the bits of the exponent, and a polynomial gives the remaining factor. The terms of the polynomial
/// are combined by twos and fours (G. Estrin, "Organization of computer systems", 1960). The chain of dependent operations is then half as
/// long as in Horner's scheme, and processors can only keep a limited number of chains in flight.
#[inline(always)]
pub fn exp2_of_normal<F: MulAdd>(x: f64) -> f64 {
    let (rest, power_of_integer) = split(x);
    let sq = rest * rest;
    let fourth = sq * sq;
    #[inline(always)]
    fn linear<F: MulAdd>(first: usize, rest: f64) -> f64 {
        F::mul_add(POWERS[first + 1], rest, POWERS[first])
    }
    #[inline(always)]
    fn cubic<F: MulAdd>(first: usize, rest: f64, sq: f64) -> f64 {
        F::mul_add(linear::<F>(first + 2, rest), sq, linear::<F>(first, rest))
    }
    F::mul_add(
        F::mul_add(cubic::<F>(8, rest, sq), fourth, cubic::<F>(4, rest, sq)),
        fourth,
        cubic::<F>(0, rest, sq),
    ) * power_of_integer
}

/// The coefficients of the polynomial that interpolates `2^x` at the 7 Chebyshev points of -1/2 to 1/2. The error is at most 2.54e-9.
const ROUGH_POWERS: [f64; 7] = [
    1.0,
    0.6931472067028326,
    0.24022650922288757,
    0.05550327226670302,
    0.009618056678524637,
    0.0013400428177615838,
    0.0001546144469856913,
];

/// The maximum relative error of [`exp2_roughly`].
pub const MAX_ROUGH_ERROR: f64 = 2.6e-9;

/// [`exp2`] with a relative error of at most [`MAX_ROUGH_ERROR`], in three quarters of the time. Meant for sums that are not exact anyway.
#[inline(always)]
pub fn exp2_roughly<F: MulAdd>(x: f64) -> f64 {
    let (rest, power_of_integer) = split(if x < MIN_EXPONENT { MIN_EXPONENT } else { x });
    let sq = rest * rest;
    #[inline(always)]
    fn linear<F: MulAdd>(first: usize, rest: f64) -> f64 {
        F::mul_add(ROUGH_POWERS[first + 1], rest, ROUGH_POWERS[first])
    }
    let four = F::mul_add(linear::<F>(2, rest), sq, linear::<F>(0, rest));
    F::mul_add(F::mul_add(ROUGH_POWERS[6], sq, linear::<F>(4, rest)), sq * sq, four)
        * power_of_integer
}

/// Splits `x` into the nearest integer and the difference from it. Returns the difference, and 2 to the power of that integer.
#[inline(always)]
fn split(x: f64) -> (f64, f64) {
    let rounded = x + ROUND;
    (x - (rounded - ROUND), f64::from_bits(rounded.to_bits() << 52))
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Cubes<'a>(&'a mut [f64]);

    impl Kernel for Cubes<'_> {
        #[inline(always)]
        fn run(self) {
            self.0.iter_mut().for_each(|x| *x = *x * *x * *x + 0.1);
        }
    }

    struct Powers<'a>(&'a mut [f64]);

    impl FusedKernel for Powers<'_> {
        #[inline(always)]
        fn run<F: MulAdd>(self) {
            self.0.iter_mut().for_each(|x| *x = exp2::<F>(*x));
        }
    }

    fn same_bits(numbers: Vec<f64>, run: impl Fn(&mut [f64]), on_all: impl Fn(&mut [f64])) {
        let (mut wide, mut plain) = (numbers.clone(), numbers);
        on_all(&mut wide);
        run(&mut plain);
        assert!(wide.iter().zip(&plain).all(|(a, b)| a.to_bits() == b.to_bits()));
    }

    #[test]
    fn wide_vectors_give_the_same_bits() {
        let numbers: Vec<f64> = (0..103).map(|k| libm::sin(f64::from(k)) * 1e3).collect();
        same_bits(numbers.clone(), |x| Cubes(x).run(), |x| widest(Cubes(x)));
        same_bits(numbers.clone(), |x| Powers(x).run::<Software>(), |x| widest_fused(Powers(x)));
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
            // SAFETY: the features were detected above.
            let by_instruction = |x: &mut [f64]| unsafe {
                with_avx2(WithMulAdd(Powers(x), PhantomData::<Instruction>));
            };
            same_bits(numbers, |x| Powers(x).run::<Software>(), by_instruction);
        }
    }

    #[test]
    fn powers_of_two_are_off_by_two_units_at_most() {
        // The tested numbers are multiples of an irrational step from the minimum to the maximum exponent, and of a finer step around 0.
        let far =
            (0..1_000_000).map(|k| -1022.0 + 2045.0 * (f64::from(k) * 0.618_033_988_75).fract());
        let near = (0..200_000).map(|k| f64::from(k) * 1e-5 - 1.0);
        let mut worst = 0.0_f64;
        for x in far.chain(near) {
            let exact = libm::exp2(x);
            let unit = f64::from_bits(exact.to_bits() + 1) - exact;
            worst = worst.max((exp2::<Software>(x) - exact).abs() / unit);
        }
        assert!(worst <= 2.0, "{worst} units in the last place");
    }

    #[test]
    fn rough_powers_have_the_documented_error() {
        let worst = (0..1_000_000)
            .map(|k| f64::from(k) * 2e-3 - 1000.0)
            .map(|x: f64| (exp2_roughly::<Software>(x) / libm::exp2(x) - 1.0).abs());
        let worst = worst.fold(0.0, f64::max);
        assert!(worst <= MAX_ROUGH_ERROR, "{worst}");
        assert!(worst > MAX_ROUGH_ERROR / 2.0, "{worst} is much less than {MAX_ROUGH_ERROR}");
        assert_eq!(exp2_roughly::<Software>(-1e300), f64::MIN_POSITIVE);
        assert!(exp2_roughly::<Software>(f64::NAN).is_nan());
    }

    #[test]
    fn powers_with_whole_exponents_are_exact_and_the_ends_are_safe() {
        assert!((-1022..=1023).all(|k| exp2::<Software>(f64::from(k)) == libm::scalbn(1.0, k)));
        for x in [-1022.5, -1e5, -1e300, f64::NEG_INFINITY] {
            assert_eq!(exp2::<Software>(x), f64::MIN_POSITIVE);
        }
        assert!(exp2::<Software>(f64::NAN).is_nan());
    }
}
