//! A one-to-one map of a disk of triangles to a convex polygon.
//!
//! Every inner vertex is a weighted mean of its neighbors. The weights are its mean value coordinates: Floater, "Mean value coordinates",
//! Computer Aided Geometric Design 20 (2003), eq. 2.1. Because the weights are positive, the map is one-to-one (Tutte, "How to draw a
//! graph", 1963). If the map of the border is affine, the whole map is.

use maquette_value::parallel::*;

use crate::grid::disk::Disk;

/// Tolerance of the solver: the residual as a fraction of the polygon's size. Rounding errors are about 1e-15.
const TOLERANCE: f64 = 1e-13;

/// Residual, as a fraction of the polygon's size, above which the map counts as failed: a thousandth of a cell on the largest net.
const LARGEST: f64 = 1e-7;

/// Number of relaxation rounds after the solver. In each round every vertex moves to the weighted mean of its neighbors, and thus inside
/// the polygon that they form. The solution alone ensures this only up to its tolerance.
const ROUNDS: usize = 8;

/// Moves every inner vertex of the disk to the weighted mean of its neighbors. At the call, `places` contains the positions of border
/// vertices and guesses for the others; afterwards it contains the solution. Entries of vertices without a triangle do not change.
///
/// # Errors
/// Returns the residual as error if the iteration does not converge.
pub(crate) fn relax(disk: &Disk, places: &mut [[f64; 2]]) -> Result<(), f64> {
    let system = System::new(disk);
    for axis in 0..2 {
        let mut x: Vec<f64> = places.iter().map(|place| place[axis]).collect();
        system.solve(&mut x)?;
        places.iter_mut().zip(x).for_each(|(place, x)| place[axis] = x);
    }
    Ok(())
}

/// The linear system `x_i = sum_j factor_ij x_j` for the inner vertices i.
struct System {
    inner: Vec<u32>,
    /// The index of the first term of each inner vertex, followed by the number of all terms.
    starts: Vec<usize>,
    /// The terms of all equations: the index of a neighboring vertex, and its weight.
    terms: Vec<(u32, f64)>,
    /// Number of all vertices of the disk.
    count: usize,
}

impl System {
    fn new(disk: &Disk) -> Self {
        let count = disk.places.len();
        let mut on_border = vec![false; count];
        disk.border.iter().for_each(|&vertex| on_border[vertex as usize] = true);
        let mut weights: Vec<(u32, u32, f64)> = Vec::with_capacity(6 * disk.triangles.len());
        for triangle in disk.triangles.iter().until_stopped() {
            for corner in 0..3 {
                let [i, j, k] = [0, 1, 2].map(|step| triangle[(corner + step) % 3]);
                if on_border[i as usize] {
                    continue;
                }
                let at = disk.places[i as usize];
                fn spoke(to: u32, at: [f64; 2], disk_places: &[[f64; 2]]) -> [f64; 2] {
                    [0, 1].map(|axis| disk_places[to as usize][axis] - at[axis])
                }
                let (a, b) = (spoke(j, at, &disk.places), spoke(k, at, &disk.places));
                let [length_a, length_b] = [a, b].map(|[x, y]| (x * x + y * y).sqrt());
                // The tangent of half the angle between two edges at the vertex: (1 - cos) / sin.
                let cross = (a[0] * b[1] - a[1] * b[0]).abs();
                let tangent = (length_a * length_b - (a[0] * b[0] + a[1] * b[1])) / cross;
                weights.push((i, j, tangent / length_a));
                weights.push((i, k, tangent / length_b));
            }
        }
        let stop = StopFlag::current();
        weights.sort_unstable_by_key(|&(i, j, _)| {
            stop.check();
            (i, j)
        });
        let mut system = Self { inner: Vec::new(), starts: vec![0], terms: Vec::new(), count };
        for row in weights.chunk_by(|a, b| a.0 == b.0) {
            let sum: f64 = row.iter().map(|(_, _, weight)| weight).sum();
            for same in row.chunk_by(|a, b| a.1 == b.1) {
                let weight: f64 = same.iter().map(|(_, _, weight)| weight).sum();
                system.terms.push((same[0].1, weight / sum));
            }
            system.inner.push(row[0].0);
            system.starts.push(system.terms.len());
        }
        system
    }

