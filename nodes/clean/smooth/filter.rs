//! A low-pass filter on the vertices of a mesh.

use maquette_base::topology::flat_faces::FlatFaces;
use maquette_base::topology::lists::Lists;
use maquette_node::{Error, Progress, bail};
use maquette_value::parallel::*;
use nalgebra::{Point3, Vector3};

/// The iteration stops at this residual, relative to the initial residual. The remaining error is far below the resolution of a scan.
const TOLERANCE: f64 = 1e-8;

/// Maximum number of steps of the iteration: enough for waves of a thousand edges.
const MAX_STEPS: usize = 20_000;

/// A low-pass filter on a graph whose vertices have masses and whose edges have weights.
pub(super) struct Filter {
    edges: Vec<([u32; 2], f64)>,
    masses: Vec<f64>,
}

impl Filter {
    pub(super) fn new(vertices: usize) -> Self {
        Self { edges: Vec::new(), masses: vec![0.0; vertices] }
    }

    pub(super) fn add_edge(&mut self, ends: [u32; 2], weight: f64) {
        let [a, b] = ends;
        self.edges.push(([a.min(b), a.max(b)], weight));
    }

    pub(super) fn add_mass(&mut self, vertex: u32, mass: f64) {
        self.masses[vertex as usize] += mass;
    }

    /// Moves the masses of dependent vertices to the vertices on which they depend.
    pub(super) fn gather_masses(&mut self, flat: &FlatFaces) {
        flat.gather(&mut self.masses);
    }

    /// Solves `(M + c K M^-1 K) x = M x_before` for the free vertices with a mass. `K` contains the weights, `M` the masses, and `c` is
    /// chosen such that a wave of the given `length` keeps half of its height.
    ///
    /// The solver is that of conjugate gradients with the diagonal as preconditioner, for all coordinates at once: Hestenes and Stiefel,
    /// "Methods of conjugate gradients for solving linear systems" (1952).
    pub(super) fn apply(
        &self,
        places: &mut [Point3<f64>],
        is_free: &[bool],
        length: f64,
        progress: &Progress<'_>,
    ) -> Result<(), Error> {
        let system = System::new(self, is_free, length);
        // Solve for the corrections of the positions, which are zero for vertices that are not free.
        let before: Vec<_> = places.iter().map(|place| place.coords).collect();
        let mut residual = system.bend(&before);
        residual.par_iter_mut().with_min_len(4096).for_each(|x| *x = -*x);
        let (mut x, first) =
            (vec![Vector3::zeros(); places.len()], system.dot(&residual, &residual));
        if first.amax() == 0.0 {
            return Ok(());
        }
        fn precondition(r: &[Vector3<f64>], system_over_diagonal: &[f64]) -> Vec<Vector3<f64>> {
            let all = r.par_iter().zip(system_over_diagonal).with_min_len(4096);
            all.map(|(r, over)| r * *over).collect()
        }
        let mut z = precondition(&residual, &system.over_diagonal);
        let mut p = z.clone();
        let mut rz = system.dot(&residual, &z);
        fn ratio(a: Vector3<f64>, b: Vector3<f64>) -> Vector3<f64> {
            a.zip_map(&b, |a, b| if b > 0.0 { a / b } else { 0.0 })
        }
        for step in 0..MAX_STEPS {
            // The number of steps is not known in advance, so the reported progress approaches 1 gradually.
            progress.tick(step as f64 / (step as f64 + 50.0))?;
            let q = system.apply(&p);
            let along = ratio(rz, system.dot(&p, &q));
            add(&mut x, along, &p);
            add(&mut residual, -along, &q);
            let left = system.dot(&residual, &residual);
            if (0..3).all(|k| left[k] <= TOLERANCE * TOLERANCE * first.amax()) {
                places.iter_mut().zip(&x).for_each(|(place, x)| *place += x);
                return Ok(());
            }
            z = precondition(&residual, &system.over_diagonal);
            let next = system.dot(&residual, &z);
            let share = ratio(next, rz);
            rz = next;
            let all = p.par_iter_mut().zip(&z).with_min_len(4096);
            all.for_each(|(p, z)| *p = z + p.component_mul(&share));
        }
        let off = (system.dot(&residual, &residual).amax() / first.amax()).sqrt();
        bail!(
            "the mesh is too distorted, or `length` is too large for its edges: the residual is still {off:.2e} after {MAX_STEPS} steps; use `Remesh` to make its faces uniform"
        )
    }
}

