//! Combines the different materials of several meshes.

use maquette_value::{Attribute, MATERIAL_ATTRIBUTE, Material, Mesh, MeshError};

/// Returns the mesh with texture coordinates at its corners and a color at each vertex: default values if it has none. Merging needs them
/// if another mesh has them.
pub(super) fn prepare(mesh: &Mesh) -> Result<Mesh, MeshError> {
    let corners = mesh.faces().corners();
    let uv = match (mesh.corner().pairs("uv"), mesh.vertex().pairs("uv")) {
        (Some(uv), _) => uv.clone(),
        (None, Some(uv)) => corners.iter().map(|&vertex| uv[vertex as usize]).collect(),
        (None, None) => vec![[0.0; 2]; corners.len()].into(),
    };
    let prepared = mesh.clone().without_attribute("uv").with_corner("uv", Attribute::Pair(uv))?;
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

/// Returns the merged mesh with the materials of all parts, without duplicates.
pub(super) fn with_materials(merged: Mesh, parts: &[Mesh]) -> Result<Mesh, MeshError> {
    let mut materials: Vec<Material> = Vec::new();
    let mut numbers: Vec<u32> = Vec::with_capacity(merged.faces().len());
    for part in parts.iter().filter(|part| !part.faces().is_empty()) {
        let own = match part.materials().is_empty() {
            true => vec![Material::default()],
            false => part.materials().to_vec(),
        };
        let places: Vec<_> = own
            .into_iter()
            .map(|material: Material| {
                let known = materials.iter().position(|it| *it == material);
                known.unwrap_or_else(|| {
                    materials.push(material);
                    materials.len() - 1
                }) as u32
            })
            .collect();
        fn number(face: usize, part: &Mesh) -> u32 {
            part.face_materials().map_or(0, |all| all[face])
        }
        numbers.extend(
            (0..part.faces().len())
                .map(|face| *places.get(number(face, part) as usize).unwrap_or(&places[0])),
        );
    }
    let merged = match materials.len() {
        0 | 1 => merged,
        _ => merged.with_face(MATERIAL_ATTRIBUTE, Attribute::Index(numbers.into()))?,
    };
    Ok(merged.with_materials(materials))
}

#[cfg(test)]
mod tests {
    use maquette_value::{Faces, Image};
    use nalgebra::Point3;

    use super::super::{Looks, merge};
    use super::*;
    use crate::poses::Poses;

    fn triangle(materials: Vec<Material>) -> Mesh {
        let places = vec![Point3::origin(), Point3::new(1., 0., 0.), Point3::new(0., 1., 0.)];
        let mesh = Mesh::new(places, Faces::triangles(vec![[0, 1, 2]])).unwrap();
        mesh.with_materials(materials)
    }

    fn material(name: &str, base_color: [f64; 4]) -> Material {
        Material { name: name.to_owned(), base_color, ..Material::default() }
    }

    #[test]
    fn each_mesh_keeps_its_materials() {
        fn uv() -> Attribute {
            Attribute::Pair(vec![[0.5, 0.25]; 3].into())
        }
        let picture = Image::new(1, 1, vec![[9, 8, 7]]).unwrap();
        let skin = Material { name: "skin".to_owned(), ..Material::from_picture(picture) };
        let red = material("red", [1.0, 0.0, 0.0, 1.0]);
        let pictured = triangle(vec![skin.clone()]).with_vertex("uv", uv()).unwrap();
        let bare = triangle(vec![red.clone()]);
        let unknown = triangle(Vec::new());
        let all = [&pictured, &bare, &unknown, &bare];
        assert!(Looks::choose(&all) == Looks::Several);
        let merged = merge(&all, Poses::Auto).unwrap();
        assert_eq!(merged.materials()[..], [skin, red, Material::default()]);
        assert_eq!(merged.face_materials().map(|all| all.to_vec()), Some(vec![0, 1, 2, 1]));
        assert_eq!(
            merged.corner().pairs("uv").unwrap()[..4],
            [[0.5, 0.25], [0.5, 0.25], [0.5, 0.25], [0.0, 0.0]]
        );
        let colors = merged.vertex().colors("color").unwrap();
        assert_eq!([0, 3, 6].map(|vertex| colors[vertex]), [[255; 3], [255, 0, 0], [255; 3]]);
        let again = merge(&[&merged, &bare], Poses::Auto).unwrap();
        assert_eq!(again.materials().len(), 3);
        assert_eq!(again.face_materials().map(|all| all.to_vec()), Some(vec![0, 1, 2, 1, 1]));
    }
}
