//! Creases: how sharp edges are, and what kind of vertex they make.
//!
//! The rules of OpenSubdiv ("Subdivision surfaces", section "Semi-sharp creases", uniform method), after DeRose, Kass and
//! Truong, "Subdivision surfaces in character animation" (1998): each step takes 1 off an edge's sharpness; a boundary edge
//! is sharp forever.

use super::Boundary;
use super::connectivity::{Connectivity, Ring};
use super::plan::Topology;

/// Edges at least this sharp stay so.
const FOREVER: f64 = 10.0;

/// How sharp the edges of a mesh are.
pub(super) struct Sharpness<'a> {
    mesh: &'a Connectivity<'a>,
    boundary: Boundary,
    /// By edge, without the boundary; empty if the mesh has no creases.
    creases: Vec<f64>,
}

/// What kind of point a vertex is, by the sharp edges that meet there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Class {
    /// None, or one that ends.
    Smooth,
    /// Two: these places of the ring.
    Crease(usize, usize),
    /// More, or held by the boundary rule; it stays where it is.
    Corner,
}

impl<'a> Sharpness<'a> {
    pub(super) fn new(topology: &Topology, mesh: &'a Connectivity<'a>) -> Self {
        let known = &topology.creases;
        let find = |ends: &[u32; 2]| match known.binary_search_by_key(ends, |(ends, _)| *ends) {
            Ok(crease) => known[crease].1,
            Err(_) => 0.0,
        };
        let creases = if known.is_empty() {
            vec![]
        } else {
            mesh.edges().vertices.iter().map(find).collect()
        };
        Self { mesh, boundary: topology.boundary, creases }
    }

    /// An edge's sharpness, from 0 (smooth).
    pub(super) fn of(&self, edge: u32) -> f64 {
        if self.mesh.is_boundary(edge) {
            f64::INFINITY
        } else {
            self.creases.get(edge as usize).copied().unwrap_or(0.0)
        }
    }

    /// The class of the vertex inside `ring`, before or after a step.
    pub(super) fn class(&self, ring: &Ring, after: bool) -> Class {
        let held = self.boundary == Boundary::EdgeAndCorner && !ring.closed && ring.n_faces() <= 1;
        if held || ring.edges.is_empty() {
            return Class::Corner;
        }
        let mut sharp = self.sharp(ring, after);
        match (sharp.next(), sharp.next(), sharp.next()) {
            (Some(first), Some(second), None) => Class::Crease(first, second),
            (_, _, Some(_)) => Class::Corner,
            _ => Class::Smooth,
        }
    }

    /// The places of the sharp edges in `ring`, before or after a step.
    pub(super) fn sharp(&self, ring: &Ring, after: bool) -> impl Iterator<Item = usize> {
        ring.edges.iter().enumerate().filter_map(move |(place, &edge)| {
            let sharpness = self.of(edge);
            (if after { softened(sharpness) } else { sharpness } > 0.0).then_some(place)
        })
    }

    /// The share of the old class in a vertex whose class changes: the mean sharpness of the edges which the step makes smooth.
    pub(super) fn share(&self, ring: &Ring) -> f64 {
        let sharpness = ring.edges.iter().map(|&edge| self.of(edge));
        let ending = sharpness.filter(|&sharpness| sharpness > 0.0 && softened(sharpness) == 0.0);
        let (sum, count) = ending.fold((0.0, 0.0), |(sum, count), s| (sum + s, count + 1.0));
        if count > 0.0 { f64::min(sum / count, 1.0) } else { 1.0 }
    }

    /// The creases after one step, in which the midpoint of edge `e` is the vertex `first_midpoint + e`.
    pub(super) fn refined(&self, first_midpoint: u32) -> Vec<([u32; 2], f64)> {
        let edges = (first_midpoint..).zip(&self.mesh.edges().vertices).zip(&self.creases);
        let mut refined: Vec<_> = edges
            .filter(|(_, sharpness)| softened(**sharpness) > 0.0)
            .flat_map(|((midpoint, ends), &sharpness)| {
                ends.map(|end| ([end, midpoint], softened(sharpness)))
            })
            .collect();
        refined.sort_by_key(|(ends, _)| *ends);
        refined
    }
}

/// The sharpness of an edge's halves.
fn softened(sharpness: f64) -> f64 {
    if sharpness >= FOREVER { sharpness } else { (sharpness - 1.0).max(0.0) }
}
