//! Finds and removes intersections of the fill's triangles with the input mesh and with each other.

pub(super) mod boxes;
pub(super) mod damping;
pub(super) mod detect;
pub(super) mod repair;
pub(super) mod resolve;
