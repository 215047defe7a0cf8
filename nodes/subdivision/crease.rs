//! Sets creases where a mesh bends.

use maquette_node::{Carry, Context, Error, Fate, In, Node, Promise};
use maquette_value::Mesh;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::sharp_edges::crease;

/// Makes those edges of a mesh sharp at which it bends by more than an angle.
///
/// Creases that are there already stay, at least as sharp as they are.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Crease {
    /// The mesh.
    pub mesh: In<Mesh>,
    /// The angle between the normals of both faces: 0 is flat.
    #[schemars(range(min = 0.0, max = 180.0), extend("unit" = "deg"))]
    #[serde(default = "forty")]
    pub angle: f64,
    /// How sharp the edges become: each step of a subdivision takes 1 off, but 10 stays forever.
    #[schemars(range(min = 0.0, max = 10.0))]
    #[serde(default = "ten")]
    pub sharpness: f64,
}

fn forty() -> f64 {
    40.0
}

fn ten() -> f64 {
    10.0
}

impl Node for Crease {
    type Outputs = (Mesh,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];

    const PROMISES: &'static [Promise<Self>] = &Promise::faces_kept("mesh", "mesh");

    const CARRIES: &'static [Carry] = &[Carry::all("mesh", "mesh", Fate::Kept)];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let mesh = cx.get(&self.mesh);
        let creased = crease(mesh, self.angle, self.sharpness);
        if creased.creases().len() == 0 {
            cx.warn(format!("no edge bends by more than {} degrees", self.angle));
        }
        Ok((creased,))
    }
}

#[cfg(test)]
mod tests {
    use maquette_value::Faces;
    use nalgebra::Point3;

    use super::*;

    /// A strip of three unit squares, the second one level, the others bent down by 30 and by 60 degrees.
    fn strip() -> Mesh {
        fn at(x: f64, z: f64) -> [Point3<f64>; 2] {
            [Point3::new(x, 0.0, z), Point3::new(x, 1.0, z)]
        }
        fn bent(degrees: f64) -> (f64, f64) {
            libm::sincos(degrees.to_radians())
        }
        let ((s30, c30), (s60, c60)) = (bent(30.0), bent(60.0));
        let columns = [at(-c30, -s30), at(0.0, 0.0), at(1.0, 0.0), at(1.0 + c60, -s60)];
        let faces = Faces::uniform(4, vec![0, 2, 3, 1, 2, 4, 5, 3, 4, 6, 7, 5]).unwrap();
        Mesh::new(columns.concat(), faces).unwrap()
    }

    fn creases(mesh: &Mesh) -> Vec<([u32; 2], f64)> {
        mesh.creases().collect()
    }

    #[test]
    fn edges_that_bend_more_than_the_angle_become_sharp() {
        assert_eq!(creases(&crease(&strip(), 61.0, 3.0)), []);
        assert_eq!(creases(&crease(&strip(), 40.0, 3.0)), [([4, 5], 3.0)]);
        assert_eq!(creases(&crease(&strip(), 29.0, 3.0)), [([2, 3], 3.0), ([4, 5], 3.0)]);
    }

    #[test]
    fn creases_that_are_there_stay_at_least_as_sharp() {
        let mesh = strip().with_creases([([2, 3], 1.0), ([5, 4], 9.0)]).unwrap();
        assert_eq!(creases(&crease(&mesh, 29.0, 3.0)), [([2, 3], 3.0), ([4, 5], 9.0)]);
        assert_eq!(creases(&crease(&mesh, 180.0, 3.0)), [([2, 3], 1.0), ([4, 5], 9.0)]);
    }

    #[test]
    fn a_face_without_area_bends_nothing() {
        let points = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [2., 0., 0.]].map(Point3::from);
        let mesh = Mesh::new(points.to_vec(), Faces::triangles(vec![[0, 1, 2], [1, 0, 3]]));
        assert_eq!(creases(&crease(&mesh.unwrap(), 0.0, 3.0)), []);
    }
}
