//! Points and normals of a surface on a grid of parameters.
//!
//! The points are computed in two stages. First each row of the net is contracted along v, at all parameters v, into a line of sums. Then,
//! for each parameter u, p + 1 of these lines are contracted along u, where p is the degree. That costs p + 1 instead of (p + 1)^2 terms
//! per point. Lines are stored coordinate by coordinate, so that the inner loops run over contiguous rows of numbers, a block at a time.
//! The result is written once. All sums are added in the order of [`Surface::point`], so that the bits are equal.

use nalgebra::{Point3, Vector3};

use super::super::knots::Basis;
use super::super::mesh::diagonal;
use super::Surface;
use super::differentiate::{MIN_SINE, NOISE, POLE, steepness};
use super::evaluate::table;
use crate::memory::huge_vec;
use crate::parallel::*;
use crate::simd::{Kernel, widest};

/// The number of parameters per block. The sums of a block fit in the first-level cache.
const BLOCK: usize = 128;

/// The number of rows of points per task. A task works block by block, so that the lines of a block stay in the first-level cache from row
/// to row.
const STRIP: usize = 16;

/// The range of squared lengths that neither overflow nor underflow in further computations.
const SAFE: std::ops::Range<f64> = 1e-200..1e200;

/// The four homogeneous sums (w x, w y, w z, w) at the parameters of a block.
type Sums = [[f64; BLOCK]; 4];

impl Surface {
    /// The points at all pairs of the given parameters: for each of `us` a row with all of `vs`. The points equal those of
    /// [`point`](Self::point), with the same bits for any number of threads.
    pub fn grid(&self, us: &[f64], vs: &[f64]) -> Vec<Point3<f64>> {
        let mut points = huge_vec(us.len() * vs.len());
        if points.is_empty() {
            return points;
        }
        let along_u = table(&self.u, us, 0);
        let lines = self.lines(&table(&self.v, vs, 0));
        let strips = points.par_chunks_mut(STRIP * vs.len()).enumerate();
        strips.for_each(|(strip, points)| {
            let (us, bases) = (&us[strip * STRIP..], &along_u[strip * STRIP..]);
            widest(PointStrip { surface: self, lines: &lines, bases, us, vs, points });
        });
        points
    }

    /// The points and unit normals at all pairs of the given parameters, in the order of [`grid`](Self::grid). The normal is zero where
    /// [`normal`](Self::normal) finds none. The bits are the same for any number of threads.
    pub fn normal_grid(&self, us: &[f64], vs: &[f64]) -> (Vec<Point3<f64>>, Vec<Vector3<f64>>) {
        let mut points = huge_vec(us.len() * vs.len());
        let mut normals = huge_vec(us.len() * vs.len());
        if points.is_empty() {
            return (points, normals);
        }
        let [along_u, slope_u] = [0, 1].map(|order| table(&self.u, us, order));
        let slope_v = table(&self.v, vs, 1);
        let (lines, slopes) = (self.lines(&table(&self.v, vs, 0)), self.lines(&slope_v));
        let [noise_u, noise_v] = [&slope_u, &slope_v].map(|slopes| {
            slopes.iter().map(|basis| steepness(basis) * steepness(basis)).collect::<Vec<_>>()
        });
        let pole = POLE * diagonal(self.net.points());
        let points_of = points.par_chunks_mut(STRIP * vs.len());
        let normals_of = normals.par_chunks_mut(STRIP * vs.len());
        points_of.zip(normals_of).enumerate().for_each(|(strip, (points, normals))| {
            let first = strip * STRIP;
            widest(NormalStrip {
                surface: self,
                lines: [&lines, &slopes],
                bases: [&along_u[first..], &slope_u[first..]],
                noise: [&noise_u[first..], &noise_v],
                pole_sq: pole * pole,
                at: [&us[first..], vs],
                points,
                normals,
            });
        });
        (points, normals)
    }

    /// Divides the sums of a block by the weights and writes the points.
    #[inline(always)]
    fn write_points(&self, sums: &mut Sums, u: f64, vs: &[f64], points: &mut [Point3<f64>]) {
        let [x, y, z, w] = sums;
        for sum in [&mut *x, y, z] {
            sum.iter_mut().zip(&*w).for_each(|(sum, w)| *sum /= w);
        }
        for (k, point) in points.iter_mut().enumerate() {
            *point = Point3::new(x[k], y[k], z[k]);
        }
        // The loop has no early exit, so that vector instructions can be used. The same applies to the loops below.
        let all_positive = w[..points.len()].iter().fold(true, |all, &w| all & is_positive(w));
        if !all_positive {
            for (k, point) in points.iter_mut().enumerate().filter(|(k, _)| !is_positive(w[*k])) {
                *point = self.point(u, vs[k]);
            }
        }
    }

