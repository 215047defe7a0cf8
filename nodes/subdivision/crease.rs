//! Sets creases at sharp edges.

use maquette_node::{Carry, Context, Error, In, Node, Promise, Transfer};
use maquette_value::Mesh;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::sharp_edges::{crease, largest_angle};

/// Marks the edges of a mesh as creases at which the angle between the faces' normals exceeds a threshold.
///
/// Existing creases keep at least their sharpness.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Crease {
    /// Mesh.
    pub mesh: In<Mesh>,
    /// Minimum angle between the normals of both faces; 0 is flat.
    #[schemars(range(min = 0.0, max = 180.0), extend("unit" = "deg"))]
    #[serde(default = "default_angle")]
    pub angle: f64,
    /// Sharpness of the creases. Each subdivision step subtracts 1; a sharpness of 10 is permanent.
    #[schemars(range(min = 0.0, max = 10.0))]
    #[serde(default = "default_sharpness")]
    pub sharpness: f64,
}

fn default_angle() -> f64 {
    40.0
}

fn default_sharpness() -> f64 {
    10.0
}

impl Node for Crease {
    type Outputs = (Mesh,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];

    const PROMISES: &'static [Promise<Self>] = &Promise::faces_kept("mesh", "mesh");

    const CARRIES: &'static [Carry] = &[Carry::uniform("mesh", "mesh", Transfer::Kept)];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let mesh = cx.get(&self.mesh);
        let visits = VISITS_PER_FACE * mesh.faces().len();
        let creased = cx.progress().metered(visits, || crease(mesh, self.angle, self.sharpness));
        if creased.creases().len() == 0 {
            cx.warn(format!(
                "no edge has an angle of more than {} degrees; the largest is {:.1}",
                self.angle,
                largest_angle(mesh)
            ));
        }
        Ok((creased,))
    }
}

/// The number of times that loops visit the elements around each face; for progress.
const VISITS_PER_FACE: usize = 32;

#[cfg(test)]
mod tests {
    use maquette_value::Faces;
    use nalgebra::Point3;

    use super::*;

    /// Creates a strip of three unit squares. The second square is horizontal; the first and the third are bent down by 30 and 60 degrees.
    fn strip() -> Mesh {
        fn end_points(x: f64, z: f64) -> [Point3<f64>; 2] {
            [Point3::new(x, 0.0, z), Point3::new(x, 1.0, z)]
        }
        fn fold_angles(degrees: f64) -> (f64, f64) {
            libm::sincos(degrees.to_radians())
        }
        let ((s30, c30), (s60, c60)) = (fold_angles(30.0), fold_angles(60.0));
        let columns = [
            end_points(-c30, -s30),
            end_points(0.0, 0.0),
            end_points(1.0, 0.0),
            end_points(1.0 + c60, -s60),
        ];
        let faces = Faces::uniform(4, vec![0, 2, 3, 1, 2, 4, 5, 3, 4, 6, 7, 5]).unwrap();
        Mesh::new(columns.concat(), faces).unwrap()
    }

    fn creases(mesh: &Mesh) -> Vec<([u32; 2], f64)> {
        mesh.creases().collect()
    }

    #[test]
    fn edges_above_the_angle_become_creases() {
        assert_eq!(creases(&crease(&strip(), 61.0, 3.0)), []);
        assert_eq!(creases(&crease(&strip(), 40.0, 3.0)), [([4, 5], 3.0)]);
        assert_eq!(creases(&crease(&strip(), 29.0, 3.0)), [([2, 3], 3.0), ([4, 5], 3.0)]);
    }

    #[test]
    fn existing_creases_keep_at_least_their_sharpness() {
        let mesh = strip().with_creases([([2, 3], 1.0), ([5, 4], 9.0)]).unwrap();
        assert_eq!(creases(&crease(&mesh, 29.0, 3.0)), [([2, 3], 3.0), ([4, 5], 9.0)]);
        assert_eq!(creases(&crease(&mesh, 180.0, 3.0)), [([2, 3], 1.0), ([4, 5], 9.0)]);
    }

    #[test]
    fn a_face_without_area_makes_no_crease() {
        let points = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [2., 0., 0.]].map(Point3::from);
        let mesh = Mesh::new(points.to_vec(), Faces::triangles(vec![[0, 1, 2], [1, 0, 3]]));
        assert_eq!(creases(&crease(&mesh.unwrap(), 0.0, 3.0)), []);
    }
}
