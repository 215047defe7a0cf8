//! Fills that copy no other parts of the surface: flat triangles, membranes and thin plates.

pub(super) mod fairing;
pub(super) mod hole_fill;
pub(super) mod options;
pub(super) mod plain_fill;
pub(super) mod plates;
pub(super) mod remesh;
pub(super) mod sizes;
