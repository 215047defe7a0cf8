//! What was scanned, as a surface: what lies between its points.

use maquette_value::{Mesh, TriangleTree};
use nalgebra::{Point3, Vector3};

/// A scanned surface.
pub(super) struct Scan<'a> {
    mesh: &'a Mesh,
    tree: TriangleTree,
    /// The area for each of its points.
    area: f64,
}

/// The place of a scan that is nearest to a vertex of another surface.
pub(super) struct Foot {
    pub(super) vertex: u32,
    /// How many points of the scan there would be on the vertex's share of its faces.
    pub(super) weight: f64,
    pub(super) place: Point3<f64>,
    pub(super) distance_sq: f64,
}

impl<'a> Scan<'a> {
    /// None if the mesh has no surface.
    pub(super) fn new(mesh: &'a Mesh) -> Option<Self> {
        let area: f64 = mesh.faces().iter().map(|face| mesh.area_vector(face).norm() / 2.0).sum();
        let area = area / mesh.positions().len() as f64;
        (0.0 < area).then(|| Self { mesh, tree: TriangleTree::new(mesh), area })
    }

    pub(super) fn points(&self) -> &'a [Point3<f64>] {
        self.mesh.positions()
    }

    /// The feet of the vertices of a surface's faces.
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
            let parts =
                found.corners.into_iter().zip(found.shares).map(|(corner, share): (u32, f64)| {
                    self.points()[self.mesh.faces().corners()[corner as usize] as usize].coords
                        * share
                });
            let place = Point3::from(parts.sum::<Vector3<f64>>());
            Some(Foot { vertex, weight, place, distance_sq: found.distance_sq })
        });
        feet.collect()
    }

    /// How far a surface is from it: the sum of the squares, for as many places as there would be points.
    pub(super) fn cost(&self, fine: &Mesh) -> f64 {
        self.feet(fine).iter().map(|foot| foot.weight * foot.distance_sq).sum()
    }
}
