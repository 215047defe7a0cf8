//! Removes border faces.

use maquette_value::{Faces, Mesh, MeshError};

/// Removes the faces of `refined` whose original face in `mesh` touches the border, and then the vertices without faces. `ancestors` has
/// the original face of each refined face.
pub(crate) fn without_border(
    mesh: &Mesh,
    ancestors: &[u32],
    refined: &Mesh,
) -> Result<Mesh, MeshError> {
    let edges = mesh.edges();
    let mut on_border = vec![false; mesh.positions().len()];
    let border = edges.vertices.iter().zip(&edges.faces).filter(|(_, faces)| **faces == 1);
    border.flat_map(|(ends, _)| ends).for_each(|&end| on_border[end as usize] = true);
    let touches: Vec<bool> =
        mesh.faces().iter().map(|face| face.iter().any(|&v| on_border[v as usize])).collect();
    let faces: Vec<u32> = (0..refined.faces().len() as u32)
        .filter(|face| !touches[ancestors[*face as usize] as usize])
        .collect();
    select_faces(refined, &faces)
}

/// Returns a mesh that consists of the given faces and their vertices. Faces and vertices keep their order.
pub(crate) fn select_faces(mesh: &Mesh, faces: &[u32]) -> Result<Mesh, MeshError> {
    const REMOVED: u32 = u32::MAX;
    let old = mesh.faces();
    let kept_corners: Vec<u32> = faces
        .iter()
        .map(|&face| face as usize)
        .flat_map(|face| (old.first_corner(face) as u32..).take(old.face(face).len()))
        .collect();
    let mut renamed = vec![REMOVED; mesh.positions().len()];
    kept_corners.iter().for_each(|&corner| renamed[old.corners()[corner as usize] as usize] = 0);
    let vertices: Vec<u32> =
        (0..renamed.len() as u32).filter(|&vertex| renamed[vertex as usize] != REMOVED).collect();
    (0..).zip(&vertices).for_each(|(new, &old)| renamed[old as usize] = new);
    let sides: Vec<usize> = faces.iter().map(|&face| old.face(face as usize).len()).collect();
    let corners =
        kept_corners.iter().map(|&corner| renamed[old.corners()[corner as usize] as usize]);
    let positions: Vec<_> = vertices.iter().map(|&v| mesh.positions()[v as usize]).collect();
    let creases = mesh
        .creases()
        .map(|(ends, sharpness)| (ends.map(|end| renamed[end as usize]), sharpness))
        .filter(|(ends, _)| !ends.contains(&REMOVED));
    let mut selected = Mesh::new(positions, Faces::polygons(&sides, corners.collect())?)?
        .with_creases(creases)?
        .with_materials(mesh.materials().clone())
        .with_frame(mesh.frame().copied());
    for (name, attribute) in mesh.vertex().iter() {
        selected = selected.with_vertex(name, attribute.select(&vertices))?;
    }
    for (name, attribute) in mesh.corner().iter() {
        selected = selected.with_corner(name, attribute.select(&kept_corners))?;
    }
    for (name, attribute) in mesh.face().iter() {
        selected = selected.with_face(name, attribute.select(faces))?;
    }
    Ok(selected)
}
