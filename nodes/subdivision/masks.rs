//! Masks: what vertices of a refined mesh and their limits are made of, by the rules of each scheme.

pub(super) mod catmull_clark;
pub(super) mod closed_rows;
pub(super) mod loop_masks;
pub(super) mod regular_rules;
pub(super) mod sharpness;
pub(super) mod stars;
pub(super) mod turns;
