//! Films: pieces of two solids that lie on each other and face each other, so that nothing is between them.

use maquette_value::{Bounds, BoxTree};
use nalgebra::{Point3, Vector3};

use super::cut::Cut;

/// A piece whose height is larger than the tolerance.
struct Piece {
    corners: [Point3<f64>; 3],
    /// The unit normal.
    normal: Vector3<f64>,
}

/// Returns true if pieces of both solids form a film. That happens if faces coincide: then the perturbation leaves thin gaps between the
/// solids, which have to vanish.
pub(super) fn has_film(cut: &Cut<'_>) -> bool {
    let tolerance = cut.tolerance();
    let pieces = |solid: usize| -> Vec<Piece> {
        let own = cut.pieces.iter().filter(|it| cut.solid_of(it.triangle) == solid);
        own.filter_map(|it| Piece::new(it.vertices.map(|vertex| cut.position(vertex)), tolerance))
            .collect()
    };
    let [first, second] = [pieces(0), pieces(1)];
    let boxes = BoxTree::new(second.iter().map(|it| Bounds::from_points(&it.corners)));
    first.iter().any(|piece| {
        let mut is_found = false;
        boxes.visit_overlapping(&Bounds::from_points(&piece.corners), |other| {
            is_found = is_found || piece.lies_on(&second[other as usize], tolerance);
        });
        is_found
    })
}

impl Piece {
    fn new(corners: [Point3<f64>; 3], tolerance: f64) -> Option<Self> {
        let edges = edges(corners).map(|[a, b]| b - a);
        let normal = edges[0].cross(&edges[1]);
        let longest = edges.iter().map(Vector3::norm).fold(0.0, f64::max);
        (tolerance * longest < normal.norm()).then(|| Self { corners, normal: normal.normalize() })
    }

    /// Returns true if two pieces lie on each other, with opposite normals, and more than their borders do.
    fn lies_on(&self, other: &Self, tolerance: f64) -> bool {
        let is_in_plane =
            |at: &Point3<f64>| (at - self.corners[0]).dot(&self.normal).abs() <= tolerance;
        self.normal.dot(&other.normal) < 0.0
            && other.corners.iter().all(is_in_plane)
            && !self.is_separated_from(other, tolerance)
            && !other.is_separated_from(self, tolerance)
    }

    /// Returns true if the line through an edge separates this piece from a piece in the same plane.
    fn is_separated_from(&self, other: &Self, tolerance: f64) -> bool {
        edges(self.corners).into_iter().any(|[a, b]| {
            let outward = (b - a).cross(&self.normal).normalize();
            other.corners.iter().all(|at| -4.0 * tolerance <= (at - a).dot(&outward))
        })
    }
}

fn edges([a, b, c]: [Point3<f64>; 3]) -> [[Point3<f64>; 2]; 3] {
    [[a, b], [b, c], [c, a]]
}
