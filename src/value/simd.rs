//! Wide vectors where the machine has them, and what loops on them need.
//!
//! The program is built for every x86-64, whose vectors hold two `f64`. A [`Kernel`] is compiled again for four and for eight;
//! which of them runs is decided when it is called. None fuses multiplications and additions unless all do, as a
//! [`FusedKernel`] says, so that the bits are the same.
//!
//! A product and a sum that are rounded once are equal on every machine. Bytes change only if a compiler or library fuses where it can.
//! Free-form deformation consists mainly of such pairs, and fused it takes two thirds of the time. Processors without the instruction
//! (x86-64 before 2013, some cheap ones later) compute it with whole numbers, which is slow, so the lint forbids `mul_add` elsewhere. The
//! function of the C library would be ten times as slow there.

#![allow(
    unsafe_code,
    reason = "calling code for a detected feature is unsafe; each use has its proof"
)]

use std::marker::PhantomData;

/// A loop over plain numbers. `run`, and whatever it calls in the loop, must be marked `#[inline(always)]`, or it stays as it
/// is.
pub trait Kernel {
    /// Does the work.
    fn run(self);
}

/// Runs a kernel with the widest vectors that this machine has.
pub fn widest(kernel: impl Kernel) {
    if let Some(kernel) = wide(kernel) {
        kernel.run();
    }
}

/// A kernel that rounds sums of products once.
pub trait FusedKernel {
    /// Does the work; as for [`Kernel::run`].
    fn run<F: Fused>(self);
}

/// Runs a kernel as [`widest`] does.
pub fn widest_fused(kernel: impl FusedKernel) {
    if let Some(By(kernel, _)) = wide(By(kernel, PhantomData::<Instruction>)) {
        if cfg!(target_arch = "aarch64") {
            kernel.run::<Instruction>();
        } else {
            kernel.run::<Software>();
        }
    }
}

/// A kernel with its way to fuse.
struct By<K, F>(K, PhantomData<F>);

impl<K: FusedKernel, F: Fused> Kernel for By<K, F> {
    #[inline(always)]
    fn run(self) {
        self.0.run::<F>();
    }
}

/// A way to compute `a * b + c`, rounded once. No number is nearer than that, so all ways give the same bits.
pub trait Fused {
    /// `a * b + c`.
    fn fused(a: f64, b: f64, c: f64) -> f64;
}

/// One instruction, which each aarch64 has and each x86-64 since 2013, with few exceptions.
#[derive(Clone, Copy, Debug)]
pub struct Instruction;

impl Fused for Instruction {
    #[expect(clippy::disallowed_methods, reason = "only run where there is the instruction")]
    #[inline(always)]
    fn fused(a: f64, b: f64, c: f64) -> f64 {
        a.mul_add(b, c)
    }
}

/// A function of whole numbers, some 10 ns.
#[derive(Clone, Copy, Debug)]
pub struct Software;

impl Fused for Software {
    fn fused(a: f64, b: f64, c: f64) -> f64 {
        libm::fma(a, b, c)
    }
}

