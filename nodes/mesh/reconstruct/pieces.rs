//! The points of all sources, combined into surface elements.

use super::surfels::{Pyramid, Surfel};
use super::thin::Gap;

/// The points of all sources, combined into surface elements.
pub(super) struct Pieces {
    pub(super) pyramid: Pyramid,
    pub(super) surfels: Vec<Surfel>,
    /// Standard deviation of the points from their surface, in mm.
    pub(super) noise: f64,
    /// Mean spacing of the points, in mm.
    pub(super) distance: f64,
    /// The depth of the cells whose edges are as long as those of the result. The pyramid is finer than the result if the points are.
    pub(super) skin_depth: u32,
    /// Opposite sides near each other, if there are some.
    pub(super) gap: Option<Gap>,
    /// True if the cells are smaller than the points' spacing requires, because there are thin parts.
    pub(super) is_thin: bool,
}