    /// Writes the normals of a block. They are computed from the points, which are already divided by the weights, and from the sums of the
    /// derivatives by u and by v.
    ///
    /// With A = (w S, w), the tangent `(A_u - w_u S) / w` has the direction of `A_u - w_u S`, and the normal has the direction of the cross
    /// product of two such vectors. The exception is a tangent that may be only a rounding error of zero, or one along a pole. The
    /// parameters `noise_` are the squares of such tangents for errors of size 1, and `pole_sq` is the square of the largest error of the
    /// control points of a pole. Where a tangent is so small, [`normal`](Self::normal) decides by the control points near that point.
    #[inline(always)]
    fn write_normals(
        &self,
        sums: &mut [Sums; 3],
        (noise_u, noise_vs, pole_sq): (f64, &[f64], f64),
        (u, vs): (f64, &[f64]),
        normals: &mut [Vector3<f64>],
    ) {
        let mut noise_v = [0.0; BLOCK];
        noise_v[..noise_vs.len()].copy_from_slice(noise_vs);
        let [[px, py, pz, w], [ux, uy, uz, uw], [vx, vy, vz, vw]] = sums;
        let mut sine = [0.0; BLOCK];
        for k in 0..BLOCK {
            let (ax, ay, az) =
                (ux[k] - px[k] * uw[k], uy[k] - py[k] * uw[k], uz[k] - pz[k] * uw[k]);
            let (bx, by, bz) =
                (vx[k] - px[k] * vw[k], vy[k] - py[k] * vw[k], vz[k] - pz[k] * vw[k]);
            let (nx, ny, nz) = (ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx);
            let length_sq = nx * nx + ny * ny + nz * nz;
            let (a_sq, b_sq) = (ax * ax + ay * ay + az * az, bx * bx + by * by + bz * bz);
            let size_sq = px[k] * px[k] + py[k] * py[k] + pz[k] * pz[k];
            let error_sq = (NOISE * NOISE * size_sq + pole_sq) * (w[k] * w[k]);
            let scale = 1.0 / length_sq.sqrt();
            (ux[k], uy[k], uz[k]) = (nx * scale, ny * scale, nz * scale);
            // The square of the length of the normal, or 0 where the tangents are almost parallel.
            let spans = (length_sq > MIN_SINE * MIN_SINE * (a_sq * b_sq))
                & (a_sq > noise_u * error_sq)
                & (b_sq > noise_v[k] * error_sq);
            sine[k] = if spans { length_sq } else { 0.0 };
        }
        for (k, normal) in normals.iter_mut().enumerate() {
            *normal = Vector3::new(ux[k], uy[k], uz[k]);
        }
        #[inline(always)]
        fn good(k: usize, sine: &[f64; 128], w: &[f64; 128]) -> bool {
            (SAFE.start <= sine[k]) & (sine[k] < SAFE.end) & is_positive(w[k])
        }
        if !(0..normals.len()).fold(true, |all, k| all & good(k, &sine, w)) {
            for (k, normal) in normals.iter_mut().enumerate().filter(|(k, _)| !good(*k, &sine, w)) {
                *normal =
                    self.normal(u, vs[k]).map_or(Vector3::zeros(), nalgebra::Unit::into_inner);
            }
        }
    }

    /// The first stage of [`grid`](Self::grid): contracts all rows of the net along v with the given basis functions.
    fn lines(&self, along_v: &[Basis]) -> Lines {
        let (columns, q) = (self.net.columns(), self.v.degree());
        let len = along_v.len();
        let mut sums: Vec<f64> = huge_vec(4 * len * self.net.rows());
        let weights = self.net.weights();
        sums.par_chunks_mut(4 * len).enumerate().for_each(|(row, sums)| {
            let points = &self.net.points()[row * columns..][..columns];
            let weights = &weights[row * columns..][..columns];
            let pairs = points.iter().zip(weights);
            let control: Vec<_> = pairs.map(|(point, &w)| (point.coords * w).push(w)).collect();
            let (x, rest) = sums.split_at_mut(len);
            let (y, rest) = rest.split_at_mut(len);
            let (z, w) = rest.split_at_mut(len);
            for (k, basis) in along_v.iter().enumerate() {
                let mut sum = nalgebra::Vector4::zeros();
                for (control, &n_v) in control[basis.first..].iter().zip(&basis.values[..=q]) {
                    sum += control * n_v;
                }
                (x[k], y[k], z[k], w[k]) = (sum.x, sum.y, sum.z, sum.w);
            }
        });
        Lines { sums, len, degree: self.u.degree() }
    }
}

#[inline(always)]
fn is_positive(weight: f64) -> bool {
    weight > 0.0
}

/// Some rows of the grid of points. The lists `bases` and `us` begin with the entries of these rows; further entries are ignored.
struct PointStrip<'a> {
    surface: &'a Surface,
    lines: &'a Lines,
    bases: &'a [Basis],
    us: &'a [f64],
    vs: &'a [f64],
    points: &'a mut [Point3<f64>],
}

