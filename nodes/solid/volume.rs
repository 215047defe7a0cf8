//! The volume of a mesh.

use maquette_value::Mesh;
use nalgebra::Point3;

/// Returns the volume inside a closed mesh in mm^3, as the sum of the signed volumes of tetrahedra between the faces and the point `near`;
/// negative if the faces look inward.
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
