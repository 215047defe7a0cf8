//! Computes values that change slowly over a surface.

use std::sync::OnceLock;

use maquette_node::{CancelledError, Progress};
use maquette_value::Mesh;
use maquette_value::parallel::*;

use super::cholesky::{Cholesky, Dissection, Links, Symmetric};
use crate::topology::lists::Lists;

/// The connectivity of a mesh's vertices, from which values at the vertices are computed that are as smooth as possible.
pub struct Membrane {
    /// The neighbors of each vertex with the weights of their edges: the cotangent weights of Pinkall and Polthier, "Computing discrete
    /// minimal surfaces and their conjugates" (1993), with a minimum that keeps them positive.
    links: Vec<Vec<(u32, f64)>>,
    /// The surface area around each vertex, in mm^2.
    pub areas: Vec<f64>,
    /// The diagonal of the mesh's bounding box in mm.
    pub extent: f64,
    /// The elimination of all vertices, which is computed on first use.
    elimination: OnceLock<Elimination>,
}

/// The order in which the values of all vertices are eliminated, and the positions of the matrix's entries. They do not depend on springs.
struct Elimination {
    starts: Vec<u32>,
    indices: Vec<u32>,
    order: Dissection,
}

impl Elimination {
    fn new(links: &[Vec<(u32, f64)>]) -> Self {
        let mut starts = vec![0];
        let mut indices = Vec::new();
        for (vertex, links) in (0..).zip(links) {
            indices.push(vertex);
            indices.extend(links.iter().map(|it| it.0));
            starts.push(indices.len() as u32);
        }
        let order = Dissection::new(Links { starts: &starts, neighbors: &indices }, 1);
        Self { starts, indices, order }
    }
}

/// The terms of a triangle.
#[derive(Clone, Copy)]
struct Pulls {
    /// For each corner, half of the cotangent of its angle within limits: the triangle's part of the weight of the opposite edge.
    of_opposite_edges: [f64; 3],
    /// A third of the triangle's area.
    third: f64,
}

impl Pulls {
    fn new(mesh: &Mesh, triangle: &[u32; 3]) -> Self {
        let at = triangle.map(|it| mesh.positions()[it as usize]);
        let twice = (at[1] - at[0]).cross(&(at[2] - at[0])).norm();
        let of_opposite_edges = [0, 1, 2].map(|own| {
            let [next, last] = [(own + 1) % 3, (own + 2) % 3];
            let cotangent = (at[next] - at[own]).dot(&(at[last] - at[own])) / twice;
            let pull = if cotangent.is_nan() {
                MIN_EDGE_WEIGHT
            } else {
                cotangent.clamp(MIN_EDGE_WEIGHT, MAX_EDGE_WEIGHT)
            };
            pull / 2.0
        });
        Self { of_opposite_edges, third: twice / 6.0 }
    }
}

/// The number of vertices per parallel task.
const BLOCK: usize = 4096;

/// Minimum weight of an edge. For comparison, each edge of a mesh of equilateral triangles has the weight 1 / sqrt 3.
const MIN_EDGE_WEIGHT: f64 = 0.05;

/// Maximum weight of an edge, which is reached at nearly degenerate triangles.
const MAX_EDGE_WEIGHT: f64 = 20.0;

impl Membrane {
    /// Computes the connectivity of a whole mesh.
    pub fn new(mesh: &Mesh) -> Self {
        Self::of_triangles(mesh, &|_| true)
    }

    /// Computes the connectivity of some vertices of a mesh: only faces with at least one of them count.
    pub fn around(mesh: &Mesh, vertices: impl Fn(u32) -> bool + Sync) -> Self {
        Self::of_triangles(mesh, &|triangle| triangle.iter().any(|&vertex| vertices(vertex)))
    }

    fn of_triangles(mesh: &Mesh, is_used: &(impl Fn(&[u32; 3]) -> bool + Sync)) -> Self {
        let count = mesh.positions().len();
        let triangles: Vec<[u32; 3]> = (0..mesh.faces().len())
            .into_par_iter()
            .flat_map_iter(|face: usize| {
                let face = mesh.faces().face(face);
                (1..face.len() - 1).map(|k| [face[0], face[k], face[k + 1]])
            })
            .filter(|triangle: &[u32; 3]| is_used(triangle))
            .collect();
        let pulls: Vec<Pulls> =
            triangles.par_iter().map(|triangle| Pulls::new(mesh, triangle)).collect();
        let of_vertices = Lists::group_all(count, triangles.len(), |number| {
            let corners = triangles[number].into_iter().zip(0_u8..);
            corners.map(move |(vertex, corner)| (vertex, (number as u32, corner)))
        });
        let (of_vertices, triangles, pulls) = (&of_vertices, &triangles, &pulls);
        let (links, areas) = (0..count)
            .into_par_iter()
            .map(|vertex: usize| {
                let (mut row, mut area) = (Vec::new(), 0.0);
                for &(number, corner) in of_vertices.list(vertex) {
                    let (triangle, pulls) = (triangles[number as usize], pulls[number as usize]);
                    area += pulls.third;
                    // The weight at another corner belongs to the edge to the third corner.
                    let own = usize::from(corner);
                    let others = (0..3).filter(|&opposite| opposite != own);
                    row.extend(others.map(|opposite| {
                        (triangle[3 - own - opposite], pulls.of_opposite_edges[opposite])
                    }));
                }
                row.sort_by_key(|it| it.0);
                let merged = row.chunk_by(|a: &(u32, f64), b| a.0 == b.0);
                let merged = merged.map(|it| (it[0].0, it.iter().map(|it| it.1).sum()));
                (merged.collect(), area)
            })
            .unzip();
        let (low, high) = mesh.bounds().unwrap_or_default();
        Self { links, areas, extent: (high - low).norm(), elimination: OnceLock::new() }
    }

