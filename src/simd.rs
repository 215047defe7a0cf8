//! Wide vectors where the machine has them.
//!
//! The program is built for every x86-64, whose vectors hold two `f64`. A [`Kernel`] is compiled a second time for four; which
//! of the two runs is decided when it is called. Neither fuses multiplications and additions, so that the bits are the same.

#![allow(
    unsafe_code,
    reason = "calling code for a detected feature is unsafe; each use has its proof"
)]

/// A loop over plain numbers. `run`, and whatever it calls in the loop, must be marked `#[inline(always)]`, or it stays as it is.
pub(crate) trait Kernel {
    /// Does the work.
    fn run(self);
}

/// Runs a kernel with the widest vectors that this machine has.
pub(crate) fn widest(kernel: impl Kernel) {
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx2") {
        // SAFETY: the feature was found just now.
        return unsafe { with_avx2(kernel) };
    }
    kernel.run();
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn with_avx2(kernel: impl Kernel) {
    kernel.run();
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

    #[test]
    fn wide_vectors_give_the_same_bits() {
        let numbers: Vec<f64> = (0..103).map(|k| libm::sin(f64::from(k)) * 1e3).collect();
        let (mut wide, mut plain) = (numbers.clone(), numbers);
        widest(Cubes(&mut wide));
        Cubes(&mut plain).run();
        assert!(wide.iter().zip(&plain).all(|(a, b)| a.to_bits() == b.to_bits()));
    }
}
