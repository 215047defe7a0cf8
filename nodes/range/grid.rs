//! Parts of a range grid: their cells, borders and triangles.

pub(super) mod border;
pub(super) mod contour;
pub(super) mod footprint;
pub(super) mod grid_triangles;
pub(super) mod joins;
