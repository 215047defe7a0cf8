//! The rotations and reflections in which exemplars (patches of the input surface) are compared with patches of the fill.

use super::frame::{Frame, Orientation};

/// The orientations in which exemplars are tried: first those chosen by the options, then those for frames without an upward direction.
pub(super) struct Orientations {
    pub(super) all: Vec<Orientation>,
    pub(super) usual: usize,
}

/// Number of rotations that are tried for frames without an upward direction: those with a normal parallel to the up vector.
const FREE: u32 = 8;

impl Orientations {
    pub(super) fn new(rotations: u32, mirror: bool) -> Self {
        let mut all = Orientation::list(rotations, mirror);
        let usual = all.len();
        all.extend(Orientation::list(FREE, mirror));
        Self { all, usual }
    }

    pub(super) fn get(&self, orientation: u8) -> &Orientation {
        &self.all[usize::from(orientation)]
    }

    /// Returns the range of indices in `all` of the orientations that are tried for a frame.
    pub(super) fn range_for(&self, frame: &Frame) -> std::ops::Range<usize> {
        if frame.is_free { self.usual..self.all.len() } else { 0..self.usual }
    }
}
