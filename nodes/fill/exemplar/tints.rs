//! The mean and the gradient of the colors over a patch.

use super::descriptor::{COUNT, Descriptor, KEPT};
use super::frame::Turn;

/// A color that is expressed as a length, in mm, so that it counts beside distances.
pub(super) type Color = [f64; 3];

/// The part of a patch's radius within which its colors are compared: as much of it as a cell may copy. With all of it, patches look alike
/// whose middles do not; with half of it, neighbors agree less about the picture.
pub(super) const PART: f64 = 0.7;

/// The colors in the middle of a patch: the mean, and how they change per radius along `x` and `y`.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Tint {
    mean: Color,
    slopes: [Color; 2],
}

impl Tint {
    /// Of colors at places all over a disk, in radii.
    pub(super) fn new(samples: impl Iterator<Item = ([f64; 2], Color)> + Clone) -> Self {
        let (mut sum, mut count) = ([0.0; 3], 0.0_f64);
        for (_, color) in samples.clone() {
            (0..3).for_each(|k| sum[k] += color[k]);
            count += 1.0;
        }
        let mean = sum.map(|sum| sum / count.max(1.0));
        let slope = |axis: usize| {
            let (mut sum, mut size) = ([0.0; 3], 0.0);
            for (place, color) in samples.clone() {
                (0..3).for_each(|k| sum[k] += place[axis] * (color[k] - mean[k]));
                size += place[axis] * place[axis];
            }
            sum.map(|sum| if size > 0.0 { sum / size } else { 0.0 })
        };
        Self { mean, slopes: [slope(0), slope(1)] }
    }

    /// The mean over the disk of the squared distance to the colors of an exemplar that lies on it like this.
    pub(super) fn compare(&self, exemplar: &Self, turn: &Turn) -> f64 {
        let back = turn.inverse();
        let squared = |k: usize| {
            let [x, y] = back.apply([exemplar.slopes[0][k], exemplar.slopes[1][k]]);
            let mean = self.mean[k] - exemplar.mean[k];
            let (x, y) = (self.slopes[0][k] - x, self.slopes[1][k] - y);
            mean * mean + (x * x + y * y) / 4.0
        };
        squared(0) + squared(1) + squared(2)
    }

    /// Puts the mean color in a descriptor, in place of the least significant numbers.
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
    fn colors_that_change_to_one_side_suit_an_exemplar_that_is_turned_alike() {
        let corners = [[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]];
        fn along(axis: usize, corners: &[[f64; 2]; 4]) -> Tint {
            Tint::new(corners.iter().map(|&p| (p, [p[axis], 5.0, 0.0])))
        }
        // A quarter turn takes x to y.
        let turns = Turn::all(4, false);
        assert!(along(0, &corners).compare(&along(1, &corners), &turns[1]) < 1e-12);
        assert!((along(0, &corners).compare(&along(1, &corners), &turns[3]) - 1.0).abs() < 1e-12);
        assert!((along(0, &corners).compare(&along(1, &corners), &turns[0]) - 0.5).abs() < 1e-12);
    }
}
