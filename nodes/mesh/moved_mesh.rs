//! A mesh that is moved, with its normals.

use maquette::value::{Attribute, CaptureFrame, Mesh, MeshError};

use super::motion::Motion;
use super::turned_faces::turned_faces;

pub(super) fn moved_mesh(mesh: &Mesh, motion: &Motion) -> Result<Mesh, MeshError> {
    let mut moved = mesh.with_positions(motion.apply_all(mesh.positions()))?;
    if let Some(frame) = mesh.frame() {
        moved = moved.with_frame(Some(CaptureFrame {
            camera: None,
            world_from_camera: None,
            ..*frame
        }));
    }
    if let Some(turn) = motion.normals() {
        if let Some(normals) = mesh.vertex().vectors("normal") {
            let normals = normals.iter().map(&turn).collect();
            moved = moved.with_vertex("normal", Attribute::Vector(normals))?;
        }
        if let Some(normals) = mesh.corner().vectors("normal") {
            let normals = normals.iter().map(&turn).collect();
            moved = moved.with_corner("normal", Attribute::Vector(normals))?;
        }
    }
    match motion.linear.determinant() < 0.0 {
        true => turned_faces(&moved, &vec![true; moved.faces().len()]),
        false => Ok(moved),
    }
}
