//! Intersections of filled triangles with others and each other: how they are found, and how they are removed.

pub(super) mod boxes;
pub(super) mod damping;
pub(super) mod detect;
pub(super) mod repair;
pub(super) mod resolve;
