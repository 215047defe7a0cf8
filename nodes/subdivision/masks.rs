//! Masks: the weights of old vertices in refined vertices and in limit points, for each scheme.

pub(super) mod catmull_clark;
pub(super) mod closed_rows;
pub(super) mod loop_masks;
pub(super) mod regular_rules;
pub(super) mod roots_of_unity;
pub(super) mod sharpness;
pub(super) mod vertex_rings;
