//! What is to be known of a deformation.

use maquette_mesh::Movable;
use maquette_node::Context;

use super::object::points;
use crate::gaussian::layout::Bounds;

/// What is to be known of a deformation.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// The condition of the system that was solved, estimated in the 1-norm.
    pub condition: f64,
    /// The farthest that a handle is from its target, in mm.
    pub residual: f64,
    /// Handles that are at one place and go to one target, and so count as one: the later and the earlier.
    pub merged: Vec<[usize; 2]>,
    /// Points at which space is turned inside out.
    pub folded: usize,
    /// The least determinant of the derivatives at a point; infinite where they were not needed.
    pub least: f64,
}

impl Report {
    pub(crate) fn warn(&self, what: &Movable, frame: Bounds, cx: &Context<'_>) {
        for [later, earlier] in &self.merged {
            cx.warn(format!("handles {earlier} and {later} are at one place and count as one"));
        }
        let diagonal = (frame.1 - frame.0).norm();
        if self.residual > NEAR_ENOUGH * diagonal {
            cx.warn(format!(
                "handles miss their targets by up to {:.2e} mm (condition {:.1e})",
                self.residual, self.condition
            ));
        }
        if self.folded > 0 {
            let count = points(what).len();
            let marks = if matches!(what, Movable::Mesh(_) | Movable::Points(_)) {
                ", marked by the attribute `folded`"
            } else {
                ""
            };
            cx.warn(format!(
                "space is turned inside out at {} of {count} points{marks}; the least determinant is {:.2e}",
                self.folded, self.least
            ));
        }
    }
}

/// From this miss on, in diagonals of the box, a handle is not where somebody put it.
const NEAR_ENOUGH: f64 = 1e-9;

impl Report {
    /// Nothing was done.
    pub(crate) const NOTHING: Self =
        Self { condition: 1.0, residual: 0.0, merged: Vec::new(), folded: 0, least: f64::INFINITY };
}
