//! Surfaces through or near the points of a net.

pub(super) mod fit_line;
pub(super) mod fit_net;
