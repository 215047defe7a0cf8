//! What fills a hole.

use super::patch::Patch;

/// What was not done as asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Doubt {
    /// A thin plate would have gone too far, and a membrane is there instead.
    Membrane,
    /// No creases end at the rim, or they do not meet.
    NoCreases,
    /// It would have run through something, and another surface is there instead.
    Calm,
}

/// A hole's filling.
#[derive(Clone)]
pub(super) struct Plug {
    pub(super) patch: Patch,
    pub(super) doubt: Option<Doubt>,
    /// Whether creases of the data go on in it.
    pub(super) is_sharp: bool,
}
