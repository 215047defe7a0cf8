//! Warnings about data of a value that a file format does not store.

use std::collections::BTreeSet;

use maquette_node::DataKind::*;
use maquette_node::{DataKind, Fidelities, Fidelity};
use maquette_value::{Attribute, Attributes, MATERIAL_ATTRIBUTE, MapKind, Material, Mesh, Points};

/// Flags that nodes set for other nodes. If a file does not store them, nothing is lost.
const MARKS: [&str; 3] = ["filled", "fixed", "folded"];

/// Returns a warning that names the flags that are left out when a mesh is written. The warning is meant for formats that store other
/// attributes than flags.
pub(super) fn flags_warning(mesh: &Mesh) -> Option<String> {
    let domains = [(mesh.vertex(), "vertices"), (mesh.corner(), "corners")];
    let mut lost = Vec::new();
    for (attributes, domain) in domains {
        let flags = attributes.iter().filter(|(_, it)| matches!(it, Attribute::Flag(_)));
        let names = flags.map(|(name, _)| name.to_owned());
        let names: Vec<String> = names.filter(|name| !MARKS.contains(&&name[..])).collect();
        if !names.is_empty() {
            lost.push(format!("{} of {domain}", quote_list(&names)));
        }
    }
    warning(&lost)
}

/// Returns a warning that names the data of a mesh that a file does not store. `held` lists the kinds of data that the writer keeps or
/// changes. Normals do not count as lost, because readers compute them.
pub(super) fn mesh_warning(mesh: &Mesh, held: Fidelities) -> Option<String> {
    fn is_lost(kind: DataKind, held: &[(DataKind, Fidelity)]) -> bool {
        !held.iter().any(|(listed, _)| *listed == kind)
    }
    /// Returns the names of lost attributes. `color`, `uv` and `other` are the kinds of data that the attributes belong to. `uv` is `None`
    /// if texture coordinates count as `other`.
    fn lost_attributes(
        attributes: &Attributes,
        color: DataKind,
        uv: Option<DataKind>,
        other: DataKind,
        held: &[(DataKind, Fidelity)],
    ) -> Vec<String> {
        fn is_mark(name: &str, attribute: &Attribute) -> bool {
            MARKS.contains(&name) && matches!(attribute, Attribute::Flag(_))
        }
        let relevant = attributes.iter().filter(|(name, attribute)| !is_mark(name, attribute));
        let names = relevant.map(|(name, _)| name.to_owned());
        names
            .filter(|name| match &name[..] {
                "normal" => false,
                "color" => is_lost(color, held),
                "uv" => is_lost(uv.unwrap_or(other), held),
                _ => is_lost(other, held),
            })
            .collect::<Vec<_>>()
    }
    // Material indices are not reported as an attribute, because the materials are reported.
    let face_attributes = match mesh.face_materials() {
        Some(_) => mesh.clone().without_face(MATERIAL_ATTRIBUTE).face().clone(),
        None => mesh.face().clone(),
    };
    let domains = [
        (
            lost_attributes(mesh.vertex(), VertexColors, Some(VertexUv), VertexAttributes, held),
            "vertices",
        ),
        (
            lost_attributes(mesh.corner(), CornerColors, Some(CornerUv), CornerAttributes, held),
            "corners",
        ),
        (lost_attributes(&face_attributes, FaceColors, None, FaceAttributes, held), "faces"),
    ];
    let named = domains.iter().filter(|(names, _)| !names.is_empty());
    let mut lost = named
        .map(|(names, domain)| format!("{} of {domain}", quote_list(names)))
        .collect::<Vec<_>>();
    if mesh.creases().len() > 0 && is_lost(Creases, held) {
        lost.push("creases".to_owned());
    }
    if mesh.texture().is_some() && is_lost(Pictures, held) {
        lost.push("the picture".to_owned());
    }
    let keeps_materials = held.contains(&(Materials, Fidelity::Kept));
    if !keeps_materials && !mesh.materials().iter().all(Material::is_plain) {
        lost.push("materials beside their colors".to_owned());
    }
    warning(&lost)
}

