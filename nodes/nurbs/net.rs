//! Control nets over a region.

pub(super) mod harmonic;
pub(super) mod mean_value;
pub(super) mod parameterized;
pub(super) mod polar;
pub(super) mod profile;
pub(super) mod rays;
pub(super) mod round;
pub(super) mod rows;
pub(super) mod sink;
