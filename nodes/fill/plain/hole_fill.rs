//! The fill of one hole, and the reason if it is another surface than requested.

use crate::triangles::triangulation::Triangulation;

/// The reason why a hole is filled with another surface than requested.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Fallback {
    /// The rim is too rough: a thin plate would have extended too far from it, and a membrane is used instead.
    RoughRim,
    /// No creases of the surrounding surface end at the rim, or they do not meet: a thin plate is used instead.
    NoCreases,
    /// The fill would have intersected the input mesh, itself or another fill: another surface is used instead.
    Intersection,
}

/// The fill of one hole. `fallback` is the reason if its surface is not the requested one.
#[derive(Clone)]
pub(crate) struct HoleFill {
    pub(crate) triangulation: Triangulation,
    pub(crate) fallback: Option<Fallback>,
    /// True if creases of the surrounding surface are extended across the fill.
    pub(crate) is_sharp: bool,
    /// For each vertex of the triangulation, true if it is beside a crease on a relief, whose shapes may be copied to it. Empty if no
    /// vertex is.
    pub(crate) is_relief: Vec<bool>,
}

impl HoleFill {
    /// Returns, for each vertex that the fill adds, whether it must stay on the surface that creases are extended on.
    pub(crate) fn sharp_vertices(&self, rim: usize) -> Vec<bool> {
        let (_, kept) = self.triangulation.compact();
        let is_relief = |&vertex: &u32| self.is_relief.get(vertex as usize) == Some(&true);
        kept[rim..].iter().map(|vertex| self.is_sharp && !is_relief(vertex)).collect()
    }
}
