//! Deformations of space by rational Gaussian functions.

pub(super) mod cells;
pub(super) mod deformation;
pub(super) mod field;
pub(super) mod gaussians;
pub(super) mod layout;
pub(super) mod system;
