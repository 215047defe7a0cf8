//! Solvers for the control points of interpolating meshes, curves and surfaces.

pub(super) mod blocks;
pub(super) mod conjugate_gradients;
pub(super) mod control_curve;
pub(super) mod control_points;
pub(super) mod extent;
pub(super) mod geometric;
pub(super) mod interpolation;
pub(super) mod least_squares;
pub(super) mod limit_matrix;
pub(super) mod record;
pub(super) mod self_crossings;
pub(super) mod solution;
