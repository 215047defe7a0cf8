//! The scanned surface, and distances to the faces between its points.

use maquette_value::{Mesh, TriangleTree};
use nalgebra::{Point3, Vector3};

/// A scanned surface, prepared for finding the points nearest to other points.
pub(super) struct Scan<'a> {
    mesh: &'a Mesh,
    tree: TriangleTree,
    /// The area of the scan divided by the number of its points.
    area: f64,
}

/// The nearest point of a scan to a vertex of another surface.
pub(super) struct Foot {
    pub(super) vertex: u32,
    /// The weight of the vertex: the vertex's area divided by the scan's area per point.
    pub(super) weight: f64,
    pub(super) position: Point3<f64>,
    pub(super) distance_sq: f64,
}

impl<'a> Scan<'a> {
    /// Creates the scan. Returns `None` if the mesh has no area.
    pub(super) fn new(mesh: &'a Mesh) -> Option<Self> {
        let area: f64 = mesh.faces().iter().map(|face| mesh.area_vector(face).norm() / 2.0).sum();
        let area = area / mesh.positions().len() as f64;
        (0.0 < area).then(|| Self { mesh, tree: TriangleTree::new(mesh), area })
    }

    pub(super) fn points(&self) -> &'a [Point3<f64>] {
        self.mesh.positions()
    }

    /// Finds for each vertex of a surface the nearest point of the scan.
    pub(super) fn feet(&self, fine: &Mesh) -> Vec<Foot> {
        let mut weights = vec![0.0; fine.positions().len()];
        for face in fine.faces().iter() {
            let weight = fine.area_vector(face).norm() / (6.0 * self.area);
            face.iter().for_each(|&vertex| weights[vertex as usize] += weight);
        }
        let weighted = (0..).zip(weights).filter(|(_, weight)| 0.0 < *weight);
        let (vertices, weights): (Vec<u32>, Vec<f64>) = weighted.unzip();
        let points: Vec<Point3<f64>> =
            vertices.iter().map(|&vertex| fine.positions()[vertex as usize]).collect();
        let found = self.tree.nearest_to_all(&points);
        let feet = vertices.into_iter().zip(weights).zip(found).filter_map(|(of, found)| {
            let ((vertex, weight), found) = (of, found?);
            let parts = found.corners.into_iter().zip(found.barycentric).map(
                |(corner, share): (u32, f64)| {
                    self.points()[self.mesh.faces().corners()[corner as usize] as usize].coords
                        * share
                },
            );
            let position = Point3::from(parts.sum::<Vector3<f64>>());
            Some(Foot { vertex, weight, position, distance_sq: found.distance_sq })
        });
        feet.collect()
    }

    /// Returns the weighted sum of the squared distances of a surface's vertices from the scan. The weight of a vertex is proportional to
    /// its area.
    pub(super) fn cost(&self, fine: &Mesh) -> f64 {
        self.feet(fine).iter().map(|foot| foot.weight * foot.distance_sq).sum()
    }
}
