//! Surfaces that pass through the points of a net, or near them.

pub(super) mod fit_line;
pub(super) mod fit_net;
