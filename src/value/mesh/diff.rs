//! Differences in vertex positions and normals between two meshes.

use std::ops::Range;

use super::{Attribute, Mesh};
use crate::content::Content;
use crate::{Encoder, Hash};

/// The rows of vertices in which a mesh differs from an earlier mesh, in ascending order and disjoint.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MovedRows {
    /// The vertices whose positions have changed in any bit.
    pub vertices: Vec<Range<u32>>,
    /// The vertices whose attribute `normal` has changed in any bit; empty if neither mesh has that attribute.
    pub normals: Vec<Range<u32>>,
}

impl Mesh {
    /// Compares positions and normals with those of an earlier mesh. `None` if the meshes differ in anything besides positions, normals,
    /// texture and frame.
    pub fn moved_since(&self, before: &Self) -> Option<MovedRows> {
        if self.hash_of_unmoved() != before.hash_of_unmoved() {
            return None;
        }
        let normals = match [self, before].map(|mesh| mesh.vertex.get("normal")) {
            [None, None] => Vec::new(),
            [Some(Attribute::Vector(now)), Some(Attribute::Vector(before))] => {
                now.changed_rows(before)?
            }
            _ => return None,
        };
        Some(MovedRows { vertices: self.positions.changed_rows(&before.positions)?, normals })
    }

    /// The hash of all data that does not change when vertices move.
    fn hash_of_unmoved(&self) -> Hash {
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
    fn moved_rows_are_found_if_everything_else_is_equal() {
        fn point_xy(x: f64, y: f64) -> Point3<f64> {
            Point3::new(x, y, 0.0)
        }
        let positions =
            vec![point_xy(0., 0.), point_xy(1., 0.), point_xy(1., 1.), point_xy(0., 1.)];
        let mesh = Mesh::new(positions, Faces::triangles(vec![[0, 1, 2], [0, 2, 3]])).unwrap();
        let moved = mesh.with_moved(&[1..2, 3..4], &[point_xy(1., -0.), point_xy(5., 1.)]).unwrap();
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
        assert_eq!(refused.map(|_| ()), Err(MeshError::not_finite(3)));
        let expected = MovedRows { vertices: vec![1..2, 3..4], normals: vec![] };
        assert_eq!(moved.moved_since(&mesh), Some(expected.clone()));
        assert_eq!(mesh.moved_since(&mesh), Some(MovedRows::default()));

        fn with_normals(mesh: &Mesh, last: f64) -> Mesh {
            let normals = vec![[0., 0., 1.], [0., 0., 1.], [0., 0., 1.], [0., 0., last]];
            mesh.clone().with_vertex("normal", Attribute::Vector(normals.into())).unwrap()
        }
        let [before, now] = [(&mesh, 1.), (&moved, -1.)].map(|(mesh, z)| with_normals(mesh, z));
        let normals = Vec::from_iter(std::iter::once(3..4));
        assert_eq!(now.moved_since(&before), Some(MovedRows { normals, ..expected }));

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
