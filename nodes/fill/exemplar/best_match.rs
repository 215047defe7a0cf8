//! The match of a patch: the part of the input surface that is most similar to the patch.

use super::surface::NONE;

/// The match of a patch: the exemplar (a patch of the input surface) that is most similar to it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Match {
    /// The index of the exemplar; [`NONE`] if no exemplar could be compared.
    pub(super) exemplar: u32,
    /// The index of the orientation in which the exemplar matches.
    pub(super) orientation: u8,
    /// The mean of the squared distances between the patch and the exemplar.
    pub(super) ssd: f64,
    /// The mean of the squared color differences between the patch and the exemplar, added to `ssd` when matches are chosen.
    pub(super) tint: f64,
}

impl Match {
    /// The total difference by which matches are compared.
    pub(super) fn difference(&self) -> f64 {
        self.ssd + self.tint
    }

    pub(super) const NOTHING: Self =
        Self { exemplar: NONE, orientation: 0, ssd: f64::INFINITY, tint: 0.0 };
}
