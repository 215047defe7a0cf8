//! Thin plates over the vertices of a fill; the vertices of the input mesh do not move.

use maquette_base::linear::cholesky::{Cholesky, Symmetric};
use nalgebra::{Point3, Vector3};

use super::surface::Surface;

/// The equations of a thin plate. Its energy is the sum of the squared Laplacians at the fill's vertices and at the rims, plus the squared
/// motions of the vertices that are held.
pub(super) struct Plate<'a> {
    surface: &'a Surface<'a>,
    factors: Cholesky,
    first: usize,
}

impl<'a> Plate<'a> {
    /// Creates a plate over the vertices from index `first` on, each held at its position with the stiffness `hold`. Returns `None` if the
    /// equations have no unique solution.
    pub(super) fn new(
        surface: &'a Surface<'a>,
        vertices: usize,
        first: usize,
        hold: impl Fn(u32) -> f64,
    ) -> Option<Self> {
        let mut matrix = Symmetric { starts: vec![0], indices: vec![], entries: vec![] };
        let mut sums = vec![0.0; vertices];
        let mut met = Vec::new();
        for unknown in first as u32..vertices as u32 {
            for &row in surface.ring(unknown).iter().chain([&unknown]) {
                let ring = surface.ring(row);
                let degree = ring.len() as f64;
                let weight = if row == unknown { degree } else { -1.0 };
                for (column, entry) in
                    ring.iter().map(|&column| (column, -weight)).chain([(row, weight * degree)])
                {
                    if first <= column as usize {
                        met.push(column);
                        sums[column as usize] += entry;
                    }
                }
            }
            sums[unknown as usize] += hold(unknown);
            met.sort_unstable();
            met.dedup();
            for column in met.drain(..) {
                matrix.indices.push(column - first as u32);
                matrix.entries.push(std::mem::take(&mut sums[column as usize]));
            }
            matrix.starts.push(matrix.indices.len() as u32);
        }
        let factors = Cholesky::new(&matrix)?;
        Some(Self { surface, factors, first })
    }

    /// Returns the displacement of each vertex of the fill under the given loads per vertex.
    pub(super) fn solve(&self, mut load: Vec<[f64; 3]>) -> Vec<[f64; 3]> {
        self.factors.solve(&mut load);
        load
    }

    /// Returns the load under which the Laplacian at each vertex comes as near as possible to `wanted`.
    pub(super) fn load(&self, wanted: &[f64]) -> Vec<[f64; 3]> {
        (self.first..wanted.len())
            .map(|vertex: usize| {
                let ring = self.surface.ring(vertex as u32);
                let around: f64 = ring.iter().map(|&other| wanted[other as usize]).sum();
                [ring.len() as f64 * wanted[vertex] - around, 0.0, 0.0]
            })
            .collect()
    }
}

/// Stiffness that holds the given motions, relative to the stiffness of the plate. With a smaller value, the plate does not follow waves
/// two samples long. With a larger value, the plate bends at each sample.
const STIFFNESS: f64 = 100.0;

/// Spreads the motions of some vertices of the fill to all of its vertices.
pub(super) struct Spread<'a> {
    plate: Plate<'a>,
    moved: Vec<u32>,
}

impl<'a> Spread<'a> {
    /// Creates an operator that spreads the motions of the vertices `moved` to all vertices from the index `first` on. Returns `None` if
    /// the equations have no unique solution.
    pub(super) fn new(
        surface: &'a Surface<'a>,
        vertices: usize,
        first: usize,
        moved: &[u32],
    ) -> Option<Self> {
        let mut held = vec![0.0; vertices];
        moved.iter().for_each(|&vertex| held[vertex as usize] = STIFFNESS);
        let plate = Plate::new(surface, vertices, first, |vertex| held[vertex as usize])?;
        Some(Self { plate, moved: moved.to_vec() })
    }

    /// Moves all vertices of the fill. `motions` has the given motion of each vertex in `moved`.
    pub(super) fn apply(&self, motions: &[Vector3<f64>], points: &mut [Point3<f64>]) {
        let first = self.plate.first;
        let mut load = vec![[0.0; 3]; points.len() - first];
        for (&vertex, motion) in self.moved.iter().zip(motions) {
            load[vertex as usize - first] = (motion * STIFFNESS).into();
        }
        let motions = self.plate.solve(load);
        points[first..].iter_mut().zip(motions).for_each(|(point, motion)| {
            *point += Vector3::from(motion);
        });
    }
}
