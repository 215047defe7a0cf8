//! How long the edges of a fill should be.

use nalgebra::Point3;

use crate::border::rim::Rim;
use crate::triangles::density::{Stop, TRIANGLES, estimate};
use crate::triangles::triangulation::Triangulation;

/// How long edges should be: the mean of the lengths of the data's edges at the rim, weighed by the inverse fourth power of the distance.
pub(crate) struct Sizes {
    /// Places on the rim, by coordinate, padded with infinite ones, whose weight is 0, to a multiple of [`LANES`].
    places: [Vec<f64>; 3],
    /// How long edges are there.
    lengths: Vec<f64>,
}

/// As many triangles are divided to estimate how many there will be: some milliseconds.
const MOST_DIVISIONS: usize = 50_000;

/// As many places on the rim are told apart at most: a multiple of [`LANES`].
const MOST_SAMPLES: usize = 128;

/// Sums that run side by side.
const LANES: usize = 4;

impl Sizes {
    pub(crate) fn new(rim: &Rim, edge: Option<f64>) -> Self {
        if let Some(edge) = edge {
            return Self::of(&[Point3::origin()], vec![edge]);
        }
        let chunk = rim.len().div_ceil(MOST_SAMPLES).max(1);
        let middles = rim.points.chunks(chunk).map(|points| points[points.len() / 2]);
        let middles: Vec<Point3<f64>> = middles.collect();
        Self::of(
            &middles,
            rim.lengths
                .chunks(chunk)
                .map(|lengths| lengths.iter().sum::<f64>() / lengths.len() as f64)
                .collect(),
        )
    }

    fn of(places: &[Point3<f64>], mut lengths: Vec<f64>) -> Self {
        let count = places.len().next_multiple_of(LANES);
        lengths.resize(count, 0.0);
        let places = [0, 1, 2].map(|axis| {
            let mut places: Vec<f64> = places.iter().map(|place| place[axis]).collect();
            places.resize(count, f64::INFINITY);
            places
        });
        Self { places, lengths }
    }

    /// # Errors
    /// If there would be too many triangles.
    pub(crate) fn check(&self, triangulation: &Triangulation) -> Result<(), Stop> {
        // Nowhere are edges shorter than where they are shortest at the rim: nearly always that estimate suffices.
        let lengths = self.lengths.iter().copied().filter(|length| *length > 0.0);
        let shortest = lengths.fold(f64::INFINITY, f64::min);
        if estimate(triangulation, |_| shortest, 0) <= TRIANGLES.most as f64 {
            return Ok(());
        }
        let need = estimate(triangulation, |point| self.at(point), MOST_DIVISIONS);
        if need <= TRIANGLES.most as f64 { Ok(()) } else { Err(Stop::TooMany(need)) }
    }

    /// The length of edges at a point.
    pub(crate) fn at(&self, point: Point3<f64>) -> f64 {
        let count = self.lengths.len();
        let [x, y, z] = [0, 1, 2].map(|axis| &self.places[axis][..count]);
        let mut buffer = [0.0; MOST_SAMPLES];
        let weights = &mut buffer[..count];
        for k in 0..count {
            let [dx, dy, dz] = [point.x - x[k], point.y - y[k], point.z - z[k]];
            let distance_sq = dx * dx + dy * dy + dz * dz;
            weights[k] = 1.0 / (distance_sq * distance_sq);
        }
        let (mut sums, mut totals) = ([0.0; LANES], [0.0; LANES]);
        let of_lanes =
            weights.as_chunks::<LANES>().0.iter().zip(self.lengths.as_chunks::<LANES>().0);
        for (weights, lengths) in of_lanes {
            for k in 0..LANES {
                sums[k] += weights[k] * lengths[k];
                totals[k] += weights[k];
            }
        }
        let total: f64 = totals.iter().sum();
        if total.is_finite() {
            return sums.iter().sum::<f64>() / total;
        }
        let here = weights.iter().position(|weight| weight.is_infinite());
        self.lengths[here.unwrap_or(0)]
    }
}
