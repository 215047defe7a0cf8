//! Filters, which compute a value for each pixel from the pixels around it.

pub(super) mod gaussian;
pub(super) mod gradient;
pub(super) mod hysteresis;
pub(super) mod morphology;
pub(super) mod percentile;
