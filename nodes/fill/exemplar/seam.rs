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
    /// The bends of the input mesh's edges that end at the rims, in mm^2.
    usual: f64,
}

impl Seam {
    /// Finds the edges. The fill's vertices have the indices from `data` on.
    pub(super) fn new(
        surface: &Surface<'_>,
        points: &[Point3<f64>],
        data: usize,
        edge: f64,
    ) -> Self {
        let mut at_rim = vec![false; data];
        let (mut seam, mut others) = (Vec::new(), Vec::new());
        for hinge in hinges(surface) {
            let [a, b, c, d] = hinge.map(|corner| data <= corner as usize);
            match (a || b, c, d) {
                (false, true, false) | (false, false, true) => {
                    hinge[..2].iter().for_each(|&end| at_rim[end as usize] = true);
                    seam.push(hinge);
                }
                (false, false, false) => others.push(hinge),
                _ => {}
            }
        }
        others.retain(|hinge| hinge[..2].iter().any(|&end| at_rim[end as usize]));
        Self { usual: mean_bends(&others, edge, points), hinges: seam, edge }
    }

    /// Returns the bends in mm^2 that the seam has in addition to those of the input mesh around it: the mean square of the height by which
    /// a fill, continued straight on for an edge length, leaves the surface at its rim.
    pub(super) fn bends(&self, points: &[Point3<f64>]) -> f64 {
        (mean_bends(&self.hinges, self.edge, points) - self.usual).max(0.0)
    }
}

/// Returns the mean square of the heights at a distance of `edge` from bent edges; 0 without edges.
fn mean_bends(hinges: &[[u32; 4]], edge: f64, points: &[Point3<f64>]) -> f64 {
    let heights = hinges.iter().map(|&hinge| edge * dihedral_angle(hinge, points));
    heights.map(|height| height * height).sum::<f64>() / hinges.len().max(1) as f64
}
