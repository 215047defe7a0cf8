//! A low-pass filter on the vertices of a net.

use maquette_base::topology::lists::Lists;
use maquette_node::{Cancelled, Progress};
use maquette_value::parallel::*;
use nalgebra::{Point3, Vector3};
use thiserror::Error;

/// Why there is no solution.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum FilterError {
    /// The iteration did not end.
    #[error(
        "the mesh is too distorted, or `length` too great beside its edges: after {steps} steps places are still off by {off:.2e} of what they were; `Remesh` makes its faces even"
    )]
    NotSolved {
        /// How many steps were done.
        steps: usize,
        /// The residual, relative to the right side.
        off: f64,
    },
    /// The evaluation was told to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// When places are right: the residual relative to the first one, far below what a scan resolves.
const TOLERANCE: f64 = 1e-8;

/// So many steps are enough for waves of a thousand edges.
const MOST_STEPS: usize = 20_000;

/// Vertices with masses, joined by edges with weights.
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

    /// Solves `(M + c K M^-1 K) x = M x_before` for the vertices that are free and have a mass, where `K` has the weights, `M` the masses, and `c`
    /// is such that half of a wave of this `length` stays.
    ///
    /// By conjugate gradients with the diagonal as preconditioner, Hestenes and Stiefel, "Methods of conjugate gradients for
    /// solving linear systems" (1952), all coordinates at once.
    pub(super) fn apply(
        &self,
        places: &mut [Point3<f64>],
        is_free: &[bool],
        length: f64,
        progress: &Progress<'_>,
    ) -> Result<(), FilterError> {
        let system = System::new(self, is_free, length);
        // What must be added to the places: zero where they are not free.
        let before: Vec<_> = places.iter().map(|place| place.coords).collect();
        let mut residual = system.bend(&before);
        residual.par_iter_mut().with_min_len(4096).for_each(|x| *x = -*x);
        let (mut x, first) =
            (vec![Vector3::zeros(); places.len()], system.dot(&residual, &residual));
        if first.amax() == 0.0 {
            return Ok(());
        }
        fn conditioned(r: &[Vector3<f64>], system_over_diagonal: &[f64]) -> Vec<Vector3<f64>> {
            let all = r.par_iter().zip(system_over_diagonal).with_min_len(4096);
            all.map(|(r, over)| r * *over).collect()
        }
        let mut z = conditioned(&residual, &system.over_diagonal);
        let mut p = z.clone();
        let mut rz = system.dot(&residual, &z);
        fn ratio(a: Vector3<f64>, b: Vector3<f64>) -> Vector3<f64> {
            a.zip_map(&b, |a, b| if b > 0.0 { a / b } else { 0.0 })
        }
        for step in 0..MOST_STEPS {
            // How many there will be is not known.
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
            z = conditioned(&residual, &system.over_diagonal);
            let next = system.dot(&residual, &z);
            let share = ratio(next, rz);
            rz = next;
            let all = p.par_iter_mut().zip(&z).with_min_len(4096);
            all.for_each(|(p, z)| *p = z + p.component_mul(&share));
        }
        let off = (system.dot(&residual, &residual).amax() / first.amax()).sqrt();
        Err(FilterError::NotSolved { steps: MOST_STEPS, off })
    }
}

fn add(x: &mut [Vector3<f64>], factor: Vector3<f64>, p: &[Vector3<f64>]) {
    let all = x.par_iter_mut().zip(p).with_min_len(4096);
    all.for_each(|(x, p)| *x += p.component_mul(&factor));
}

/// The matrices by rows.
struct System {
    rows: Lists<(u32, f64)>,
    diagonal: Vec<f64>,
    masses: Vec<f64>,
    /// One over the masses; 0 where nothing is to be solved. There no bend counts, so that what is straight up to there stays so.
    over_mass: Vec<f64>,
    /// One over the diagonal of the left side; 0 where nothing is to be solved.
    over_diagonal: Vec<f64>,
    strength: f64,
}

impl System {
    fn new(filter: &Filter, is_free: &[bool], length: f64) -> Self {
        let mut edges = filter.edges.clone();
        // Those of one edge stay in their order, for the sum.
        edges.sort_by_key(|(ends, _)| *ends);
        let same = edges.chunk_by(|a, b| a.0 == b.0);
        let edges: Vec<_> = same
            .map(|same| (same[0].0, same.iter().map(|(_, weight)| weight).sum::<f64>()))
            .collect();
        let both =
            || edges.iter().flat_map(|&([a, b], weight)| [(a, (b, weight)), (b, (a, weight))]);
        let rows = Lists::group(filter.masses.len(), both);
        let diagonal =
            (0..rows.len()).map(|row| rows.of(row).iter().map(|(_, weight)| weight).sum());
        let diagonal: Vec<f64> = diagonal.collect();
        fn over(x: f64) -> f64 {
            if x > 0.0 { 1.0 / x } else { 0.0 }
        }
        let over_mass = filter
            .masses
            .iter()
            .zip(is_free)
            .map(|(&mass, &is_free)| if is_free { over(mass) } else { 0.0 });
        let over_mass = Vec::from_iter(over_mass);
        let unit = length / std::f64::consts::TAU;
        let strength = unit * unit * unit * unit;
        let over_diagonal = (0..rows.len())
            .map(|row: usize| {
                let others = rows
                    .of(row)
                    .iter()
                    .map(|&(other, weight)| weight * weight * over_mass[other as usize]);
                let bends = diagonal[row] * diagonal[row] * over_mass[row] + others.sum::<f64>();
                if over_mass[row] > 0.0 { over(filter.masses[row] + strength * bends) } else { 0.0 }
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
                    .of(row)
                    .iter()
                    .map(|&(other, weight)| x[other as usize] * weight)
                    .sum();
                x[row] * self.diagonal[row] - sum
            })
            .collect()
    }

    /// `c K M^-1 K x`, 0 where nothing is to be solved.
    fn bend(&self, x: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        let mut bent = self.laplacian(x);
        let all = bent.par_iter_mut().zip(&self.over_mass).with_min_len(4096);
        all.for_each(|(x, over)| *x *= *over);
        let mut twice = self.laplacian(&bent);
        let all = twice.par_iter_mut().zip(&self.over_mass).with_min_len(4096);
        all.for_each(|(x, &over)| *x *= if over > 0.0 { self.strength } else { 0.0 });
        twice
    }

    /// The left side.
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
