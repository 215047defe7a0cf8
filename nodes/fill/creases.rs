//! Extends creases of the surface around a hole across the hole: as curves, or as intersections of surfaces.

pub(super) mod chart;
pub(super) mod charts;
mod curves;
pub(super) mod divide;
mod ends;
mod pairing;
mod round_chart;
pub(super) mod segmentation;
pub(super) mod sharpen;
