//! What fills one hole.

use crate::triangles::triangulation::Triangulation;

/// Why a hole has another surface than was asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Fallback {
    /// The rim is too rough: a thin plate would have gone too far, and a membrane is there instead.
    RoughRim,
    /// No creases end at the rim, or they do not meet: a thin plate is there instead.
    NoCreases,
    /// It would have intersected the data, itself or what fills another hole, and another surface is there instead.
    Intersection,
}

/// What fills one hole.
#[derive(Clone)]
pub(crate) struct HoleFill {
    pub(crate) triangulation: Triangulation,
    pub(crate) fallback: Option<Fallback>,
    /// Whether creases of the data are extended across it.
    pub(crate) is_sharp: bool,
}
