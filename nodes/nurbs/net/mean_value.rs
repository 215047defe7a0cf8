//! A one-to-one map of a disk of triangles to a convex polygon.
//!
//! Every vertex inside is put at a mean of its neighbors, with the factors by which the mean value coordinates express its place:
//! Floater, "Mean value coordinates", Computer Aided Geometric Design 20 (2003), eq. 2.1. They are positive, so that the map is
//! one-to-one (Tutte, "How to draw a graph", 1963), and reproduce an affine map if the border has one.

use crate::grid::disk::Disk;

/// Residual, as a share of the size of the polygon, at which the equations count as solved: rounding leaves some 1e-15.
const TOLERANCE: f64 = 1e-13;

/// A residual above this is an error: a thousandth of a cell on the largest net.
const LARGEST: f64 = 1e-7;

/// Rounds of relaxation at the end, which put each vertex inside of its neighbors once more.
const ROUNDS: usize = 8;

/// Puts every inner vertex of the disk at the mean of its neighbors. `places` holds those of the border, and guesses for the
/// others; it receives the solution. Entries of vertices without a triangle stay as they are.
///
/// # Errors
/// The residual, if the iteration does not converge.
pub(crate) fn relax(disk: &Disk, places: &mut [[f64; 2]]) -> Result<(), f64> {
    let system = System::new(disk);
    for axis in 0..2 {
        let mut x: Vec<f64> = places.iter().map(|place| place[axis]).collect();
        system.solve(&mut x)?;
        places.iter_mut().zip(x).for_each(|(place, x)| place[axis] = x);
    }
    Ok(())
}

/// `x_i = sum_j factor_ij x_j` for the inner vertices i.
struct System {
    inner: Vec<u32>,
    /// Where the terms of each inner vertex begin, and the end.
    starts: Vec<usize>,
    /// Neighbor and factor.
    terms: Vec<(u32, f64)>,
    /// Number of vertices.
    count: usize,
}

impl System {
    fn new(disk: &Disk) -> Self {
        let count = disk.places.len();
        let mut on_border = vec![false; count];
        disk.border.iter().for_each(|&vertex| on_border[vertex as usize] = true);
        let mut weights: Vec<(u32, u32, f64)> = Vec::with_capacity(6 * disk.triangles.len());
        for triangle in &disk.triangles {
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
                // The tangent of half the angle between the spokes: (1 - cos) / sin.
                let cross = (a[0] * b[1] - a[1] * b[0]).abs();
                let tangent = (length_a * length_b - (a[0] * b[0] + a[1] * b[1])) / cross;
                weights.push((i, j, tangent / length_a));
                weights.push((i, k, tangent / length_b));
            }
        }
        weights.sort_unstable_by_key(|&(i, j, _)| (i, j));
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

    /// The mean of the neighbors of the `row`-th inner vertex.
    fn mean(&self, row: usize, x: &[f64]) -> f64 {
        let terms = &self.terms[self.starts[row]..self.starts[row + 1]];
        terms.iter().map(|&(vertex, factor)| factor * x[vertex as usize]).sum()
    }

    /// The means less the values themselves.
    fn residual(&self, x: &[f64]) -> Vec<f64> {
        (0..self.inner.len()).map(|row| self.mean(row, x) - x[self.inner[row] as usize]).collect()
    }

    /// The stabilized method of biconjugate gradients: van der Vorst, "Bi-CGSTAB" (1992), whose names are kept. It starts again
    /// from what it has where it breaks down.
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
            for row in 0..n {
                x[self.inner[row] as usize] = self.mean(row, x);
            }
        }
        let residual = largest(&self.residual(x));
        if residual <= LARGEST { Ok(()) } else { Err(residual) }
    }

    fn iterate(&self, x: &mut [f64], most: usize, steps: &mut usize) {
        fn dot(a: &[f64], b: &[f64]) -> f64 {
            a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>()
        }
        let n = self.inner.len();
        // A vector of the inner vertices as one of all vertices, whose other entries stay 0.
        let mut whole = vec![0.0; self.count];
        let mut apply = |p: &[f64]| -> Vec<f64> {
            self.inner.iter().zip(p).for_each(|(&vertex, &p)| whole[vertex as usize] = p);
            (0..n).map(|row| p[row] - self.mean(row, &whole)).collect()
        };
        let mut r = self.residual(x);
        let shadow = r.clone();
        let mut p = r.clone();
        let mut rho = dot(&r, &shadow);
        while *steps < most && largest(&r) > TOLERANCE / 4.0 {
            *steps += 1;
            let v = apply(&p);
            let alpha = rho / dot(&shadow, &v);
            let s: Vec<f64> = r.iter().zip(&v).map(|(r, v)| r - alpha * v).collect();
            let t = apply(&s);
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
