//! Reverses faces.

use maquette_value::{Faces, Mesh, MeshError};

/// Returns the mesh with the flagged faces reversed: a reversed face keeps its first corner, and its other corners are in opposite order.
/// Attributes of corners are reordered, too; normals do not change.
pub(super) fn turned_faces(mesh: &Mesh, is_turned: &[bool]) -> Result<Mesh, MeshError> {
    let faces = mesh.faces();
    let mut places: Vec<u32> = Vec::with_capacity(faces.corners().len());
    for (face, &is_turned) in faces.iter().zip(is_turned) {
        let first = places.len() as u32;
        let others = first + 1..first + face.len() as u32;
        places.push(first);
        if is_turned {
            places.extend(others.rev());
        } else {
            places.extend(others);
        }
    }
    let corners: Vec<u32> = places.iter().map(|&place| faces.corners()[place as usize]).collect();
    let turned = match faces.sides() {
        Some(sides) => Faces::uniform(sides, corners)?,
        None => Faces::polygons(&faces.iter().map(<[u32]>::len).collect::<Vec<_>>(), corners)?,
    };
    let mut round = Mesh::new(mesh.positions().clone(), turned)?
        .with_creases(mesh.creases())?
        .with_materials(mesh.materials().clone())
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
