//! The distance between neighboring cells of a capture.

use maquette_range::longest_edge;
use maquette_value::RangeImage;
use nalgebra::Point3;

/// The distance between neighboring cells.
pub(super) enum Pitch {
    /// In mm, at a depth of 1 mm.
    PerDepth(f64),
    /// In mm, at any depth: the median distance of neighboring points.
    Constant(f64),
}

impl Pitch {
    pub(super) fn new(range: &RangeImage) -> Self {
        match range.camera() {
            Some(camera) => Self::PerDepth(1.0 / camera.focal[0].min(camera.focal[1])),
            None => Self::Constant(longest_edge(range, 1.0)),
        }
    }

    pub(super) fn at(&self, point: &Point3<f64>) -> f64 {
        match self {
            Self::PerDepth(pitch) => pitch * point.z.abs(),
            Self::Constant(pitch) => *pitch,
        }
    }
}