    /// Returns the weighted mean of the neighbors of the `row`-th inner vertex.
    fn mean(&self, row: usize, x: &[f64]) -> f64 {
        let terms = &self.terms[self.starts[row]..self.starts[row + 1]];
        terms.iter().map(|&(vertex, factor)| factor * x[vertex as usize]).sum()
    }

    /// Returns the residuals: for each inner vertex, the weighted mean of its neighbors minus the vertex's own value.
    fn residual(&self, x: &[f64]) -> Vec<f64> {
        let rows = (0..self.inner.len()).into_par_iter().with_min_len(4096);
        rows.map(|row| self.mean(row, x) - x[self.inner[row] as usize]).collect()
    }

    /// Solves the system by the stabilized biconjugate gradient method: van der Vorst, "Bi-CGSTAB" (1992), whose variable names are used.
    /// If the method breaks down, it restarts from the current solution.
    fn solve(&self, x: &mut [f64]) -> Result<(), f64> {
        let n = self.inner.len();
        let most = 200 + 20 * (n as f64).sqrt() as usize;
        let mut steps = 0;
        let mut before = f64::INFINITY;
        loop {
            let residual = largest(&self.residual(x));
            if residual <= TOLERANCE || most <= steps || before <= residual {
                break;
            }
            before = residual;
            self.iterate(x, most, &mut steps);
        }
        for _ in 0..ROUNDS {
            for row in (0..n).until_stopped() {
                x[self.inner[row] as usize] = self.mean(row, x);
            }
        }
        let residual = largest(&self.residual(x));
        if residual <= LARGEST { Ok(()) } else { Err(residual) }
    }

    /// Returns the product of the system's matrix and a vector over the inner vertices. `whole` is scratch space for all vertices,
    /// initially 0.
    fn multiply(&self, p: &[f64], whole: &mut [f64]) -> Vec<f64> {
        self.inner.iter().zip(p).for_each(|(&vertex, &p)| whole[vertex as usize] = p);
        let (whole, rows) = (&*whole, 0..self.inner.len());
        rows.into_par_iter().with_min_len(4096).map(|row| p[row] - self.mean(row, whole)).collect()
    }

    fn iterate(&self, x: &mut [f64], most: usize, steps: &mut usize) {
        fn dot(a: &[f64], b: &[f64]) -> f64 {
            a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>()
        }
        let n = self.inner.len();
        // Scratch space over all vertices; the entries of vertices that are not inner ones stay 0.
        let mut whole = vec![0.0; self.count];
        let mut r = self.residual(x);
        let shadow = r.clone();
        let mut p = r.clone();
        let mut rho = dot(&r, &shadow);
        while *steps < most && largest(&r) > TOLERANCE / 4.0 {
            *steps += 1;
            let v = self.multiply(&p, &mut whole);
            let alpha = rho / dot(&shadow, &v);
            let s: Vec<f64> = r.iter().zip(&v).map(|(r, v)| r - alpha * v).collect();
            let t = self.multiply(&s, &mut whole);
            let tt = dot(&t, &t);
            let omega = if tt > 0.0 { dot(&t, &s) / tt } else { 0.0 };
            if !(alpha.is_finite() && omega.is_finite()) {
                return;
            }
            for (k, &vertex) in self.inner.iter().enumerate() {
                x[vertex as usize] += alpha * p[k] + omega * s[k];
            }
            r = s.iter().zip(&t).map(|(s, t)| s - omega * t).collect();
            let next = dot(&r, &shadow);
            let beta = next / rho * (alpha / omega);
            rho = next;
            if !beta.is_finite() {
                return;
            }
            for k in 0..n {
                p[k] = r[k] + beta * (p[k] - omega * v[k]);
            }
        }
    }
}

fn largest(r: &[f64]) -> f64 {
    r.iter().map(|r| r.abs()).fold(0.0, f64::max)
}
