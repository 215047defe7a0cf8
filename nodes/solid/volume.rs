//! What a mesh encloses.

use maquette_value::Mesh;
use nalgebra::Point3;

/// The volume within a closed mesh, in mm3, by cones to a place near to it; negative if its faces look inward.
pub(crate) fn volume(mesh: &Mesh, near: Point3<f64>) -> f64 {
    fn place(vertex: u32, near: Point3<f64>, mesh: &Mesh) -> nalgebra::Vector3<f64> {
        mesh.positions()[vertex as usize] - near
    }
    mesh.faces()
        .iter()
        .map(|face| -> f64 {
            let first = place(face[0], near, mesh);
            face[1..]
                .windows(2)
                .map(|pair| {
                    first.dot(&place(pair[0], near, mesh).cross(&place(pair[1], near, mesh)))
                })
                .sum()
        })
        .sum::<f64>()
        / 6.0
}
