//! Moves a mesh and its normals.

use maquette_value::{Attribute, CaptureFrame, Mesh, MeshError};

use super::motion::Motion;
use super::turned_faces::turned_faces;

/// Returns the capture frame of a moved mesh: the frame of `mesh` without camera and pose; `None` if `mesh` has no frame.
pub(super) fn moved_frame(mesh: &Mesh) -> Option<CaptureFrame> {
    Some(CaptureFrame { camera: None, world_from_camera: None, ..*mesh.frame()? })
}

pub(super) fn moved_mesh(mesh: &Mesh, motion: &Motion) -> Result<Mesh, MeshError> {
    let moved = mesh.with_positions(motion.apply_all(mesh.positions()))?;
    let mut moved = moved.with_frame(moved_frame(mesh));
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
    match motion.is_mirror() {
        true => turned_faces(&moved, &vec![true; moved.faces().len()]),
        false => Ok(moved),
    }
}
