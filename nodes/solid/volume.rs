//! What a mesh encloses.

use maquette_value::Mesh;
use nalgebra::Point3;

/// The volume within a closed mesh, in mm3, by cones to a place near to it; negative if its faces look inward.
pub(crate) fn volume(mesh: &Mesh, near: Point3<f64>) -> f64 {
    let place = |vertex: u32| mesh.positions()[vertex as usize] - near;
    let of_face = |face: &[u32]| -> f64 {
        let first = place(face[0]);
        face[1..].windows(2).map(|pair| first.dot(&place(pair[0]).cross(&place(pair[1])))).sum()
    };
    mesh.faces().iter().map(of_face).sum::<f64>() / 6.0
}