    /// Returns the smoothest values at the vertices. They minimize the sum of `weight (x - y)^2` over all edges, with the values `x` and
    /// `y` at the ends of an edge, plus the sum of `spring (x - value)^2` over all vertices. Returns `None` if a part of the mesh has no
    /// spring.
    pub fn solve(
        &self,
        springs: &[f64],
        values: &[[f64; 3]],
        progress: &Progress<'_>,
    ) -> Result<Option<Vec<[f64; 3]>>, CancelledError> {
        // Keep the equation of a vertex without faces solvable; the value of such a vertex is arbitrary.
        let own: Vec<f64> = (springs.iter().zip(&self.links))
            .map(|(&spring, links)| if links.is_empty() && spring == 0.0 { 1.0 } else { spring })
            .collect();
        let Elimination { starts, indices, order } =
            self.elimination.get_or_init(|| Elimination::new(&self.links));
        let rows = self.links.par_iter().zip(&own).with_min_len(BLOCK);
        let entries = rows
            .flat_map_iter(|(links, own): (&Vec<(u32, f64)>, &f64)| {
                let sum: f64 = links.iter().map(|it| it.1).sum();
                std::iter::once(sum + own).chain(links.iter().map(|it| -it.1))
            })
            .collect();
        let matrix = Symmetric { starts: starts.clone(), indices: indices.clone(), entries };
        let Some(factors) = Cholesky::with_ordering(&matrix, order, progress)? else {
            return Ok(None);
        };
        let mut right: Vec<_> =
            values.iter().zip(&own).map(|(value, spring)| value.map(|x| x * spring)).collect();
        factors.solve(&mut right);
        Ok(Some(right))
    }

    /// Fills the unknown values (`None`): each becomes the mean of its neighbors, weighted by their edges, so that it is between the
    /// smallest and the largest known value. Values that no known value is connected to remain unknown.
    ///
    /// # Errors
    /// If the evaluation is cancelled.
    pub fn fill(
        &self,
        values: &mut [Option<[f64; 3]>],
        progress: &Progress<'_>,
    ) -> Result<(), CancelledError> {
        let unknown = self.connected_unknowns(values);
        let mut numbers = vec![u32::MAX; values.len()];
        (0..).zip(&unknown).for_each(|(number, &vertex)| numbers[vertex] = number);
        let mut matrix = Symmetric { starts: vec![0], indices: Vec::new(), entries: Vec::new() };
        let mut right = Vec::with_capacity(unknown.len());
        for (&vertex, number) in unknown.iter().zip(0..) {
            let (mut load, mut sum) = ([0.0; 3], 0.0);
            let own = matrix.indices.len();
            matrix.indices.push(number);
            matrix.entries.push(0.0);
            for &(other, weight) in &self.links[vertex] {
                sum += weight;
                match values[other as usize] {
                    Some(known) => (0..3).for_each(|k| load[k] += weight * known[k]),
                    None => {
                        matrix.indices.push(numbers[other as usize]);
                        matrix.entries.push(-weight);
                    }
                }
            }
            matrix.entries[own] = sum;
            matrix.starts.push(matrix.indices.len() as u32);
            right.push(load);
        }
        let order =
            Dissection::new(Links { starts: &matrix.starts, neighbors: &matrix.indices }, 1);
        if let Some(factors) = Cholesky::with_ordering(&matrix, &order, progress)? {
            factors.solve(&mut right);
            unknown.iter().zip(right).for_each(|(&vertex, value)| values[vertex] = Some(value));
        }
        Ok(())
    }

    /// Returns the vertices without a value that a path of edges connects to a value, ascending.
    fn connected_unknowns(&self, values: &[Option<[f64; 3]>]) -> Vec<usize> {
        let mut is_reached: Vec<bool> = values.iter().map(Option::is_some).collect();
        let mut stack: Vec<usize> =
            (0..values.len()).filter(|&vertex| is_reached[vertex]).collect();
        while let Some(vertex) = stack.pop() {
            for &(other, _) in &self.links[vertex] {
                if !is_reached[other as usize] {
                    is_reached[other as usize] = true;
                    stack.push(other as usize);
                }
            }
        }
        (0..values.len()).filter(|&vertex| is_reached[vertex] && values[vertex].is_none()).collect()
    }
}
