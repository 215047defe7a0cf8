//! Regions of a range grid, and what is written to them.

pub(super) mod canvas;
pub(super) mod disk;
pub(super) mod distance;
pub(super) mod fold;
pub(super) mod refine;
pub(super) mod seam;
pub(super) mod window;
pub(super) mod within;