/// Runs a kernel with wide vectors, or gives it back where there are none.
fn wide<K: Kernel>(kernel: K) -> Option<K> {
    #[cfg(target_arch = "x86_64")]
    {
        if is_x86_feature_detected!("avx512f") && is_x86_feature_detected!("avx512vl") {
            // SAFETY: the features were found just now.
            unsafe { with_avx512(kernel) };
            return None;
        }
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
            // SAFETY: the features were found just now.
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

/// Numbers for a loop of a kernel, where they cross no line of the processor's cache.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
pub struct Lanes<const N: usize>(pub [f64; N]);

impl<const N: usize> Lanes<N> {
    /// Zeros.
    pub const ZERO: Self = Self([0.0; N]);
}

/// Added to a number of small size it leaves the nearest integer, plus 1023, in the sum's lowest bits.
const ROUND: f64 = (3_u64 << 51) as f64 + 1023.0;

/// The polynomial that meets `2^x` at the 12 Chebyshev points of -1/2 to 1/2: off by 2e-17 at most, rounding of these numbers
/// included. Computed with 60 digits for this file.
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

/// `2^x` for `x` below 1023.5, for loops of a [`Kernel`]: no branch, no table, and the same bits on every machine.
///
/// Off by 2 units in the last place at most, and exact for integers. Below -1022, where the numbers lose digits, it stays at
/// `2^-1022`, some 2e-308; from 1023.5 on it is wrong. NaN stays NaN.
#[inline(always)]
pub fn exp2<F: Fused>(x: f64) -> f64 {
    exp2_of_normal::<F>(if x < LEAST { LEAST } else { x })
}

/// The least exponent of 2 whose power has all its digits.
pub const LEAST: f64 = -1022.0;

/// [`exp2`] for `x` of [`LEAST`] at least, and wrong below: one operation less, where it is known that none is.
///
/// The integer next to `x` becomes the exponent's bits, a polynomial does the rest. Its powers are taken together by twos and
/// fours (G. Estrin, "Organization of computer systems", 1960): the chain of operations that wait for each other has half the
/// length of Horner's, and chains are what a processor has too few places for.
#[inline(always)]
pub fn exp2_of_normal<F: Fused>(x: f64) -> f64 {
    let (rest, power_of_integer) = split(x);
    let sq = rest * rest;
    let fourth = sq * sq;
    #[inline(always)]
    fn two<F: Fused>(first: usize, rest: f64) -> f64 {
        F::fused(POWERS[first + 1], rest, POWERS[first])
    }
    #[inline(always)]
    fn four<F: Fused>(first: usize, rest: f64, sq: f64) -> f64 {
        F::fused(two::<F>(first + 2, rest), sq, two::<F>(first, rest))
    }
    F::fused(
        F::fused(four::<F>(8, rest, sq), fourth, four::<F>(4, rest, sq)),
        fourth,
        four::<F>(0, rest, sq),
    ) * power_of_integer
}

/// The polynomial that meets `2^x` at the 7 Chebyshev points of -1/2 to 1/2: off by 2.54e-9 at most.
const ROUGH_POWERS: [f64; 7] = [
    1.0,
    0.6931472067028326,
    0.24022650922288757,
    0.05550327226670302,
    0.009618056678524637,
    0.0013400428177615838,
    0.0001546144469856913,
];

/// How much of itself a power of [`exp2_roughly`] is off by at most.
pub const ROUGHLY: f64 = 2.6e-9;

/// [`exp2`], off by [`ROUGHLY`] of itself, in three quarters of the time: for sums that are not exact anyhow.
#[inline(always)]
pub fn exp2_roughly<F: Fused>(x: f64) -> f64 {
    let (rest, power_of_integer) = split(if x < LEAST { LEAST } else { x });
    let sq = rest * rest;
    #[inline(always)]
    fn two<F: Fused>(first: usize, rest: f64) -> f64 {
        F::fused(ROUGH_POWERS[first + 1], rest, ROUGH_POWERS[first])
    }
    let four = F::fused(two::<F>(2, rest), sq, two::<F>(0, rest));
    F::fused(F::fused(ROUGH_POWERS[6], sq, two::<F>(4, rest)), sq * sq, four) * power_of_integer
}

/// The difference of `x` from the nearest integer, and 2 to the power of that integer.
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
        fn run<F: Fused>(self) {
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
            // SAFETY: the features were found just now.
            let by_instruction =
                |x: &mut [f64]| unsafe { with_avx2(By(Powers(x), PhantomData::<Instruction>)) };
            same_bits(numbers, |x| Powers(x).run::<Software>(), by_instruction);
        }
    }

    #[test]
    fn powers_of_two_are_off_by_two_units_at_most() {
        // Steps of an irrational size, from the least to the greatest number, and finer ones around 0.
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
    fn rough_powers_are_off_by_what_they_say() {
        let worst = (0..1_000_000)
            .map(|k| f64::from(k) * 2e-3 - 1000.0)
            .map(|x: f64| (exp2_roughly::<Software>(x) / libm::exp2(x) - 1.0).abs());
        let worst = worst.fold(0.0, f64::max);
        assert!(worst <= ROUGHLY, "{worst}");
        assert!(worst > ROUGHLY / 2.0, "{worst} is much less than {ROUGHLY}");
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
