//! Creases: how sharp edges are, and what kind of vertex they make.
//!
//! The rules of OpenSubdiv ("Subdivision surfaces", section "Semi-sharp creases"), after DeRose, Kass and Truong, "Subdivision
//! surfaces in character animation" (1998): each step takes 1 off an edge's sharpness; a boundary edge is sharp forever.

use crate::refine::half_edges::{HalfEdges, Ring};
use crate::rules::Rules;
use crate::{Boundary, Creases};

/// Edges at least this sharp stay so.
const FOREVER: f64 = 10.0;

/// How sharp the edges of a mesh are.
pub(crate) struct Sharpness<'a, H> {
    mesh: &'a H,
    rules: Rules<()>,
    /// The creased edges, sorted; a boundary edge is sharp whether it is here or not.
    creases: &'a [(u32, f64)],
    /// The vertices at creases that soften, sorted, with the number of such creases and the sum of their sharpness; only
    /// filled where the rules ask for it.
    softening: Vec<(u32, u32, f64)>,
}

/// What kind of point a vertex is, by the sharp edges that meet there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Class {
    /// None, or one that ends.
    Smooth,
    /// Two: these places of the ring.
    Crease(usize, usize),
    /// More, or held by the boundary rule; it stays where it is.
    Corner,
}

/// How sharp the edges of a ring are, in its order.
#[derive(Default)]
pub(crate) struct Edges {
    /// Before the step.
    pub(crate) before: Vec<f64>,
    /// Those of their halves at the vertex after it.
    pub(crate) after: Vec<f64>,
}

impl<'a, H: HalfEdges> Sharpness<'a, H> {
    pub(crate) fn new<S>(mesh: &'a H, rules: Rules<S>, creases: &'a [(u32, f64)]) -> Self {
        let rules = rules.of_edges();
        let mut softening: Vec<(u32, u32, f64)> = Vec::new();
        if rules.creases == Creases::Chaikin {
            let soft = creases.iter().filter(|&&(edge, sharpness)| {
                sharpness > 0.0 && sharpness < FOREVER && !mesh.is_boundary(edge)
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

    /// An edge's sharpness, from 0 (smooth).
    pub(crate) fn of(&self, edge: u32) -> f64 {
        if self.mesh.is_boundary(edge) {
            return f64::INFINITY;
        }
        match self.creases.binary_search_by_key(&edge, |(edge, _)| *edge) {
            Ok(place) => self.creases[place].1,
            Err(_) => 0.0,
        }
    }

    /// How far the rule of a sharp edge holds for the new vertex on one: wholly, which is 1, if both its halves are still sharp,
    /// else as far as the edge is. By Chaikin's rule that can be a little above 1, as in OpenSubdiv, which does not limit it.
    pub(crate) fn share(&self, edge: u32) -> f64 {
        let sharpness = self.of(edge);
        match sharpness > 0.0
            && self.mesh.ends(edge).into_iter().all(|end: u32| self.softened(end, sharpness) > 0.0)
        {
            true => 1.0,
            false => sharpness,
        }
    }

    /// The sharpness of the half of an edge at one of its ends, after a step.
    fn softened(&self, vertex: u32, sharpness: f64) -> f64 {
        if sharpness >= FOREVER {
            return sharpness;
        }
        let place = self.softening.binary_search_by_key(&vertex, |(vertex, _, _)| *vertex);
        let mean = match place.map(|place| self.softening[place]) {
            Ok((_, count, sum)) if count > 1 && sharpness > 0.0 => {
                0.75 * sharpness + 0.25 * ((sum - sharpness) / f64::from(count - 1))
            }
            _ => sharpness,
        };
        (mean - 1.0).max(0.0)
    }

    /// Fills `edges` with the sharpness of the edges around a vertex.
    pub(crate) fn around(&self, vertex: u32, ring: &Ring, edges: &mut Edges) {
        edges.before.clear();
        edges.before.extend(ring.edges.iter().map(|&edge| self.of(edge)));
        edges.after.clear();
        edges.after.extend(edges.before.iter().map(|&s| self.softened(vertex, s)));
    }

    /// The class of the vertex inside `ring` whose edges are that sharp.
    pub(crate) fn class(&self, ring: &Ring, sharpness: &[f64]) -> Class {
        let held =
            self.rules.boundary == Boundary::EdgeAndCorner && !ring.closed && ring.n_faces() <= 1;
        if held || ring.edges.is_empty() {
            return Class::Corner;
        }
        let mut sharp = (0..sharpness.len()).filter(|&place| sharpness[place] > 0.0);
        match (sharp.next(), sharp.next(), sharp.next()) {
            (Some(first), Some(second), None) => Class::Crease(first, second),
            (_, _, Some(_)) => Class::Corner,
            _ => Class::Smooth,
        }
    }

    /// The creases after one step, in which edge `e` has become the edges `children(e)`, from its owner's start to its end.
    pub(crate) fn refined(&self, children: impl Fn(u32) -> [u32; 2]) -> Vec<(u32, f64)> {
        let halves = self.creases.iter().flat_map(|&(edge, sharpness)| {
            let halves = children(edge).into_iter().zip(self.mesh.ends(edge));
            halves.map(move |(half, end)| (half, self.softened(end, sharpness)))
        });
        let mut refined: Vec<_> = halves.filter(|&(_, sharpness)| sharpness > 0.0).collect();
        refined.sort_unstable_by_key(|(edge, _)| *edge);
        refined
    }
}

impl Edges {
    /// The share of the old class in a vertex whose class changes: the mean sharpness of the edges which the step makes smooth.
    pub(crate) fn share(&self) -> f64 {
        let ending = self.before.iter().zip(&self.after).filter(|(s, t)| **s > 0.0 && **t == 0.0);
        let (sum, count) = ending.fold((0.0, 0.0), |(sum, count), (s, _)| (sum + s, count + 1.0));
        if count > 0.0 { f64::min(sum / count, 1.0) } else { 1.0 }
    }
}