fn add(x: &mut [Vector3<f64>], factor: Vector3<f64>, p: &[Vector3<f64>]) {
    let all = x.par_iter_mut().zip(p).with_min_len(4096);
    all.for_each(|(x, p)| *x += p.component_mul(&factor));
}

/// The matrices of the linear equation that `Filter::apply` solves, row by row.
struct System {
    rows: Lists<(u32, f64)>,
    diagonal: Vec<f64>,
    masses: Vec<f64>,
    /// The inverse masses; 0 for vertices that are fixed or have no mass. With the value 0, bending at these vertices is ignored, so that a
    /// straight surface stays straight up to them.
    over_mass: Vec<f64>,
    /// The inverse diagonal of the equation's left side; 0 for vertices that are not solved for.
    over_diagonal: Vec<f64>,
    strength: f64,
}

impl System {
    fn new(filter: &Filter, is_free: &[bool], length: f64) -> Self {
        let mut edges = filter.edges.clone();
        // The sort is stable: entries of one edge stay in order, because their rounded sum depends on the order.
        edges.sort_by_key(|(ends, _)| *ends);
        let same = edges.chunk_by(|a, b| a.0 == b.0);
        let edges: Vec<_> = same
            .map(|same| (same[0].0, same.iter().map(|(_, weight)| weight).sum::<f64>()))
            .collect();
        let rows = Lists::group(filter.masses.len(), || {
            edges.iter().flat_map(|&([a, b], weight)| [(a, (b, weight)), (b, (a, weight))])
        });
        let diagonal =
            (0..rows.len()).map(|row| rows.list(row).iter().map(|(_, weight)| weight).sum());
        let diagonal: Vec<f64> = diagonal.collect();
        fn inverse(x: f64) -> f64 {
            if x > 0.0 { 1.0 / x } else { 0.0 }
        }
        let over_mass = filter
            .masses
            .iter()
            .zip(is_free)
            .map(|(&mass, &is_free)| if is_free { inverse(mass) } else { 0.0 });
        let over_mass = Vec::from_iter(over_mass);
        let unit = length / std::f64::consts::TAU;
        let strength = unit * unit * unit * unit;
        let over_diagonal = (0..rows.len())
            .map(|row: usize| {
                let others = rows
                    .list(row)
                    .iter()
                    .map(|&(other, weight)| weight * weight * over_mass[other as usize]);
                let bends = diagonal[row] * diagonal[row] * over_mass[row] + others.sum::<f64>();
                if over_mass[row] > 0.0 {
                    inverse(filter.masses[row] + strength * bends)
                } else {
                    0.0
                }
            })
            .collect();
        Self { rows, diagonal, masses: filter.masses.clone(), over_mass, over_diagonal, strength }
    }

    fn laplacian(&self, x: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        (0..x.len())
            .into_par_iter()
            .with_min_len(1024)
            .map(|row: usize| {
                let sum: Vector3<f64> = self
                    .rows
                    .list(row)
                    .iter()
                    .map(|&(other, weight)| x[other as usize] * weight)
                    .sum();
                x[row] * self.diagonal[row] - sum
            })
            .collect()
    }

    /// Returns `c K M^-1 K x`; 0 for vertices that are not solved for.
    fn bend(&self, x: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        let mut bent = self.laplacian(x);
        let all = bent.par_iter_mut().zip(&self.over_mass).with_min_len(4096);
        all.for_each(|(x, over)| *x *= *over);
        let mut twice = self.laplacian(&bent);
        let all = twice.par_iter_mut().zip(&self.over_mass).with_min_len(4096);
        all.for_each(|(x, &over)| *x *= if over > 0.0 { self.strength } else { 0.0 });
        twice
    }

    /// Returns the left side of the equation for `x`.
    fn apply(&self, x: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        let mut left = self.bend(x);
        let all = left.par_iter_mut().zip(x.par_iter().zip(&self.masses)).with_min_len(4096);
        all.for_each(|(left, (x, mass))| *left += x * *mass);
        left
    }

    fn dot(&self, a: &[Vector3<f64>], b: &[Vector3<f64>]) -> Vector3<f64> {
        let all = a.par_iter().zip(b).with_min_len(4096);
        all.map(|(a, b)| a.component_mul(b)).reduce(Vector3::zeros, |a, b| a + b)
    }
}
