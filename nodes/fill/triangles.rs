//! Triangles over holes: how they are chosen, changed and kept beside the data.

pub(super) mod density;
pub(super) mod filling;
pub(super) mod large_hole;
pub(super) mod least_bent;
pub(super) mod patch;
pub(super) mod triangulation;
