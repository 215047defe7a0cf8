//! The triangulations that fill holes: choosing, changing and storing them.

pub(super) mod density;
pub(super) mod filling;
pub(super) mod large_hole;
pub(super) mod min_weight;
pub(super) mod triangulate;
pub(super) mod triangulation;
