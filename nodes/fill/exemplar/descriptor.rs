//! Descriptors of height fields: a few principal components of sampled heights, for a fast search of similar height fields.

use maquette_value::parallel::*;
use nalgebra::{DMatrix, SymmetricEigen};

use super::frame::Orientation;
use super::heights::height_at;

/// The number of angles at which heights are sampled on each ring (circle around the center of a patch).
pub(super) const ANGLES: usize = 16;

/// The number of rings (circles around the center of a patch); the outermost has the patch's radius.
const RINGS: usize = 5;

/// The number of heights sampled on all rings.
pub(super) const COUNT: usize = RINGS * ANGLES;

/// The number of principal components in a descriptor.
pub(super) const KEPT: usize = 16;

/// The heights of one patch, sampled on rings (circles around its center).
pub(super) type Rings = [f32; COUNT];

/// The leading principal components of the heights on the rings of a patch.
pub(super) type Descriptor = [f32; KEPT];

/// The lattice positions at which the heights of a patch are sampled on rings.
pub(super) struct Polar {
    positions: Vec<[f64; 2]>,
    level: bool,
}

impl Polar {
    /// Returns the sampling positions for patches of `radius` on lattices with spacing `step`. If `level`, mean height and tilt are
    /// subtracted from the samples.
    pub(super) fn new(radius: f64, step: f64, level: bool) -> Self {
        Self {
            positions: (0..COUNT)
                .map(|k: usize| {
                    let fraction = (k / ANGLES + 1) as f64 / RINGS as f64;
                    let angle = std::f64::consts::TAU * (k % ANGLES) as f64 / ANGLES as f64;
                    let (sine, cosine) = libm::sincos(angle);
                    [cosine, sine].map(|x| x * fraction * radius / step)
                })
                .collect(),
            level,
        }
    }

    /// Samples the heights of a patch on the rings, in the given orientation. A sample position without a height gets the height at the
    /// next inner ring.
    pub(super) fn rings(&self, heights: &[f32], orientation: &Orientation) -> Rings {
        let mut rings = [0.0; COUNT];
        for (k, &position) in self.positions.iter().enumerate() {
            let height = height_at(heights, orientation.apply(position)) as f32;
            rings[k] = match height.is_finite() {
                true => height,
                false if k < ANGLES => 0.0,
                false => rings[k - ANGLES],
            };
        }
        if self.level {
            self.flatten(&mut rings);
        }
        rings
    }

    /// Subtracts the least-squares plane of the heights.
    fn flatten(&self, rings: &mut Rings) {
        let directions = self.positions.iter().zip(rings.iter());
        let (mut mean, mut tilt, mut size) = (0.0, [0.0; 2], 0.0);
        for (&[x, y], &height) in directions {
            let height = f64::from(height);
            mean += height / COUNT as f64;
            tilt = [tilt[0] + height * x, tilt[1] + height * y];
            size += (x * x + y * y) / 2.0;
        }
        for (&[x, y], height) in self.positions.iter().zip(rings.iter_mut()) {
            *height -= (mean + (tilt[0] * x + tilt[1] * y) / size) as f32;
        }
    }
}

/// A projection onto the principal components of ring heights: the directions in which the heights vary most.
pub(super) struct Basis {
    mean: Rings,
    rows: Vec<Rings>,
}

/// Maximum number of height fields from which the principal components are computed; more height fields hardly change the components.
const MAX_BASIS_RINGS: usize = 1024;

impl Basis {
    /// Computes the principal components of the ring heights of many height fields.
    pub(super) fn new(all: &[Rings]) -> Self {
        let every = all.len().div_ceil(MAX_BASIS_RINGS).max(1);
        let some: Vec<&Rings> = all.iter().step_by(every).collect();
        let mut mean = [0.0_f64; COUNT];
        for rings in &some {
            mean.iter_mut().zip(*rings).for_each(|(sum, &x)| *sum += f64::from(x));
        }
        let mean = mean.map(|sum| sum / some.len().max(1) as f64);
        let centered: Vec<Vec<f64>> = (some.iter())
            .map(|rings| rings.iter().zip(&mean).map(|(&x, mean)| f64::from(x) - mean).collect())
            .collect();
        let mut spread = DMatrix::zeros(COUNT, COUNT);
        let columns: Vec<Vec<f64>> = (0..COUNT)
            .into_par_iter()
            .map(|column| {
                let mut sums = vec![0.0; column + 1];
                for rings in &centered {
                    let own = rings[column];
                    sums.iter_mut().zip(rings).for_each(|(sum, x)| *sum += x * own);
                }
                sums
            })
            .collect();
        for (column, sums) in columns.iter().enumerate() {
            for (row, &sum) in sums.iter().enumerate() {
                spread[(row, column)] = sum;
                spread[(column, row)] = sum;
            }
        }
        if spread.iter().any(|entry: &f64| !entry.is_finite()) {
            // The heights are too large to be squared. Set the matrix to zero, which makes all descriptors equal.
            spread.fill(0.0);
        }
        let eigen = SymmetricEigen::new(spread);
        let mut order: Vec<usize> = (0..COUNT).collect();
        order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
        Self {
            mean: mean.map(|x| x as f32),
            rows: order[..KEPT]
                .iter()
                .map(|&k| std::array::from_fn(|i| eigen.eigenvectors[(i, k)] as f32))
                .collect(),
        }
    }

    /// Returns the descriptor of the heights on rings.
    pub(super) fn project(&self, rings: &Rings) -> Descriptor {
        let centered: Rings = std::array::from_fn(|k| rings[k] - self.mean[k]);
        std::array::from_fn(|k| dot(&self.rows[k], &centered))
    }
}

/// Dot product with eight partial sums, which the compiler vectorizes.
fn dot(a: &Rings, b: &Rings) -> f32 {
    let mut sums = [0.0_f32; 8];
    for (a, b) in a.chunks_exact(8).zip(b.chunks_exact(8)) {
        for k in 0..8 {
            sums[k] += a[k] * b[k];
        }
    }
    sums.iter().sum()
}
