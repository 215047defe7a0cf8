//! What is computed for each pixel from those around it.

pub(super) mod gaussian;
pub(super) mod gradient;
pub(super) mod hysteresis;
pub(super) mod morphology;
pub(super) mod percentile;
