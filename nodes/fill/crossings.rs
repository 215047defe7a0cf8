//! Filled triangles that run through others, and what is done about them.

pub(super) mod boxes;
pub(super) mod calm;
pub(super) mod intersections;
pub(super) mod mend;
pub(super) mod settle;
