//! Quality measures of a deformation, and the warnings that follow from them.

use maquette_mesh::Movable;
use maquette_node::Context;

use super::object::points;
use crate::gaussian::layout::Bounds;

/// Quality measures of a deformation.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// The condition number of the linear system for the handles' coefficients, estimated in the 1-norm.
    pub condition: f64,
    /// The maximum distance between the deformed position of a handle and its target, in mm.
    pub residual: f64,
    /// Pairs of handles with equal positions and equal targets, which count as one handle. Each pair lists the later handle, then the
    /// earlier one.
    pub merged: Vec<[usize; 2]>,
    /// The number of points at which space is folded over: the determinant of the derivatives is not greater than 0.
    pub folded: usize,
    /// The minimum over all points of the determinant of the derivatives; infinite if the derivatives were not computed.
    pub min_determinant: f64,
}

impl Report {
    pub(crate) fn warn(&self, object: &Movable, frame: Bounds, cx: &Context<'_>) {
        for [later, earlier] in &self.merged {
            cx.warn(format!(
                "handles {earlier} and {later} have the same position and count as one"
            ));
        }
        let diagonal = (frame.1 - frame.0).norm();
        if self.residual > MAX_RESIDUAL * diagonal {
            cx.warn(format!(
                "handles miss their targets by up to {:.2e} mm (condition number {:.1e})",
                self.residual, self.condition
            ));
        }
        if self.folded > 0 {
            let count = points(object).len();
            let marks = if matches!(object, Movable::Mesh(_) | Movable::Points(_)) {
                ", marked by the attribute `folded`"
            } else {
                ""
            };
            cx.warn(format!(
                "space is folded over at {} of {count} points{marks}; the minimum determinant is {:.2e}",
                self.folded, self.min_determinant
            ));
        }
    }
}

/// Maximum distance between the deformed position of a handle and its target that causes no warning, in diagonals of the bounding box.
const MAX_RESIDUAL: f64 = 1e-9;

impl Report {
    /// The report of a deformation that changes nothing.
    pub(crate) const UNCHANGED: Self = Self {
        condition: 1.0,
        residual: 0.0,
        merged: Vec::new(),
        folded: 0,
        min_determinant: f64::INFINITY,
    };
}
