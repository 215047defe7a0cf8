//! Extends creases of the surface around a hole across the hole.

pub(super) mod chart;
pub(super) mod charts;
pub(super) mod segmentation;
pub(super) mod sharpen;
