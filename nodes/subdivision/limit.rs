//! Limit positions and tangents: the vertices of a mesh after infinitely many refinement steps.

pub(super) mod composed;
pub(super) mod dual_limit;
pub(super) mod finer_dual_limit;
pub(super) mod finer_limit;
pub(super) mod limit_rows;
