//! The exemplar of a patch.

use super::surface::NONE;

/// The exemplar of a patch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Match {
    /// [`NONE`] if nothing can be compared.
    pub(super) exemplar: u32,
    /// How it is turned.
    pub(super) turn: u8,
    /// The mean of the squared distances.
    pub(super) ssd: f64,
    /// What is added to it where matches are chosen: the same of the colors.
    pub(super) tint: f64,
}

impl Match {
    pub(super) const NOTHING: Self =
        Self { exemplar: NONE, turn: 0, ssd: f64::INFINITY, tint: 0.0 };
}
