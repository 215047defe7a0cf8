//! The border of a mesh: finds its rims (boundary loops) and the holes among them, and collects the surface around holes.

pub(super) mod holes;
pub(super) mod manifold_check;
pub(super) mod regions;
pub(super) mod rim;
pub(super) mod rims;
mod split_edges;
pub(super) mod zip;
