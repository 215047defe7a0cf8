//! Detection of walls (thin sheets of material): finds what is behind each face of a mesh.

use nalgebra::{Point3, Vector3};

use super::{Mesh, TriangleTree};
use crate::parallel::*;

/// The cosine of 45 degrees. Two faces are the two sides of a wall if the angle between the outward normal of one and the reversed normal
/// of the other is smaller. At a larger angle the two faces meet at an edge, and every body is thin near an edge. So a fin is a wall, but
/// the edge between a body and its flat base is not.
const OPPOSITE: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// The maximum area of a sliver, as a fraction of the area around it. A sliver is a tiny face that was left where two surfaces meet; its
/// normal depends only on rounding. It is ignored if its normal deviates from the normal of its surroundings.
const SLIVER: f64 = 0.01;

/// The thing that is behind a face, found by a ray from the middle of the face against its normal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Backing {
    /// Material: the ray hits the inside of another face, but the two faces are not parallel enough to be the sides of a wall. Also used if
    /// the backing is unknown, because the face has no area or is a sliver whose normal deviates from that of its surroundings.
    Solid,
    /// No material: the ray hits nothing, or hits another face from outside. So the normal of this face points inward.
    Outside,
    /// The other side of a wall, at this distance in mm.
    Wall(f64),
}

impl Mesh {
    /// Determines what is behind each face; `tree` must be the tree of this mesh.
    pub fn backings(&self, tree: &TriangleTree) -> Vec<Backing> {
        let Some((low, high)) = self.bounds() else { return Vec::new() };
        // A ray that begins exactly on a face would hit that face, so the ray begins at this distance behind the face. In a printable mesh
        // no other face is that close.
        let start = 1e-9 * (high - low).norm();
        let mut around = vec![Vector3::zeros(); self.positions().len()];
        for face in self.faces().iter() {
            let area = self.area_vector(face);
            face.iter().for_each(|&vertex| around[vertex as usize] += area);
        }
        let faces = (0..self.faces().len()).into_par_iter();
        faces.map(|face| self.backing(tree, &around, start, face)).collect()
    }

    /// Determines what is behind a face. `around` holds the sum of the area vectors at each vertex, and `start` is the distance from the
    /// face at which the ray begins.
    fn backing(
        &self,
        tree: &TriangleTree,
        around: &[Vector3<f64>],
        start: f64,
        number: usize,
    ) -> Backing {
        let face = self.faces().face(number);
        let Some(out) = self.outward(number).filter(|out| !self.is_sliver(face, out, around))
        else {
            return Backing::Solid;
        };
        let Some(hit) = tree.first_hit(self.first_triangle_center(face) - out * start, -out) else {
            return Backing::Outside;
        };
        let other = self.outward(hit.face as usize).unwrap_or(Vector3::zeros());
        match other.dot(&out) {
            cosine if cosine > 0.0 => Backing::Outside,
            cosine if cosine < -OPPOSITE => Backing::Wall(hit.along + start),
            _ => Backing::Solid,
        }
    }

    /// Returns true if a face is a sliver and its normal `out` deviates from that of its surroundings.
    fn is_sliver(&self, face: &[u32], out: &Vector3<f64>, around: &[Vector3<f64>]) -> bool {
        let around: Vector3<f64> = face.iter().map(|&vertex| around[vertex as usize]).sum();
        self.area_vector(face).norm() < SLIVER * around.norm()
            && out.dot(&around) < OPPOSITE * around.norm()
    }

    /// The middle of the first triangle of a face. Even if the face is not convex, this point is on the face.
    pub fn first_triangle_center(&self, face: &[u32]) -> Point3<f64> {
        let [a, b, c] = [face[0], face[1], face[2]].map(|at| self.positions()[at as usize].coords);
        Point3::from((a + b + c) / 3.0)
    }

    /// The unit normal of a face. `None` if the face has no area.
    fn outward(&self, face: usize) -> Option<Vector3<f64>> {
        self.area_vector(self.faces().face(face)).try_normalize(0.0)
    }
}
