//! Parts of a range grid: the cells that a part of a picture covers, and the borders and triangles of cells.

pub(super) mod border;
pub(super) mod closed_line;
pub(super) mod contour;
pub(super) mod depth_steps;
pub(super) mod footprint;
pub(super) mod grid_triangles;
pub(super) mod joins;
pub(super) mod rim;
pub(super) mod terraces;
