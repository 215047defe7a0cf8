//! Creases: the sharpness of edges, and the classes of vertices that follow from it.
//!
//! The rules are those of OpenSubdiv ("Subdivision surfaces", section "Semi-sharp creases"), after DeRose, Kass and Truong, "Subdivision
//! surfaces in character animation" (1998): each step subtracts 1 from an edge's sharpness; a boundary edge is permanently sharp.

use crate::refine::half_edges::{HalfEdges, Ring};
use crate::rules::Rules;
use crate::{Boundary, Creases};

/// Edges with at least this sharpness are permanently sharp.
const PERMANENT: f64 = 10.0;

/// The sharpness of the edges of a mesh.
pub(crate) struct Sharpness<'a, H> {
    mesh: &'a H,
    rules: Rules<()>,
    /// The creases as pairs of edge and sharpness, sorted by edge. Boundary edges are sharp even if they are not listed.
    creases: &'a [(u32, f64)],
    /// The vertices at semi-sharp creases, sorted, each with the number of its semi-sharp creases and the sum of their sharpness. Empty
    /// unless Chaikin's rule is used.
    softening: Vec<(u32, u32, f64)>,
}

/// The class of a vertex, determined by the number of its sharp edges.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Class {
    /// The vertex has no sharp edge, or exactly one, at which a crease ends.
    Smooth,
    /// The vertex has two sharp edges. The numbers are the indices of these edges in the vertex's ring.
    Crease(usize, usize),
    /// The vertex has more than two sharp edges, or the boundary rule makes it a corner. The vertex does not move.
    Corner,
}

/// The sharpness of the edges around a vertex, in the order of the vertex's ring.
#[derive(Default)]
pub(crate) struct Edges {
    /// The sharpness of each edge before a refinement step.
    pub(crate) before: Vec<f64>,
    /// The sharpness that the half of each edge at the vertex has after the refinement step.
    pub(crate) after: Vec<f64>,
}

impl<'a, H: HalfEdges> Sharpness<'a, H> {
    pub(crate) fn new<S>(mesh: &'a H, rules: Rules<S>, creases: &'a [(u32, f64)]) -> Self {
        let rules = rules.of_edges();
        let mut softening: Vec<(u32, u32, f64)> = Vec::new();
        if rules.creases == Creases::Chaikin {
            let soft = creases.iter().filter(|&&(edge, sharpness)| {
                sharpness > 0.0 && sharpness < PERMANENT && !mesh.is_boundary(edge)
            });
            let ends = soft.flat_map(|&(edge, sharpness)| mesh.ends(edge).map(|v| (v, sharpness)));
            let mut ends: Vec<(u32, f64)> = ends.collect();
            ends.sort_by_key(|(vertex, _)| *vertex);
            let groups = ends.chunk_by(|a, b| a.0 == b.0);
            softening = groups
                .map(|group| (group[0].0, group.len() as u32, group.iter().map(|end| end.1).sum()))
                .collect();
        }
        Self { mesh, rules, creases, softening }
    }

    /// Returns the sharpness of an edge; 0 means smooth.
    pub(crate) fn edge_sharpness(&self, edge: u32) -> f64 {
        if self.mesh.is_boundary(edge) {
            return f64::INFINITY;
        }
        match self.creases.binary_search_by_key(&edge, |(edge, _)| *edge) {
            Ok(index) => self.creases[index].1,
            Err(_) => 0.0,
        }
    }

    /// Returns the weight of the crease rule for the new vertex on an edge: 1 if both halves of the edge are still sharp after the step,
    /// else the sharpness of the edge. With Chaikin's rule the weight can be slightly greater than 1; OpenSubdiv does not clamp it either.
    pub(crate) fn crease_weight(&self, edge: u32) -> f64 {
        let sharpness = self.edge_sharpness(edge);
        match sharpness > 0.0
            && self.mesh.ends(edge).into_iter().all(|end: u32| self.soften(end, sharpness) > 0.0)
        {
            true => 1.0,
            false => sharpness,
        }
    }

    /// Returns the sharpness that the half of an edge at `vertex` has after a step. `sharpness` is that of the edge.
    fn soften(&self, vertex: u32, sharpness: f64) -> f64 {
        if sharpness >= PERMANENT {
            return sharpness;
        }
        let index = self.softening.binary_search_by_key(&vertex, |(vertex, _, _)| *vertex);
        let mean = match index.map(|index| self.softening[index]) {
            Ok((_, count, sum)) if count > 1 && sharpness > 0.0 => {
                0.75 * sharpness + 0.25 * ((sum - sharpness) / f64::from(count - 1))
            }
            _ => sharpness,
        };
        (mean - 1.0).max(0.0)
    }

    /// Fills `edges` with the sharpness of the edges around a vertex.
    pub(crate) fn collect_around(&self, vertex: u32, ring: &Ring, edges: &mut Edges) {
        edges.before.clear();
        edges.before.extend(ring.edges.iter().map(|&edge| self.edge_sharpness(edge)));
        edges.after.clear();
        edges.after.extend(edges.before.iter().map(|&s| self.soften(vertex, s)));
    }

    /// Returns the class of the vertex at the center of `ring`; `sharpness` has one value per edge of the ring.
    pub(crate) fn class(&self, ring: &Ring, sharpness: &[f64]) -> Class {
        let held =
            self.rules.boundary == Boundary::EdgeAndCorner && !ring.closed && ring.n_faces() <= 1;
        if held || ring.edges.is_empty() {
            return Class::Corner;
        }
        let mut sharp = (0..sharpness.len()).filter(|&index| sharpness[index] > 0.0);
        match (sharp.next(), sharp.next(), sharp.next()) {
            (Some(first), Some(second), None) => Class::Crease(first, second),
            (_, _, Some(_)) => Class::Corner,
            _ => Class::Smooth,
        }
    }

    /// Returns the creases after one step. `children(e)` returns the two halves of edge `e`, first the half at the start of the edge's
    /// owner (its first half-edge).
    pub(crate) fn refine(&self, children: impl Fn(u32) -> [u32; 2]) -> Vec<(u32, f64)> {
        let halves = self.creases.iter().flat_map(|&(edge, sharpness)| {
            let halves = children(edge).into_iter().zip(self.mesh.ends(edge));
            halves.map(move |(half, end)| (half, self.soften(end, sharpness)))
        });
        let mut refined: Vec<_> = halves.filter(|&(_, sharpness)| sharpness > 0.0).collect();
        refined.sort_unstable_by_key(|(edge, _)| *edge);
        refined
    }
}

impl Edges {
    /// For a vertex whose class changes in a refinement step, the results of both classes are blended. Returns the weight of the old class:
    /// the mean sharpness of the edges that become smooth in the step.
    pub(crate) fn old_class_weight(&self) -> f64 {
        let ending = self.before.iter().zip(&self.after).filter(|(s, t)| **s > 0.0 && **t == 0.0);
        let (sum, count) = ending.fold((0.0, 0.0), |(sum, count), (s, _)| (sum + s, count + 1.0));
        if count > 0.0 { f64::min(sum / count, 1.0) } else { 1.0 }
    }
}
