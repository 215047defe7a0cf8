//! The fill of one hole.

use crate::triangles::triangulation::Triangulation;

/// The reason why a hole is filled with another surface than requested.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Fallback {
    /// The rim is too rough: a thin plate would have gone too far, and a membrane is used instead.
    RoughRim,
    /// No creases end at the rim, or they do not meet: a thin plate is used instead.
    NoCreases,
    /// The fill would have intersected the data, itself or another fill: another surface is used instead.
    Intersection,
}

/// The fill of one hole.
#[derive(Clone)]
pub(crate) struct HoleFill {
    pub(crate) triangulation: Triangulation,
    pub(crate) fallback: Option<Fallback>,
    /// True if creases of the data are extended across the fill.
    pub(crate) is_sharp: bool,
}
