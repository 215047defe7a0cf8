//! Measures how sharply fills bend at the rims of their holes.

use nalgebra::Point3;

use super::dihedral_angles::{dihedral_angle, hinges};
use super::surface::Surface;

/// The edges between faces of fills and faces of the input mesh.
pub(super) struct Seam {
    /// The ends of each edge, followed by the two opposite corners.
    hinges: Vec<[u32; 4]>,
    /// The mean length of the input mesh's edges at the rims.
    edge: f64,
}

impl Seam {
    /// Finds the edges. The fill's vertices have the indices from `data` on.
    pub(super) fn new(surface: &Surface<'_>, data: usize, edge: f64) -> Self {
        let is_at_seam = |&[a, b, c, d]: &[u32; 4]| {
            let [a, b, c, d] = [a, b, c, d].map(|corner| data <= corner as usize);
            !a && !b && c != d
        };
        Self { hinges: hinges(surface).filter(is_at_seam).collect(), edge }
    }

    /// Returns the mean square of the height in mm by which a fill, continued straight on for an edge length, leaves the surface at its
    /// rim.
    pub(super) fn bends(&self, points: &[Point3<f64>]) -> f64 {
        let heights = self.hinges.iter().map(|&hinge| self.edge * dihedral_angle(hinge, points));
        let sum: f64 = heights.map(|height| height * height).sum();
        sum / self.hinges.len().max(1) as f64
    }
}
