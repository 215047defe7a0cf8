//! Triangulations of holes: how they are chosen, changed and kept beside the data.

pub(super) mod density;
pub(super) mod filling;
pub(super) mod large_hole;
pub(super) mod min_weight;
pub(super) mod triangulate;
pub(super) mod triangulation;
