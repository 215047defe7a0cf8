//! Plain fills: flat, membranes and thin plates.

pub(super) mod fairing;
pub(super) mod fill_plainly;
pub(super) mod plug;
pub(super) mod remesh;
pub(super) mod sizes;
pub(super) mod wanted;
