//! What lies behind the faces of a mesh.

use nalgebra::{Point3, Vector3};

use super::{Mesh, TriangleTree};
use crate::parallel::*;

/// Two faces are the sides of a wall if they look away from each other, but for such an angle; where they meet at a larger one there is an edge,
/// which is thin at its end whatever is done. The cosine of 45 degrees: so the rim at which a body meets its flat base is no wall, and a fin is.
const OPPOSITE: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// A face with less than this share of the area around it has no say where it stands across all that: such slivers are left where skins meet, and rounding
/// alone tells where they look.
const SLIVER: f64 = 0.01;

/// What lies behind a face, straight in from its middle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Behind {
    /// The inside of another one that is no side of a wall; or nothing can be said, since the face has no area, or is a sliver that stands across the faces around it.
    Solid,
    /// Nothing, or the outside of another one: the face looks inward.
    Outside,
    /// The other side of a wall, at this distance in mm.
    Wall(f64),
}

impl Mesh {
    /// What lies behind each face; `tree` is that of the mesh.
    pub fn behind(&self, tree: &TriangleTree) -> Vec<Behind> {
        let Some((low, high)) = self.bounds() else { return Vec::new() };
        // A ray that begins on a face would meet it. So near to it nothing else lies in a mesh that can be printed.
        let start = 1e-9 * (high - low).norm();
        let mut around = vec![Vector3::zeros(); self.positions().len()];
        for face in self.faces().iter() {
            let area = self.area_vector(face);
            face.iter().for_each(|&vertex| around[vertex as usize] += area);
        }
        let is_sliver = |face: &[u32], out: &Vector3<f64>| {
            let around: Vector3<f64> = face.iter().map(|&vertex| around[vertex as usize]).sum();
            self.area_vector(face).norm() < SLIVER * around.norm()
                && out.dot(&around) < OPPOSITE * around.norm()
        };
        let behind = |number: usize| {
            let face = self.faces().face(number);
            let Some(out) = self.outward(number).filter(|out| !is_sliver(face, out)) else {
                return Behind::Solid;
            };
            let Some(hit) = tree.first_hit(self.first_middle(face) - out * start, -out) else {
                return Behind::Outside;
            };
            let other = self.outward(hit.face as usize).unwrap_or(Vector3::zeros());
            match other.dot(&out) {
                cosine if cosine > 0.0 => Behind::Outside,
                cosine if cosine < -OPPOSITE => Behind::Wall(hit.along + start),
                _ => Behind::Solid,
            }
        };
        (0..self.faces().len()).into_par_iter().map(behind).collect()
    }

    /// The middle of the first triangle of a face: on the face, also where it is not convex.
    pub fn first_middle(&self, face: &[u32]) -> Point3<f64> {
        let [a, b, c] = [face[0], face[1], face[2]].map(|at| self.positions()[at as usize].coords);
        Point3::from((a + b + c) / 3.0)
    }

    fn outward(&self, face: usize) -> Option<Vector3<f64>> {
        self.area_vector(self.faces().face(face)).try_normalize(0.0)
    }
}
