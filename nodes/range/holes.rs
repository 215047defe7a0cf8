//! Cells without a point.

pub(super) mod range_holes;
pub(super) mod shadows;
