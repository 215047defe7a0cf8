//! A mesh that is moved, with its normals.

use maquette::value::{Attribute, CaptureFrame, Faces, Mesh, MeshError};

use super::motion::Motion;

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
    if motion.linear.determinant() < 0.0 { turned_round(&moved) } else { Ok(moved) }
}

/// The same mesh with the corners of each face in the opposite order, behind the first.
fn turned_round(mesh: &Mesh) -> Result<Mesh, MeshError> {
    let faces = mesh.faces();
    let mut places: Vec<u32> = Vec::with_capacity(faces.corners().len());
    for face in faces.iter() {
        let first = places.len() as u32;
        places.push(first);
        places.extend((first + 1..first + face.len() as u32).rev());
    }
    let corners: Vec<u32> = places.iter().map(|&place| faces.corners()[place as usize]).collect();
    let turned = match faces.sides() {
        Some(sides) => Faces::uniform(sides, corners)?,
        None => Faces::polygons(&faces.iter().map(<[u32]>::len).collect::<Vec<_>>(), corners)?,
    };
    let mut round = Mesh::new(mesh.positions().clone(), turned)?
        .with_creases(mesh.creases())?
        .with_texture(mesh.texture().cloned())
        .with_frame(mesh.frame().copied());
    for (name, attribute) in mesh.vertex().iter() {
        round = round.with_vertex(name, attribute.clone())?;
    }
    for (name, attribute) in mesh.corner().iter() {
        round = round.with_corner(name, attribute.select(&places))?;
    }
    for (name, attribute) in mesh.face().iter() {
        round = round.with_face(name, attribute.clone())?;
    }
    Ok(round)
}
