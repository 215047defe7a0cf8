//! Smooths closed lines on a grid by local parabolas, each as long as it fits the line within a tolerance: Goldenshluger and Nemirovski,
//! "On spatially adaptive estimation of nonparametric regression" (1997). So long steps of a nearly straight line vanish, and corners stay.

use nalgebra::{Matrix3, Vector3};

/// Half of the lengths of the parabolas that are tried, in cells.
const REACHES: [f64; 8] = [1.5, 2.25, 3.5, 5.0, 7.5, 11.0, 16.0, 24.0];

/// Maximum half length of a parabola, as a fraction of the length of the line.
const MAX_SHARE: f64 = 0.2;

/// A closed line through (column, row) positions, with the distance of each point from the first one, along the line.
pub(crate) struct ClosedLine {
    along: Vec<f64>,
    length: f64,
}

/// A parabola as a function of the distance along the line from its middle, in `N` dimensions.
pub(crate) struct Parabola<const N: usize> {
    coefficients: [Vector3<f64>; N],
}

impl<const N: usize> Parabola<N> {
    /// Returns the value at distance `s` from the middle.
    pub(crate) fn at(&self, s: f64) -> [f64; N] {
        self.coefficients.map(|c| c[0] + s * (c[1] + s * c[2]))
    }
}

impl ClosedLine {
    pub(crate) fn new(points: &[[f64; 2]]) -> Self {
        let mut along = Vec::with_capacity(points.len());
        let mut length = 0.0;
        for ([x, y], [next_x, next_y]) in points.iter().zip(points.iter().cycle().skip(1)) {
            along.push(length);
            length += libm::hypot(next_x - x, next_y - y);
        }
        Self { along, length }
    }

    pub(crate) fn length(&self) -> f64 {
        self.length
    }

    /// Returns true if the line is long enough for parabolas of the given reach.
    pub(crate) fn has_room(&self, reach: f64) -> bool {
        reach <= MAX_SHARE * self.length
    }

    /// Returns the points at most `reach` before and after a point: the distance of each along the line from this point, and its index.
    fn near(&self, middle: usize, reach: f64) -> impl Iterator<Item = (f64, usize)> {
        let n = self.along.len();
        let after = (0..n).map(move |k| {
            let index = (middle + k) % n;
            let lap = if index < middle { self.length } else { 0.0 };
            (self.along[index] + lap - self.along[middle], index)
        });
        let before = (1..n).map(move |k| {
            let index = (middle + n - k) % n;
            let lap = if index > middle { self.length } else { 0.0 };
            (self.along[index] - lap - self.along[middle], index)
        });
        let after = after.take_while(move |(s, _)| *s <= reach);
        after.chain(before.take_while(move |(s, _)| -s <= reach))
    }

    /// Fits a parabola to the values of the points within `reach` of a point; near points count most. `None` if there are too few points.
    pub(crate) fn fit<const N: usize>(
        &self,
        middle: usize,
        reach: f64,
        values: &[[f64; N]],
    ) -> Option<Parabola<N>> {
        let mut normal = Matrix3::zeros();
        let mut right = [Vector3::zeros(); N];
        for (s, index) in self.near(middle, reach) {
            let powers = Vector3::new(1.0, s, s * s);
            let share = s / (reach * 1.1);
            let weight = (1.0 - share * share) * (1.0 - share * share);
            normal += powers * powers.transpose() * weight;
            right
                .iter_mut()
                .zip(values[index])
                .for_each(|(sum, value)| *sum += powers * (value * weight));
        }
        let decomposed = normal.cholesky()?;
        Some(Parabola { coefficients: right.map(|right| decomposed.solve(&right)) })
    }

    /// Returns true if a parabola of the given reach around a point is at most `tolerance` from the values.
    fn fits<const N: usize>(
        &self,
        middle: usize,
        reach: f64,
        values: &[[f64; N]],
        tolerance: f64,
    ) -> bool {
        self.fit(middle, reach, values).is_some_and(|parabola| {
            self.near(middle, reach).all(|(s, index)| {
                let pairs = parabola.at(s).into_iter().zip(values[index]);
                let distance_sq: f64 = pairs.map(|(a, b)| (a - b) * (a - b)).sum();
                distance_sq <= tolerance * tolerance
            })
        })
    }

    /// Returns the largest reach at which a parabola fits the values around a point within `tolerance`; 0 if none does.
    pub(crate) fn reach<const N: usize>(
        &self,
        middle: usize,
        values: &[[f64; N]],
        tolerance: f64,
    ) -> f64 {
        let reaches = REACHES.into_iter().filter(|&reach| self.has_room(reach));
        reaches
            .take_while(|&reach| self.fits(middle, reach, values, tolerance))
            .last()
            .unwrap_or(0.0)
    }

    /// Lowers the reaches so that they change slowly along the line. Otherwise neighboring parabolas would jump.
    pub(crate) fn even_out(&self, reaches: &mut [f64]) {
        let n = reaches.len();
        for k in 0..4 * n {
            let k = if k < 2 * n { k % n } else { n - 1 - k % n };
            let next = if k + 1 == n { self.length } else { self.along[k + 1] };
            let (spacing, other) = (next - self.along[k], (k + 1) % n);
            let (a, b) = (reaches[k], reaches[other]);
            reaches[k] = a.min(b + spacing);
            reaches[other] = b.min(a + spacing);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_parabola_through_a_circle_is_near_it_and_a_corner_is_short() {
        let circle: Vec<[f64; 2]> = (0..60)
            .map(|k| {
                let (sin, cos) = libm::sincos(f64::from(k) * std::f64::consts::TAU / 60.0);
                [10.0 * cos, 10.0 * sin]
            })
            .collect();
        let line = ClosedLine::new(&circle);
        for k in 0..60 {
            assert_eq!(line.reach(k, &circle, 0.4), 7.5);
            let [x, y] = line.fit(k, 5.0, &circle).unwrap().at(0.0);
            assert!((libm::hypot(x, y) - 10.0).abs() < 0.05);
        }
        let square: Vec<[f64; 2]> = (0..80)
            .map(|k| match (k / 20, f64::from(k % 20)) {
                (0, s) => [s, 0.0],
                (1, s) => [20.0, s],
                (2, s) => [20.0 - s, 20.0],
                (_, s) => [0.0, 20.0 - s],
            })
            .collect();
        let line = ClosedLine::new(&square);
        let mut reaches: Vec<f64> = (0..80).map(|k| line.reach(k, &square, 0.3)).collect();
        line.even_out(&mut reaches);
        assert!(reaches[0] <= 2.25 && reaches[10] >= 7.5, "{reaches:?}");
    }
}
