//! Finds and removes intersections of filled triangles with the data and with each other.

pub(super) mod boxes;
pub(super) mod damping;
pub(super) mod detect;
pub(super) mod repair;
pub(super) mod resolve;
