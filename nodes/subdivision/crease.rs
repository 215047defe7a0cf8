//! Sets creases where a mesh bends.

use maquette::value::Mesh;
use maquette::{Context, Error, In, Node};
use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

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

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let mesh = cx.get(&self.mesh);
        let creased = crease(mesh, self.angle, self.sharpness);
        if creased.creases().len() == 0 {
            cx.warn(format!("no edge bends by more than {} degrees", self.angle));
        }
        Ok((creased,))
    }
}

/// Makes the edges of `mesh` sharp whose two faces have normals more than `angle` degrees apart. Edges with another number of
/// faces, or with a face without area, stay as they are.
pub fn crease(mesh: &Mesh, angle: f64, sharpness: f64) -> Mesh {
    let edges = mesh.edges();
    let normals: Vec<Vector3<f64>> =
        mesh.faces().iter().map(|face| mesh.area_vector(face)).collect();
    let mut sums = vec![[Vector3::zeros(); 2]; edges.vertices.len()];
    let mut seen = vec![0u8; edges.vertices.len()];
    for (face, normal) in normals.iter().enumerate() {
        for corner in mesh.faces().first_corner(face)..mesh.faces().first_corner(face + 1) {
            let edge = edges.of_corner[corner] as usize;
            if let Some(side) = sums[edge].get_mut(usize::from(seen[edge])) {
                *side = *normal;
                seen[edge] += 1;
            }
        }
    }
    let limit = angle.to_radians();
    let bends = |edge: &usize| {
        let [a, b] = sums[*edge];
        // Normals of enormous or tiny faces have no cross product; their directions have.
        let unit = |v: Vector3<f64>| v.try_normalize(0.0).unwrap_or_default();
        let (a, b) = (unit(a), unit(b));
        edges.faces[*edge] == 2 && libm::atan2(a.cross(&b).norm(), a.dot(&b)) > limit
    };
    let bent = (0..sums.len()).filter(bends).map(|edge| (edges.vertices[edge], sharpness));
    merged(mesh, bent, f64::max)
}

/// The mesh with more creases; where an edge has one already, `choose` says how sharp it is, from the old and the new sharpness.
pub(super) fn merged(
    mesh: &Mesh,
    more: impl Iterator<Item = ([u32; 2], f64)>,
    choose: fn(f64, f64) -> f64,
) -> Mesh {
    let more = more.map(|([a, b], sharpness)| ([a.min(b), a.max(b)], sharpness));
    let mut creases: Vec<([u32; 2], f64)> = mesh.creases().chain(more).collect();
    creases.sort_by_key(|(ends, _)| *ends);
    let same = creases.chunk_by(|a, b| a.0 == b.0);
    let chosen = same.map(|same| {
        let sharpness = same.iter().map(|crease| crease.1).reduce(choose).unwrap_or_default();
        (same[0].0, sharpness)
    });
    let sharp: Vec<_> = chosen.filter(|(_, sharpness)| *sharpness > 0.0).collect();
    mesh.clone().with_creases(sharp).expect("edges end at vertices of the mesh")
}

#[cfg(test)]
mod tests {
    use maquette::value::Faces;
    use nalgebra::Point3;

    use super::*;

    /// A strip of three unit squares, the second one level, the others bent down by 30 and by 60 degrees.
    fn strip() -> Mesh {
        let at = |x: f64, z: f64| [Point3::new(x, 0.0, z), Point3::new(x, 1.0, z)];
        let bent = |degrees: f64| libm::sincos(degrees.to_radians());
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
