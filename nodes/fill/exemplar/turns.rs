//! The rotations and reflections in which exemplars are tried.

use super::frame::{Frame, Turn};

/// The rotations and reflections in which exemplars are tried: first the usual ones, then those for frames without a direction.
pub(super) struct Turns {
    pub(super) all: Vec<Turn>,
    pub(super) usual: usize,
}

/// Rotations that are tried where frames have no direction.
const FREE: u32 = 8;

impl Turns {
    pub(super) fn new(rotations: u32, mirror: bool) -> Self {
        let mut all = Turn::all(rotations, mirror);
        let usual = all.len();
        all.extend(Turn::all(FREE, mirror));
        Self { all, usual }
    }

    pub(super) fn of(&self, turn: u8) -> &Turn {
        &self.all[usize::from(turn)]
    }

    /// Those that are tried for a frame.
    pub(super) fn tried(&self, frame: &Frame) -> std::ops::Range<usize> {
        if frame.free { self.usual..self.all.len() } else { 0..self.usual }
    }
}
