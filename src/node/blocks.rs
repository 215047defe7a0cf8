//! Points in blocks, of which only a part is in memory at a time.

use std::sync::OnceLock;

use maquette_syntax::error::Error;
use maquette_value::Points;

use crate::importers::{ColorRange, NotInBlocks};

/// How a node handles points of which only a part is in memory at a time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Blocks {
    /// The node needs all points at once.
    #[default]
    Whole,
    /// The result of joined points is the joined results of the points: `eval(a + b) = eval(a) + eval(b)`.
    Each,
}

/// The points that [`Context::read`](crate::Context::read) returns to a node that reads a file block by block.
#[derive(Default)]
#[doc(hidden)]
pub struct PointBlock {
    /// The block. `None` in a first call, which only determines the range of colors.
    pub points: Option<Points>,
    /// The range of colors with which the node reads the file; unset before it does.
    pub color_range: OnceLock<Option<ColorRange>>,
}

impl PointBlock {
    /// Records the range of colors, and returns the block.
    pub(crate) fn read(&self, range: Option<ColorRange>) -> Result<&Points, Error> {
        self.color_range.get_or_init(|| range);
        self.points.as_ref().ok_or_else(|| NotInBlocks.into())
    }
}
