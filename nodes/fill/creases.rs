//! Extends creases of the data across a hole.

pub(super) mod chart;
pub(super) mod charts;
pub(super) mod segmentation;
pub(super) mod sharpen;
