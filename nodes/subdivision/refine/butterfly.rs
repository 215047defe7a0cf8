//! One step of the modified butterfly scheme, which interpolates: the old vertices keep their bits, and a new vertex is made on each edge.
//!
//! Zorin, Schroeder and Sweldens, "Interpolating subdivision for meshes with arbitrary topology" (1996). At an edge between regular
//! vertices the weights are those of Dyn, Levin and Gregory, "A butterfly subdivision scheme for surface interpolation with tension
//! control" (1990): 1/2 for the ends, 1/8 for the opposite vertices of both triangles, -1/16 for the four vertices beyond. An end with
//! another number of neighbors than 6 has its own weights, and two such ends are averaged.
//!
//! A border or crease is a curve of its own, by the four-point rule of Dyn, Levin and Gregory, "A 4-point interpolatory subdivision scheme
//! for curve design" (1987). The weights of a smooth edge do not reach across a border or crease: the vertex beyond is replaced by the
//! reflection of the vertex on this side.

use std::f64::consts::PI;

use maquette_base::linear::stencils::{Rows, Stencils, push_merged};
use maquette_base::linear::weighted_mean::WeightedMean;
use maquette_node::Error;
use maquette_value::Faces;
use maquette_value::parallel::*;
use nalgebra::Point3;

use super::connectivity::Connectivity;
use super::half_edges::{HalfEdges, NONE, Ring};
use super::level::{check_triangles, creases};
use super::primal::{carry_on_edges, carry_triangle_corners, refined_creases};
use super::split::{Triangles, split_faces, split_halves};
use super::topology::Topology;
use crate::masks::sharpness::{Class, Edges, Sharpness};
use crate::rules::Rules;

/// A step of the modified butterfly scheme for a fixed topology.
#[derive(Debug)]
pub(crate) struct Butterfly {
    rules: Rules,
    /// The mesh that this step refines.
    mesh: Connectivity,
    /// The sharp edges with their sharpness, sorted by edge, including border edges.
    creases: Vec<(u32, f64)>,
    /// The new vertex on each edge as a weighted sum of old vertices.
    stencils: Stencils,
    /// The faces of the mesh after this refinement step.
    pub(crate) finer: Faces,
}

impl Butterfly {
    /// Computes the first step of a subdivision.
    ///
    /// # Errors
    /// If a face is not a triangle, or the mesh is not manifold.
    pub(crate) fn from_topology(topology: &Topology) -> Result<Self, Error> {
        check_triangles(&topology.faces, "the butterfly scheme")?;
        let (mesh, _) = Connectivity::new(&topology.faces, topology.vertices)?;
        let creases = creases(topology, &mesh);
        Ok(Self::new(topology.rules, mesh, creases))
    }

    fn new(rules: Rules, mesh: Connectivity, creases: Vec<(u32, f64)>) -> Self {
        let sharpness = Sharpness::new(&mesh, rules, &creases);
        let masks = EdgeMasks { mesh: &mesh, sharpness: &sharpness };
        let (stencils, _) =
            Stencils::build(mesh.halves.len(), |scratch: &mut Scratch, edge, rows| {
                masks.write(edge as u32, scratch, rows);
            });
        let finer = split_faces(&mesh, Triangles);
        Self { rules, mesh, creases, stencils, finer }
    }

    /// Computes the step that follows this one.
    pub(crate) fn next(&self) -> Self {
        let (mesh, children) = split_halves(&self.mesh, self.finer.clone(), Triangles);
        let sharpness = Sharpness::new(&self.mesh, self.rules, &self.creases);
        let creases = sharpness.refine(|edge| children[edge as usize]);
        Self::new(self.rules, mesh, creases)
    }

    /// Returns the creases of the refined mesh, sorted by their vertices.
    pub(crate) fn finer_creases(&self) -> Vec<([u32; 2], f64)> {
        refined_creases(&self.mesh, self.rules, &self.creases)
    }

    /// Computes the positions of all vertices after this step, given the positions `old` before the step.
    pub(crate) fn positions(&self, old: &[Point3<f64>]) -> Vec<Point3<f64>> {
        let mut new = Vec::with_capacity(old.len() + self.stencils.len());
        new.extend_from_slice(old);
        let rows = (0..self.stencils.len()).into_par_iter().with_min_len(4096);
        rows.map(|row| self.stencils.point(row, |column| old[column as usize]))
            .collect_into(&mut new);
        new
    }

    /// Refines vertex data, linearly along old edges.
    pub(crate) fn carry_vertices<T: WeightedMean>(&self, old: &[T]) -> Vec<T> {
        let mut new = Vec::with_capacity(old.len() + self.mesh.halves.len());
        new.extend_from_slice(old);
        carry_on_edges(&self.mesh, old, &mut new);
        new
    }

    /// Refines corner data, linearly within old faces.
    pub(crate) fn carry_corners<T: WeightedMean>(&self, old: &[T]) -> Vec<T> {
        carry_triangle_corners(old)
    }

    /// Returns, for each new face, the index of the old face from which it was made.
    pub(crate) fn parents(&self) -> Vec<u32> {
        (0..self.finer.len() as u32).map(|face| face / 4).collect()
    }

    /// Returns the memory that this value uses, in bytes.
    pub(crate) fn size(&self) -> usize {
        let lists = self.creases.len() * 16 + self.stencils.size();
        self.mesh.size() + self.finer.corners().size() + lists
    }
}

/// Computes the weights of the new vertices on the edges of a triangle mesh.
struct EdgeMasks<'a> {
    mesh: &'a Connectivity,
    sharpness: &'a Sharpness<'a, Connectivity>,
}

/// Scratch space for one edge.
#[derive(Default)]
struct Scratch {
    ring: Ring,
    edges: Edges,
    row: Vec<(u32, f64)>,
}