/// Returns a warning that names the properties of materials that only another format stores. `is_known` must return true if this format
/// stores the property, or if nothing is lost without it.
pub(super) fn materials_warning(
    mesh: &Mesh,
    is_known: impl Fn(&str, &str) -> bool,
) -> Option<String> {
    let names = mesh.materials().iter().flat_map(|material| {
        let maps = material.maps.keys().filter_map(|kind| match kind {
            MapKind::Other(name) => Some((name, "")),
            _ => None,
        });
        maps.chain(material.others.iter().map(|(name, words)| (name, &words[..])))
    });
    let lost = names.filter(|(name, words)| !is_known(name, words));
    let names: BTreeSet<String> = lost.map(|(name, _)| name.clone()).collect();
    if names.is_empty() {
        return None;
    }
    let names: Vec<String> = names.into_iter().collect();
    warning(&[format!("{} of materials", quote_list(&names))])
}

/// Returns a warning that names the attributes of points that are left out of a file.
pub(super) fn points_warning(points: &Points, held: &[&str]) -> Option<String> {
    let names = points.attributes().iter().map(|(name, _)| name.to_owned());
    let names: Vec<_> = names.filter(|name| !held.contains(&&name[..])).collect();
    if names.is_empty() { None } else { warning(&[quote_list(&names)]) }
}

/// Returns a warning about data of points that a range image cannot store.
pub(super) fn range_warning<'a>(names: impl Iterator<Item = &'a str>) -> Option<String> {
    let names: Vec<_> = names.map(|name| format!("`{name}`")).collect();
    (!names.is_empty()).then(|| {
        let verb = if names.len() == 1 { "is" } else { "are" };
        format!("{} {verb} left out: a range image has points and colors only", names.join(", "))
    })
}

fn quote_list(names: &[String]) -> String {
    names.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ")
}

/// Returns the warning about lost data; `None` if nothing is lost.
fn warning(lost: &[String]) -> Option<String> {
    let last = lost.last()?;
    let all = match &lost[..lost.len() - 1] {
        [] => last.clone(),
        before => format!("{} and {last}", before.join(", ")),
    };
    Some(format!("this format does not store {all}"))
}

#[cfg(test)]
mod tests {
    use maquette_value::{Faces, Image};
    use nalgebra::Point3;

    use super::*;
    use crate::fidelity;

    #[test]
    fn lost_data_are_named() {
        let held = fidelity::OBJ;
        let positions = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.]].map(Point3::from);
        let mesh = Mesh::new(positions.to_vec(), Faces::triangles(vec![[0, 1, 2]])).unwrap();
        let mesh = mesh.with_vertex("color", Attribute::Color(vec![[1; 3]; 3].into())).unwrap();
        assert_eq!(mesh_warning(&mesh, held), None);
        let mesh = mesh.with_vertex("heat", Attribute::Number(vec![1.0; 3].into())).unwrap();
        fn warning_text(all: &str) -> Option<String> {
            Some(format!("this format does not store {all}"))
        }
        assert_eq!(mesh_warning(&mesh, held), warning_text("`heat` of vertices"));
        let mesh = mesh.with_vertex("uv", Attribute::Pair(vec![[0.0; 2]; 3].into())).unwrap();
        let mesh = mesh.with_face("part", Attribute::Index(vec![4].into())).unwrap();
        let mesh = mesh.with_creases([([0, 1], 1.0)]).unwrap();
        let mesh = mesh.with_texture(Some(Image::new(1, 1, vec![[1; 3]]).unwrap()));
        let all = "`heat` of vertices, `part` of faces and creases";
        assert_eq!(mesh_warning(&mesh, held), warning_text(all));
        assert_eq!(mesh_warning(&mesh, fidelity::PLY), warning_text("creases"));
        fn flags(name: &str, positions: &[Point3<f64>; 3]) -> Mesh {
            let mesh = Mesh::new(positions.to_vec(), Faces::triangles(vec![[0, 1, 2]])).unwrap();
            mesh.with_vertex(name, Attribute::Flag(vec![1; 3].into())).unwrap()
        }
        assert_eq!(
            mesh_warning(&flags("seen", &positions), held),
            warning_text("`seen` of vertices")
        );
        assert_eq!(flags_warning(&flags("seen", &positions)), warning_text("`seen` of vertices"));
        assert_eq!(mesh_warning(&flags("seen", &positions), fidelity::PLY), None);
        assert_eq!(
            (
                mesh_warning(&flags("filled", &positions), held),
                flags_warning(&flags("filled", &positions))
            ),
            (None, None)
        );
        let points = Points::new(positions.to_vec()).unwrap();
        assert_eq!(points_warning(&points, &["color"]), None);
        let points = points.with_attribute("ring", Attribute::Index(vec![1, 2, 3].into())).unwrap();
        assert_eq!(points_warning(&points, &["color"]), warning_text("`ring`"));
    }
}
