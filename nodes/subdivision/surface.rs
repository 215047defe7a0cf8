//! Evaluation of limit surfaces at any parameter, and closest points on them.

pub(super) mod closest_point_walk;
pub(super) mod dual_surface;
pub(super) mod face_point;
pub(super) mod limit_feet;
pub(super) mod limit_point;
pub(super) mod limit_surface;
pub(super) mod patches;
pub(super) mod piece;
pub(super) mod smooth_quad;
pub(super) mod smooth_triangle;
