//! What fills a hole.

use crate::fill::triangles::patch::Patch;

/// What was not done as asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Doubt {
    /// A thin plate would have gone too far, and a membrane is there instead.
    Membrane,
    /// No creases end at the rim, or they do not meet.
    NoCreases,
    /// It would have run through something, and another surface is there instead.
    Calm,
}

/// A hole's filling.
#[derive(Clone)]
pub(crate) struct Plug {
    pub(crate) patch: Patch,
    pub(crate) doubt: Option<Doubt>,
    /// Whether creases of the data go on in it.
    pub(crate) is_sharp: bool,
}
