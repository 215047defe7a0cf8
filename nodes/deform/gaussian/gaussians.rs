//! Rational Gaussian functions, which give the weights of handles at a point.
//!
//! ```text
//! G_i(x) = exp(-(x - x_i)^2 / (2 sx_i^2) - (y - y_i)^2 / (2 sy_i^2) - (z - z_i)^2 / (2 sz_i^2))
//! g_i(x) = w_i G_i(x) / (b + sum_j w_j G_j(x))
//! ```
//!
//! `x_i` is the center of Gaussian i, `sx_i`, `sy_i` and `sz_i` are its deviations, `w_i` is its weight, and `b` is the background.
//! Goshtasby, "Geometric modelling using rational Gaussian curves and surfaces" (1995). With `b = 0`, the weights at a point sum up to 1.
//! All exponents are of base 2, since powers of 2 are the fastest to compute.

use std::f64::consts::LOG2_E;

use maquette_value::simd::{FusedKernel, MulAdd, Software, exp2, widest_fused};
use nalgebra::Point3;

/// One Gaussian: `2^(level + sum over the axes of factor * (x - center)^2)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Bump {
    pub(crate) center: [f64; 3],
    /// The factor along each axis, `-log2(e) / (2 sigma^2)`.
    pub(crate) factor: [f64; 3],
    /// The base-2 logarithm of the weight. The greatest level of all Gaussians is 0, so no power is above 1.
    pub(crate) level: f64,
}

impl Bump {
    /// Returns true if the Gaussian is equally wide along all axes.
    #[inline(always)]
    pub(crate) fn is_round(&self) -> bool {
        self.factor[1..] == [self.factor[0]; 2]
    }

    /// Returns the exponent of 2 at a point.
    #[inline(always)]
    pub(crate) fn exponent(&self, [x, y, z]: [f64; 3]) -> f64 {
        let [dx, dy, dz] = [x - self.center[0], y - self.center[1], z - self.center[2]];
        self.level
            + dx * (dx * self.factor[0])
            + dy * (dy * self.factor[1])
            + dz * (dz * self.factor[2])
    }
}

/// A set of Gaussians, and the background weight that is added to their sum.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Gaussians {
    pub(crate) bumps: Vec<Bump>,
    /// The background weight, in units of the greatest weight.
    pub(crate) background: f64,
}

/// The minimum factor of a [`Bump`]. The limit keeps squares finite. It has no visible effect, since a Gaussian with this factor is
/// practically 0 everywhere except at its center.
const MIN_FACTOR: f64 = -1e300;

impl Gaussians {
    /// Creates Gaussians from centers, deviations and weights, one of each per Gaussian.
    pub(crate) fn new(
        centers: &[Point3<f64>],
        sigma: &[[f64; 3]],
        weights: &[f64],
        background: f64,
    ) -> Self {
        let greatest = weights.iter().copied().fold(0.0, f64::max);
        Self {
            bumps: (0..centers.len())
                .map(|index: usize| Bump {
                    center: centers[index].into(),
                    factor: sigma[index].map(|s| f64::max(-LOG2_E / (2.0 * s * s), MIN_FACTOR)),
                    level: libm::log2(weights[index]) - libm::log2(greatest),
                })
                .collect(),
            background: background / greatest,
        }
    }

    /// Returns the weight of each Gaussian at a point. Exponents are taken relative to the greatest one, so that the sum does not vanish,
    /// however far away the point is.
    pub(crate) fn weights(&self, point: Point3<f64>) -> Vec<f64> {
        let mut weights: Vec<f64> =
            self.bumps.iter().map(|bump| bump.exponent(point.into())).collect();
        let background = libm::log2(self.background);
        let greatest = weights.iter().copied().fold(background, f64::max);
        widest_fused(Powers { exponents: &mut weights, greatest });
        let rest =
            if self.background > 0.0 { exp2::<Software>(background - greatest) } else { 0.0 };
        let total = rest + weights.iter().sum::<f64>();
        weights.iter_mut().for_each(|weight| *weight /= total);
        weights
    }
}

/// A kernel that raises 2 to each exponent minus `greatest`.
struct Powers<'a> {
    exponents: &'a mut [f64],
    greatest: f64,
}

impl FusedKernel for Powers<'_> {
    #[inline(always)]
    fn run<F: MulAdd>(self) {
        self.exponents.iter_mut().for_each(|x| *x = exp2::<F>(*x - self.greatest));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn three_gaussians(background: f64) -> Gaussians {
        let centers = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.5]].map(Point3::from);
        let sigma = [[0.3, 0.2, 0.5], [0.5; 3], [0.1, 1.0, 0.4]];
        Gaussians::new(&centers, &sigma, &[1.0, 4.0, 0.5], background)
    }

    #[test]
    fn weights_sum_up_to_one_however_far_the_point_is() {
        for far in [0.0, 0.5, 60.0, 1e6] {
            for direction in [[1.0, 0.0, 0.0], [-1.0, 2.0, 0.3], [0.0, 0.0, -1.0]] {
                let weights =
                    three_gaussians(0.0).weights(Point3::from(direction.map(|x| x * far)));
                assert!((weights.iter().sum::<f64>() - 1.0).abs() <= 1e-14, "{far}: {weights:?}");
                assert!(weights.iter().all(|weight| *weight >= 0.0));
            }
        }
    }

    #[test]
    fn weights_are_those_of_the_definition() {
        let point = Point3::new(0.2, -0.1, 0.4);
        fn gaussian(d: [f64; 3], s: [f64; 3], w: f64) -> f64 {
            w * libm::exp(-(0..3).map(|k| d[k] * d[k] / (2.0 * s[k] * s[k])).sum::<f64>())
        }
        let values = [
            gaussian([0.2, -0.1, 0.4], [0.3, 0.2, 0.5], 1.0),
            gaussian([-0.8, -0.1, 0.4], [0.5; 3], 4.0),
            gaussian([0.2, -1.1, -0.1], [0.1, 1.0, 0.4], 0.5),
        ];
        for background in [0.0, 0.3] {
            let total = background + values.iter().sum::<f64>();
            for (weight, value) in three_gaussians(background).weights(point).iter().zip(values) {
                assert!((weight - value / total).abs() <= 1e-15);
            }
        }
    }

    #[test]
    fn far_away_all_weight_is_on_the_background() {
        let weights = three_gaussians(1e-3).weights(Point3::new(1e6, 0.0, 0.0));
        assert!(weights.iter().all(|weight| *weight < 1e-300));
    }
}