impl Kernel for PointStrip<'_> {
    #[inline(always)]
    fn run(self) {
        let mut sums = [[0.0; BLOCK]; 4];
        for (block, vs) in self.vs.chunks(BLOCK).enumerate() {
            let rows = self.points.chunks_mut(self.vs.len()).zip(self.bases.iter().zip(self.us));
            for (points, (basis, &u)) in rows {
                let points = &mut points[block * BLOCK..][..vs.len()];
                self.lines.sum(basis, block * BLOCK, vs.len(), &mut sums);
                self.surface.write_points(&mut sums, u, vs, points);
            }
        }
    }
}

/// Some rows of the grid of points and normals. `lines` and `bases` have the data for values, then those for derivatives; `noise` and `at`
/// have the data for u, then those for v. Lists along u begin with the entries of these rows; further entries are ignored. `noise` and
/// `pole_sq` are explained at [`Surface::write_normals`].
struct NormalStrip<'a> {
    surface: &'a Surface,
    lines: [&'a Lines; 2],
    bases: [&'a [Basis]; 2],
    noise: [&'a [f64]; 2],
    pole_sq: f64,
    at: [&'a [f64]; 2],
    points: &'a mut [Point3<f64>],
    normals: &'a mut [Vector3<f64>],
}

impl Kernel for NormalStrip<'_> {
    #[inline(always)]
    fn run(self) {
        let mut sums = [[[0.0; BLOCK]; 4]; 3];
        let ([lines, slopes], [along_u, slope_u]) = (self.lines, self.bases);
        let ([noise_u, noise_v], [us, all_vs]) = (self.noise, self.at);
        for (block, vs) in all_vs.chunks(BLOCK).enumerate() {
            let (from, count) = (block * BLOCK, vs.len());
            let points = self.points.chunks_mut(all_vs.len());
            for (row, (points, normals)) in
                points.zip(self.normals.chunks_mut(all_vs.len())).enumerate()
            {
                let [at, by_u, by_v] = &mut sums;
                lines.sum(&along_u[row], from, count, at);
                lines.sum(&slope_u[row], from, count, by_u);
                slopes.sum(&along_u[row], from, count, by_v);
                self.surface.write_points(at, us[row], vs, &mut points[from..][..count]);
                let noise = (noise_u[row], &noise_v[from..][..count], self.pole_sq);
                let normals = &mut normals[from..][..count];
                self.surface.write_normals(&mut sums, noise, (us[row], vs), normals);
            }
        }
    }
}

/// The result of contracting each row of a net along v: for each row, `len` sums of each of the four coordinates.
struct Lines {
    sums: Vec<f64>,
    len: usize,
    /// The degree of the surface along u, which the second stage of [`Surface::grid`] uses.
    degree: usize,
}

impl Lines {
    /// The second stage of [`Surface::grid`]: contracts the lines along u, at `count` parameters v beginning with the index `from`.
    #[inline(always)]
    fn sum(&self, basis: &Basis, from: usize, count: usize, sums: &mut Sums) {
        match self.degree {
            1 => self.sum_of::<2>(basis, from, count, sums),
            2 => self.sum_of::<3>(basis, from, count, sums),
            3 => self.sum_of::<4>(basis, from, count, sums),
            4 => self.sum_of::<5>(basis, from, count, sums),
            5 => self.sum_of::<6>(basis, from, count, sums),
            6 => self.sum_of::<7>(basis, from, count, sums),
            7 => self.sum_of::<8>(basis, from, count, sums),
            8 => self.sum_of::<9>(basis, from, count, sums),
            _ => self.sum_of::<10>(basis, from, count, sums),
        }
    }

    /// The second stage of [`Surface::grid`] for `N` lines, where `N` is the degree + 1. Since `N` is a constant, all lines are added in
    /// one pass.
    #[inline(always)]
    fn sum_of<const N: usize>(&self, basis: &Basis, from: usize, count: usize, sums: &mut Sums) {
        for (coordinate, sums) in sums.iter_mut().enumerate() {
            let lines: [&[f64]; N] = std::array::from_fn(|k| {
                let start = ((basis.first + k) * 4 + coordinate) * self.len + from;
                &self.sums[start..][..count]
            });
            for (at, sum) in sums[..count].iter_mut().enumerate() {
                let mut total = 0.0;
                for (line, factor) in lines.iter().zip(&basis.values) {
                    total += line[at] * factor;
                }
                *sum = total;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::evaluate::tests::{samples, surface};

    // The grid has more than one block.
    #[test]
    fn a_grid_equals_its_points_bitwise_and_has_the_normals_of_the_derivatives() {
        for orders in [[2, 3], [3, 4], [4, 4], [5, 2], [7, 6]] {
            let surface = surface(orders);
            let (us, vs) = (samples(surface.u(), 7), samples(surface.v(), 300));
            let (points, normals) = surface.normal_grid(&us, &vs);
            assert_eq!(points, surface.grid(&us, &vs));
            for (index, (point, normal)) in points.iter().zip(&normals).enumerate() {
                let (u, v) = (us[index / vs.len()], vs[index % vs.len()]);
                assert_eq!(*point, surface.point(u, v));
                assert!((normal - surface.normal(u, v).unwrap().into_inner()).norm() <= 1e-12);
            }
        }
    }
}