impl EdgeMasks<'_> {
    fn write(&self, edge: u32, scratch: &mut Scratch, rows: &mut Rows) {
        scratch.row.clear();
        let sharp = self.sharpness.crease_weight(edge).min(1.0);
        if sharp > 0.0 {
            self.add_crease(edge, sharp, scratch);
        }
        if sharp < 1.0 {
            self.add_smooth(edge, 1.0 - sharp, scratch);
        }
        push_merged(rows, &mut scratch.row);
        rows.end();
    }

    /// Adds `share` times the mask of an edge on a border or crease. Where the curve ends, the vertex beyond is that of the parabola
    /// through the last three vertices.
    fn add_crease(&self, edge: u32, share: f64, scratch: &mut Scratch) {
        let [a, b] = self.mesh.ends(edge);
        let [owner, _] = self.mesh.halves[edge as usize];
        let before = self.crease_neighbor(edge, a, owner, scratch);
        let after = self.crease_neighbor(edge, b, self.mesh.next(owner), scratch);
        let mask = match (before, after) {
            (Some(p), Some(q)) => [(p, -0.0625), (a, 0.5625), (b, 0.5625), (q, -0.0625)],
            (Some(p), None) => [(p, -0.125), (a, 0.75), (b, 0.375), (b, 0.0)],
            (None, Some(q)) => [(a, 0.0), (a, 0.375), (b, 0.75), (q, -0.125)],
            (None, None) => [(a, 0.25), (a, 0.25), (b, 0.25), (b, 0.25)],
        };
        scratch.row.extend(mask.map(|(vertex, weight)| (vertex, weight * share)));
    }

    /// Returns the next vertex of a border or crease beyond `vertex`, an end of its edge `edge`; `None` if the curve ends at `vertex`.
    /// `half` starts at `vertex`.
    fn crease_neighbor(
        &self,
        edge: u32,
        vertex: u32,
        half: u32,
        Scratch { ring, edges, .. }: &mut Scratch,
    ) -> Option<u32> {
        self.mesh.ring(self.mesh.clockwise_most(half), ring);
        self.sharpness.collect_around(vertex, ring, edges);
        let Class::Crease(first, second) = self.sharpness.class(ring, &edges.before) else {
            return None;
        };
        let other = if ring.edges[first] == edge { second } else { first };
        Some(ring.neighbors[other])
    }

    /// Adds `share` times the mask of an edge inside the surface.
    fn add_smooth(&self, edge: u32, share: f64, scratch: &mut Scratch) {
        let halves = self.mesh.halves[edge as usize];
        let is_extraordinary = halves.map(|half| self.is_extraordinary(half, &mut scratch.ring));
        let count = is_extraordinary.iter().filter(|&&is| is).count();
        for (half, _) in halves.into_iter().zip(is_extraordinary).filter(|(_, is)| *is) {
            self.add_extraordinary(half, share / count as f64, scratch);
        }
        if count == 0 {
            halves.into_iter().for_each(|half| self.add_half(half, share, &mut scratch.row));
        }
    }

    /// Returns true if the vertex at the start of a half-edge is inside a smooth part of the surface, or at the end of a single crease, and
    /// does not have 6 neighbors.
    fn is_extraordinary(&self, half: u32, ring: &mut Ring) -> bool {
        self.mesh.ring(half, ring);
        let sharp = ring.edges.iter().filter(|&&edge| self.sharpness.edge_sharpness(edge) > 0.0);
        ring.closed && ring.edges.len() != 6 && sharp.count() < 2
    }

    /// Adds `share` times the mask of an extraordinary end of an edge; `half` starts at this end.
    fn add_extraordinary(&self, half: u32, share: f64, Scratch { ring, row, .. }: &mut Scratch) {
        self.mesh.ring(half, ring);
        let count = ring.neighbors.len();
        row.push((self.mesh.corners()[half as usize], 0.75 * share));
        let neighbors = ring.neighbors.iter().enumerate();
        row.extend(neighbors.map(|(j, &neighbor)| (neighbor, extraordinary(j, count) * share)));
    }

    /// Adds `share` times the half of the mask between regular ends that belongs to the triangle of a half-edge.
    fn add_half(&self, half: u32, share: f64, row: &mut Vec<(u32, f64)>) {
        let mesh = self.mesh;
        let start = |half: u32| mesh.corners()[half as usize];
        let [next, previous] = [mesh.next(half), mesh.previous(half)];
        row.push((start(half), 0.5 * share));
        row.push((start(previous), 0.125 * share));
        for side in [next, previous] {
            let twin = mesh.twin(side);
            let beyond = -0.0625 * share;
            if twin != NONE && self.sharpness.edge_sharpness(mesh.edge_of(side)) <= 0.0 {
                row.push((start(mesh.previous(twin)), beyond));
            } else {
                row.push((start(side), beyond));
                row.push((start(mesh.next(side)), beyond));
                row.push((start(mesh.previous(side)), -beyond));
            }
        }
    }
}

/// The weight of the `j`-th of `count` neighbors of an extraordinary vertex in the new vertex on the edge to neighbor 0. The vertex itself
/// has the weight 3/4.
fn extraordinary(j: usize, count: usize) -> f64 {
    match (count, j) {
        (0..=2, 0) => 0.25,
        (0..=2, _) => 0.0,
        (3, 0) => 5.0 / 12.0,
        (3, _) => -1.0 / 12.0,
        (4, 0) => 0.375,
        (4, 2) => -0.125,
        (4, _) => 0.0,
        _ => {
            let angle = 2.0 * PI * j as f64 / count as f64;
            (0.25 + libm::cos(angle) + 0.5 * libm::cos(2.0 * angle)) / count as f64
        }
    }
}
