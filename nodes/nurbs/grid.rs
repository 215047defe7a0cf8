//! Regions of a range grid: their cells, triangles and borders, and surfaces that are written back to them.

pub(super) mod canvas;
pub(super) mod continuity;
pub(super) mod disk;
pub(super) mod distance;
pub(super) mod filled_beside;
pub(super) mod fold;
pub(super) mod refine;
pub(super) mod rim_distance;
pub(super) mod seam;
pub(super) mod window;
pub(super) mod within;
