//! The stiffness of a fitted surface: how strongly control points keep their distance from the mean of their neighbors.

use maquette_base::linear::columns::Column;
use maquette_base::linear::stencils::Stencils;
use maquette_value::Mesh;

use super::folds::vertices_around;
use crate::limit::composed::laplacian;

/// The factor by which the stiffness increases at a fold; its square root holds for the control points around. Larger steps move the fold
/// instead of removing it.
const INCREASE: f64 = 6.0;

/// The equations that make a surface smooth.
pub(super) struct Stiffness {
    laplacian: Stencils,
    /// For each control point the goal of its Laplacian vector.
    targets: Vec<Column>,
    /// For each control point its Laplacian vector at the start, which is the goal where the stiffness has increased.
    start: Vec<Column>,
    /// The weight of each control point; 1 until the stiffness increases there.
    weights: Vec<f64>,
}

impl Stiffness {
    /// Creates equations that move each control point to the mean of its neighbors.
    pub(super) fn even(mesh: &Mesh) -> Self {
        let laplacian = laplacian(mesh);
        let count = laplacian.len();
        let targets = vec![[0.0; 3]; count];
        Self { laplacian, start: targets.clone(), targets, weights: vec![1.0; count] }
    }

    /// Creates equations that act across the surface only (on creases: across the crease). Along it, the distance from the mean of the
    /// neighbors stays that in `mesh`.
    pub(super) fn tangential(mesh: &Mesh) -> Self {
        let laplacian = laplacian(mesh);
        let rows = 0..laplacian.len();
        let start = rows.map(|vertex| laplacian.apply_row(vertex, mesh.positions()).coords.into());
        let (start, weights) = (start.collect(), vec![1.0; laplacian.len()]);
        Self { targets: tangential_parts(mesh, &laplacian), laplacian, start, weights }
    }

    /// Makes the surface stiffer around some faces. There, it approaches the shape of the start.
    pub(super) fn increase(&mut self, mesh: &Mesh, faces: &[u32]) {
        let near = vertices_around(mesh, faces);
        let mut is_near = vec![false; self.weights.len()];
        near.iter().for_each(|&vertex| is_near[vertex as usize] = true);
        let around = mesh.faces().iter().filter(|face| face.iter().any(|&v| is_near[v as usize]));
        let mut wide: Vec<u32> = around.flatten().copied().collect();
        wide.sort_unstable();
        wide.dedup();
        for vertices in [near, wide] {
            for vertex in vertices {
                self.weights[vertex as usize] *= INCREASE.sqrt();
                self.targets[vertex as usize] = self.start[vertex as usize];
            }
        }
    }

    /// Returns the rows of the equations and their right sides.
    pub(super) fn equations(&self) -> (Stencils, Vec<Column>) {
        let roots: Vec<f64> = self.weights.iter().map(|weight| weight.sqrt()).collect();
        let (rows, _) = Stencils::build(self.laplacian.len(), |_: &mut (), vertex, rows| {
            let (indices, shares) = self.laplacian.row(vertex);
            indices.iter().zip(shares).for_each(|(&k, share)| rows.push(k, share * roots[vertex]));
            rows.end();
        });
        let targets = self.targets.iter().zip(&roots);
        (rows, targets.map(|(target, root)| target.map(|part| part * root)).collect())
    }
}

/// Returns for each vertex the part of its Laplacian vector that is tangential to the mesh: perpendicular to the normal, or along the
/// crease or border. `laplacian` has a row of three entries for a vertex on a crease or border.
fn tangential_parts(mesh: &Mesh, laplacian: &Stencils) -> Vec<Column> {
    let (positions, normals) = (mesh.positions(), mesh.vertex_normals());
    let targets = (0..laplacian.len()).map(|vertex| {
        let vector = laplacian.apply_row(vertex, positions).coords;
        let (indices, _) = laplacian.row(vertex);
        let tangential =
            match indices.iter().filter(|&&k| k as usize != vertex).collect::<Vec<_>>()[..] {
                [&a, &b] => {
                    let along = positions[b as usize] - positions[a as usize];
                    along.try_normalize(0.0).map_or(vector, |along| along * along.dot(&vector))
                }
                _ => vector - normals[vertex] * normals[vertex].dot(&vector),
            };
        tangential.into()
    });
    targets.collect()
}
