//! The sides of faces: each is identified by the corner at which it begins.

use maquette_value::Mesh;

/// Index of a corner that does not exist.
pub(super) const NONE: u32 = u32::MAX;

/// Returns, for each side of a face (identified by its first corner), the side of the adjacent face along the same edge. It is [`NONE`] at
/// borders, at edges with more than two faces, and if the adjacent face has the opposite orientation.
pub(super) fn opposites(mesh: &Mesh) -> Vec<u32> {
    let edges = mesh.edges();
    let corners = mesh.faces().corners();
    let mut first = vec![NONE; edges.vertices.len()];
    let mut opposites = vec![NONE; corners.len()];
    for (corner, &edge) in (0u32..).zip(&edges.of_corner) {
        match first[edge as usize] {
            NONE => first[edge as usize] = corner,
            other => {
                let is_same_way = corners[other as usize] == corners[corner as usize];
                if edges.faces[edge as usize] == 2 && !is_same_way {
                    opposites[other as usize] = corner;
                    opposites[corner as usize] = other;
                }
            }
        }
    }
    opposites
}

/// Returns the face of each corner.
pub(super) fn faces_of_corners(mesh: &Mesh) -> Vec<u32> {
    let faces = (0u32..).zip(mesh.faces().iter());
    faces.flat_map(|(number, face)| std::iter::repeat_n(number, face.len())).collect()
}

/// Returns the length of each side of each face, in mm.
pub(super) fn side_lengths(mesh: &Mesh) -> Vec<f64> {
    fn place(vertex: &u32, mesh: &Mesh) -> nalgebra::Point3<f64> {
        mesh.positions()[*vertex as usize]
    }
    mesh.faces()
        .iter()
        .flat_map(|face| {
            let next = face[1..].iter().chain(&face[..1]);
            face.iter()
                .zip(next)
                .map(|(a, b)| (place(b, mesh) - place(a, mesh)).norm())
                .collect::<Vec<_>>()
        })
        .collect()
}
