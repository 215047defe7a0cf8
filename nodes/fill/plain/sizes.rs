//! The target edge lengths of the fill of a hole.

use nalgebra::Point3;

use crate::border::rim::Rim;
use crate::triangles::density::{RefineError, TRIANGLES, estimate};
use crate::triangles::triangulation::Triangulation;

/// Target edge lengths. The target at a point is the mean of the input mesh's edge lengths at the rim, weighted by the inverse fourth power
/// of their distance from the point.
pub(crate) struct Sizes {
    /// Coordinates of sample points on the rim, one list per axis. Points at infinity, whose weight is 0, pad the lists to a multiple of
    /// [`LANES`].
    positions: [Vec<f64>; 3],
    /// The edge length at each sample point.
    lengths: Vec<f64>,
}

/// Maximum number of divisions of triangles for estimating the final number of triangles; they take some milliseconds.
const MAX_DIVISIONS: usize = 50_000;

/// Maximum number of sample points on the rim: a multiple of [`LANES`].
const MAX_SAMPLES: usize = 128;

/// Number of partial sums that are computed in parallel.
const LANES: usize = 4;

impl Sizes {
    pub(crate) fn new(rim: &Rim, edge: Option<f64>) -> Self {
        if let Some(edge) = edge {
            return Self::from_samples(&[Point3::origin()], vec![edge]);
        }
        let chunk = rim.len().div_ceil(MAX_SAMPLES).max(1);
        let middles = rim.points.chunks(chunk).map(|points| points[points.len() / 2]);
        let middles: Vec<Point3<f64>> = middles.collect();
        Self::from_samples(
            &middles,
            rim.lengths
                .chunks(chunk)
                .map(|lengths| lengths.iter().sum::<f64>() / lengths.len() as f64)
                .collect(),
        )
    }

    fn from_samples(positions: &[Point3<f64>], mut lengths: Vec<f64>) -> Self {
        let count = positions.len().next_multiple_of(LANES);
        lengths.resize(count, 0.0);
        let positions = [0, 1, 2].map(|axis| {
            let mut positions: Vec<f64> = positions.iter().map(|position| position[axis]).collect();
            positions.resize(count, f64::INFINITY);
            positions
        });
        Self { positions, lengths }
    }

    /// Checks that a fill with the target edge lengths does not have too many triangles.
    ///
    /// # Errors
    /// Returns an error if the fill would have too many triangles.
    pub(crate) fn check(&self, triangulation: &Triangulation) -> Result<(), RefineError> {
        // Fast check, which nearly always suffices: edges are nowhere shorter than the shortest at the rim.
        let lengths = self.lengths.iter().copied().filter(|length| *length > 0.0);
        let shortest = lengths.fold(f64::INFINITY, f64::min);
        if estimate(triangulation, |_| shortest, 0) <= TRIANGLES.max as f64 {
            return Ok(());
        }
        let need = estimate(triangulation, |point| self.length_at(point), MAX_DIVISIONS);
        if need <= TRIANGLES.max as f64 { Ok(()) } else { Err(RefineError::TooMany(need)) }
    }

    /// Returns the target edge length at a point.
    pub(crate) fn length_at(&self, point: Point3<f64>) -> f64 {
        let count = self.lengths.len();
        let [x, y, z] = [0, 1, 2].map(|axis| &self.positions[axis][..count]);
        let mut buffer = [0.0; MAX_SAMPLES];
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
