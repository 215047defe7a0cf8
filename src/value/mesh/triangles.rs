//! The triangles of a mesh's faces.

use std::borrow::Cow;

use super::Mesh;
use crate::parallel::*;
use crate::polygon::{fan, is_fan, triangulate};

impl Mesh {
    /// The triangles of a face, each with three of the face's corners by index: `n - 2` triangles for `n` corners. [`triangulate`] cuts the
    /// face along diagonals.
    ///
    /// # Panics
    /// If there is no such face.
    pub fn face_triangles(&self, face: usize) -> impl Iterator<Item = [u32; 3]> + use<> {
        let cut = (!self.is_fan(face)).then(|| {
            let corners = self.faces().face(face).iter();
            triangulate(
                &corners.map(|&vertex| self.positions()[vertex as usize]).collect::<Vec<_>>(),
            )
        });
        let plain = fan(if cut.is_some() { 0 } else { self.faces().face(face).len() });
        cut.into_iter().flatten().chain(plain)
    }

    /// The triangles of all faces, face by face as [`face_triangles`](Self::face_triangles) cuts them. Each is given by its corners, as
    /// indices among the corners of all faces.
    pub fn triangle_corners(&self) -> Vec<[u32; 3]> {
        (0..self.faces().len())
            .into_par_iter()
            .flat_map_iter(|face: usize| {
                let first = self.faces().first_corner(face) as u32;
                self.face_triangles(face).map(move |it| it.map(|corner| first + corner))
            })
            .collect()
    }

    /// The triangles of all faces, face by face as [`face_triangles`](Self::face_triangles) cuts them. Each is given by its vertices.
    pub fn triangles(&self) -> Cow<'_, [[u32; 3]]> {
        if let Some(triangles) = self.faces().as_triangles() {
            return Cow::Borrowed(triangles);
        }
        let corners = self.faces().corners();
        let triangles = self.triangle_corners();
        let vertices =
            triangles.into_par_iter().map(|it| it.map(|corner| corners[corner as usize]));
        Cow::Owned(vertices.collect())
    }

    /// Returns true if the triangles of a face form the fan around its first corner.
    ///
    /// # Panics
    /// If there is no such face.
    pub fn is_fan(&self, face: usize) -> bool {
        let corners = self.faces().face(face);
        is_fan(corners.len(), |k| self.positions()[corners[k as usize] as usize])
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;
    use crate::Faces;

    /// A dart (a quad with one concave corner) whose first corner is not the concave one, and a triangle beside the dart.
    fn dart() -> Mesh {
        let positions = [[1., 0., 0.], [0.1, 0.1, 0.], [0., 1., 0.], [0., 0., 0.], [2., 2., 0.]];
        let faces = Faces::polygons(&[3, 4], vec![0, 4, 2, 0, 1, 2, 3]).unwrap();
        Mesh::new(Vec::from(positions.map(Point3::from)), faces).unwrap()
    }

    #[test]
    fn faces_are_cut_in_order() {
        let mesh = dart();
        assert!(mesh.is_fan(0) && !mesh.is_fan(1));
        assert_eq!(mesh.triangle_corners(), [[0, 1, 2], [6, 3, 4], [6, 4, 5]]);
        assert_eq!(mesh.triangles()[..], [[0, 4, 2], [3, 0, 1], [3, 1, 2]]);
    }
}
