//! The mean and the gradient of the vertex colors over a patch.

use super::descriptor::{COUNT, Descriptor, KEPT};
use super::frame::Orientation;

/// A color scaled to lengths in mm, so that color differences can be added to distances.
pub(super) type Color = [f64; 3];

/// Fraction of a patch's radius within which colors are compared. It is the maximum distance from a patch's center at which vertices copy
/// from the patch. With the whole radius, patches with different centers look alike. With half of the radius, the textures that neighboring
/// patches copy agree less.
pub(super) const PART: f64 = 0.7;

/// The colors around the center of a patch: their mean, and the change of the color per radius along `x` and `y`.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Tint {
    mean: Color,
    slopes: [Color; 2],
}

impl Tint {
    /// Computes the mean and slopes of the colors at some positions in a disk. Positions are divided by the disk's radius.
    pub(super) fn new(samples: impl Iterator<Item = ([f64; 2], Color)> + Clone) -> Self {
        let (mut sum, mut count) = ([0.0; 3], 0.0_f64);
        for (_, color) in samples.clone() {
            (0..3).for_each(|k| sum[k] += color[k]);
            count += 1.0;
        }
        let mean = sum.map(|sum| sum / count.max(1.0));
        let slopes = [0, 1].map(|axis: usize| {
            let (mut sum, mut size) = ([0.0; 3], 0.0);
            for (position, color) in samples.clone() {
                (0..3).for_each(|k| sum[k] += position[axis] * (color[k] - mean[k]));
                size += position[axis] * position[axis];
            }
            sum.map(|sum| if size > 0.0 { sum / size } else { 0.0 })
        });
        Self { mean, slopes }
    }

    /// Returns the mean over the disk of the squared color differences to `exemplar`, which is seen in the given orientation.
    pub(super) fn compare(&self, exemplar: &Self, orientation: &Orientation) -> f64 {
        let back = orientation.inverse();
        let [l, a, b] = [0, 1, 2].map(|k: usize| {
            let [x, y] = back.apply([exemplar.slopes[0][k], exemplar.slopes[1][k]]);
            let mean = self.mean[k] - exemplar.mean[k];
            let (x, y) = (self.slopes[0][k] - x, self.slopes[1][k] - y);
            mean * mean + (x * x + y * y) / 4.0
        });
        l + a + b
    }

    /// Stores the mean color in a descriptor, in place of the least significant principal components.
    pub(super) fn put(&self, descriptor: &mut Descriptor) {
        for (own, channel) in descriptor[KEPT - 3..].iter_mut().zip(self.mean) {
            *own = (channel * (COUNT as f64).sqrt()) as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_color_gradient_matches_an_exemplar_with_the_same_rotation() {
        let corners = [[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]];
        fn tint_along(axis: usize, corners: &[[f64; 2]; 4]) -> Tint {
            Tint::new(corners.iter().map(|&p| (p, [p[axis], 5.0, 0.0])))
        }
        // A rotation by 90 degrees maps the x axis to the y axis.
        let orientations = Orientation::list(4, false);
        assert!(
            tint_along(0, &corners).compare(&tint_along(1, &corners), &orientations[1]) < 1e-12
        );
        assert!(
            (tint_along(0, &corners).compare(&tint_along(1, &corners), &orientations[3]) - 1.0)
                .abs()
                < 1e-12
        );
        assert!(
            (tint_along(0, &corners).compare(&tint_along(1, &corners), &orientations[0]) - 0.5)
                .abs()
                < 1e-12
        );
    }
}
