//! Limit surfaces at any place, and the places that are nearest to points.

pub(super) mod downhill;
pub(super) mod dual_surface;
pub(super) mod face_point;
pub(super) mod limit_feet;
pub(super) mod limit_point;
pub(super) mod limit_surface;
pub(super) mod patches;
pub(super) mod piece;
pub(super) mod smooth_quad;
pub(super) mod smooth_triangle;
