//! What has moved between two meshes.

use std::ops::Range;

use super::{Attribute, Mesh};
use crate::{Encoder, Hash};

/// Where a mesh differs from one before, in rows that are in order and apart from each other.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Moved {
    /// The vertices whose places have other bits.
    pub vertices: Vec<Range<u32>>,
    /// The vertices whose attribute `normal` has; none if both meshes have no such vectors.
    pub normals: Vec<Range<u32>>,
}

impl Mesh {
    /// Where vertices and their normals are others than those of a mesh `before`; none if anything else differs, too, but for picture and
    /// frame.
    pub fn moved_since(&self, before: &Self) -> Option<Moved> {
        if self.fixed() != before.fixed() {
            return None;
        }
        let normals = match [self, before].map(|mesh| mesh.vertex.get("normal")) {
            [None, None] => Vec::new(),
            [Some(Attribute::Vector(now)), Some(Attribute::Vector(before))] => {
                now.changed(before)?
            }
            _ => return None,
        };
        Some(Moved { vertices: self.positions.changed(&before.positions)?, normals })
    }

    /// The hash of what stays when vertices move.
    fn fixed(&self) -> Hash {
        let mut vertex = self.vertex.clone();
        vertex.remove("normal");
        Encoder::hash("", |to| {
            self.faces.encode(to);
            [&vertex, &self.corner, &self.face].iter().for_each(|all| all.encode(to));
            to.column(&self.creases);
        })
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::super::{Faces, MeshError};
    use super::*;

    #[test]
    fn what_moved_is_found_if_all_else_is_the_same() {
        fn at(x: f64, y: f64) -> Point3<f64> {
            Point3::new(x, y, 0.0)
        }
        let places = vec![at(0., 0.), at(1., 0.), at(1., 1.), at(0., 1.)];
        let mesh = Mesh::new(places, Faces::triangles(vec![[0, 1, 2], [0, 2, 3]])).unwrap();
        let moved = mesh.with_moved(&[1..2, 3..4], &[at(1., -0.), at(5., 1.)]).unwrap();
        let by = mesh.with_moved_by(&[1..2, 3..4], |piece, to| {
            piece.zip(to).for_each(|(vertex, to)| *to = moved.positions()[vertex as usize]);
        });
        assert_eq!(by.map(|by| by.positions().clone()), Ok(moved.positions().clone()));
        let refused =
            mesh.with_moved_by(&[1..2, 2..4], |piece: Range<u32>, to: &mut [Point3<f64>]| {
                piece
                    .zip(to)
                    .filter(|(vertex, _)| *vertex == 3)
                    .for_each(|(_, to)| to.y = f64::NAN);
            });
        assert_eq!(refused.map(|_| ()), Err(MeshError::NotFinite { vertex: 3 }));
        let expected = Moved { vertices: vec![1..2, 3..4], normals: vec![] };
        assert_eq!(moved.moved_since(&mesh), Some(expected.clone()));
        assert_eq!(mesh.moved_since(&mesh), Some(Moved::default()));

        fn with_normals(mesh: &Mesh, last: f64) -> Mesh {
            let normals = vec![[0., 0., 1.], [0., 0., 1.], [0., 0., 1.], [0., 0., last]];
            mesh.clone().with_vertex("normal", Attribute::Vector(normals.into())).unwrap()
        }
        let [before, now] = [(&mesh, 1.), (&moved, -1.)].map(|(mesh, z)| with_normals(mesh, z));
        let normals = Vec::from_iter(std::iter::once(3..4));
        assert_eq!(now.moved_since(&before), Some(Moved { normals, ..expected }));

        fn number(count: u32) -> Attribute {
            Attribute::Number((0..count).map(f64::from).collect())
        }
        for other in [
            Ok(now),
            moved.clone().with_vertex("height", number(4)),
            moved.clone().with_corner("normal", number(6)),
            moved.clone().with_face("normal", number(2)),
            moved.clone().with_creases([([0, 1], 1.0)]),
            Mesh::new(moved.positions().clone(), Faces::triangles(vec![[0, 1, 2], [0, 3, 2]])),
            Mesh::new(moved.positions()[..3].to_vec(), Faces::triangles(vec![[0, 1, 2]])),
        ] {
            assert_eq!(other.unwrap().moved_since(&mesh), None);
        }
    }
}
