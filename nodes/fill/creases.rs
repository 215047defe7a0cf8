//! Creases of the data, which go on over a hole.

pub(super) mod chart;
pub(super) mod charts;
pub(super) mod segmentation;
pub(super) mod sharpen;
