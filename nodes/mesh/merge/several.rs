//! The materials of several meshes in one.

use maquette_value::{Attribute, MATERIAL, Material, Mesh, MeshError};

use super::MergeError;

/// The mesh with texture coordinates and colors where others of those that it is merged with may have them: texture coordinates at its
/// corners, and a color at each vertex.
pub(super) fn prepared(mesh: &Mesh) -> Result<Mesh, MeshError> {
    let corners = mesh.faces().corners();
    let uv = match (mesh.corner().pairs("uv"), mesh.vertex().pairs("uv")) {
        (Some(uv), _) => uv.clone(),
        (None, Some(uv)) => corners.iter().map(|&vertex| uv[vertex as usize]).collect(),
        (None, None) => vec![[0.0; 2]; corners.len()].into(),
    };
    let prepared = mesh.clone().without("uv").with_corner("uv", Attribute::Pair(uv))?;
    if mesh.vertex().colors("color").is_some() {
        return Ok(prepared);
    }
    let mut colors = vec![[255; 3]; mesh.positions().len()];
    for (number, face) in mesh.faces().iter().enumerate() {
        let color = mesh.material_of(number).map_or([255; 3], Material::color);
        face.iter().for_each(|&vertex| colors[vertex as usize] = color);
    }
    prepared.with_vertex("color", Attribute::Color(colors.into()))
}

/// The merged mesh with the materials of all parts, each once.
pub(super) fn with_materials(merged: Mesh, parts: &[Mesh]) -> Result<Mesh, MergeError> {
    let mut materials: Vec<Material> = Vec::new();
    let mut numbers: Vec<u32> = Vec::with_capacity(merged.faces().len());
    for part in parts.iter().filter(|part| !part.faces().is_empty()) {
        let own = match part.materials().is_empty() {
            true => vec![Material::default()],
            false => part.materials().to_vec(),
        };
        let place = |material: Material| {
            let known = materials.iter().position(|it| *it == material);
            known.unwrap_or_else(|| {
                materials.push(material);
                materials.len() - 1
            }) as u32
        };
        let places = Vec::from_iter(own.into_iter().map(place));
        let number = |face: usize| part.face_materials().map_or(0, |all| all[face]);
        let place = |face| *places.get(number(face) as usize).unwrap_or(&places[0]);
        numbers.extend((0..part.faces().len()).map(place));
    }
    let merged = match materials.len() {
        0 | 1 => merged,
        _ => merged.with_face(MATERIAL, Attribute::Index(numbers.into()))?,
    };
    Ok(merged.with_materials(materials))
}
