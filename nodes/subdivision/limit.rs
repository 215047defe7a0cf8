//! Where vertices go if a mesh is refined forever.

pub(super) mod composed;
pub(super) mod dual_limit;
pub(super) mod finer_dual_limit;
pub(super) mod finer_limit;
pub(super) mod limit_rows;
