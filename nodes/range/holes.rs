//! Cells of a range grid without a point, and how they get one.

pub(super) mod range_holes;
pub(super) mod shadows;
