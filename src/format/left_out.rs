//! Warnings about what of a value a file of some format does not hold.

use std::collections::BTreeSet;

use maquette_node::DataKind::*;
use maquette_node::{DataKind, Fidelities, Fidelity};
use maquette_value::{Attribute, Attributes, MATERIAL, MapKind, Material, Mesh, Points};

/// Flags that nodes set for other nodes: no loss in a file.
const MARKS: [&str; 3] = ["filled", "fixed", "folded"];

/// A warning that names the flags of a mesh, which its file does not hold although it holds other attributes.
pub(super) fn flags_of_mesh(mesh: &Mesh) -> Option<String> {
    let domains = [(mesh.vertex(), "vertices"), (mesh.corner(), "corners")];
    let mut lost = Vec::new();
    for (attributes, domain) in domains {
        let flags = attributes.iter().filter(|(_, it)| matches!(it, Attribute::Flag(_)));
        let names = flags.map(|(name, _)| name.to_owned());
        let names: Vec<String> = names.filter(|name| !MARKS.contains(&&name[..])).collect();
        if !names.is_empty() {
            lost.push(format!("{} of {domain}", quoted(&names)));
        }
    }
    warning(&lost)
}

/// A warning that names what of a mesh is left out of a file whose writer keeps or changes what is listed, if anything is. Normals are no
/// loss: whoever reads the file computes them.
pub(super) fn of_mesh(mesh: &Mesh, held: Fidelities) -> Option<String> {
    fn is_lost(kind: DataKind, held: &[(DataKind, Fidelity)]) -> bool {
        !held.iter().any(|(listed, _)| *listed == kind)
    }
    fn lost_of(
        attributes: &Attributes,
        color: DataKind,
        uv: Option<DataKind>,
        other: DataKind,
        held: &[(DataKind, Fidelity)],
    ) -> Vec<String> {
        fn is_mark(name: &str, attribute: &Attribute) -> bool {
            MARKS.contains(&name) && matches!(attribute, Attribute::Flag(_))
        }
        let seen = attributes.iter().filter(|(name, attribute)| !is_mark(name, attribute));
        let names = seen.map(|(name, _)| name.to_owned());
        names
            .filter(|name| match &name[..] {
                "normal" => false,
                "color" => is_lost(color, held),
                "uv" => is_lost(uv.unwrap_or(other), held),
                _ => is_lost(other, held),
            })
            .collect::<Vec<_>>()
    }
    // The numbers of materials are told of as these.
    let of_faces = match mesh.face_materials() {
        Some(_) => mesh.clone().without_face(MATERIAL).face().clone(),
        None => mesh.face().clone(),
    };
    let domains = [
        (lost_of(mesh.vertex(), VertexColors, Some(VertexUv), VertexAttributes, held), "vertices"),
        (lost_of(mesh.corner(), CornerColors, Some(CornerUv), CornerAttributes, held), "corners"),
        (lost_of(&of_faces, FaceColors, None, FaceAttributes, held), "faces"),
    ];
    let named = domains.iter().filter(|(names, _)| !names.is_empty());
    let mut lost =
        named.map(|(names, domain)| format!("{} of {domain}", quoted(names))).collect::<Vec<_>>();
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

/// A warning that names what of materials only another format knows, by whether this one keeps something of that name, or nothing is lost
/// without these words.
pub(super) fn of_materials(mesh: &Mesh, is_known: impl Fn(&str, &str) -> bool) -> Option<String> {
    let names = mesh.materials().iter().flat_map(|material| {
        let maps = material.maps.keys().filter_map(|kind| match kind {
            MapKind::Other(name) => Some((name, "")),
            _ => None,
        });
        maps.chain(material.others.iter().map(|(name, words)| (name, &words[..])))
    });
    let lost = names.filter(|(name, words)| !is_known(name, words));
    let names = BTreeSet::from_iter(lost.map(|(name, _)| name.clone()));
    let names = Vec::from_iter(names);
    warning(&Vec::from_iter(
        (!names.is_empty()).then(|| format!("{} of materials", quoted(&names))),
    ))
}

/// A warning that names attributes of points that are left out of a file, if any is.
pub(super) fn of_points(points: &Points, held: &[&str]) -> Option<String> {
    let names = points.attributes().iter().map(|(name, _)| name.to_owned());
    let names: Vec<_> = names.filter(|name| !held.contains(&&name[..])).collect();
    warning(&Vec::from_iter((!names.is_empty()).then(|| quoted(&names))))
}

/// A warning about data of a file's points that a range image does not hold, if there is any.
pub(super) fn of_range<'a>(names: impl Iterator<Item = &'a str>) -> Option<String> {
    let names: Vec<_> = names.map(|name| format!("`{name}`")).collect();
    (!names.is_empty()).then(|| {
        let verb = if names.len() == 1 { "is" } else { "are" };
        format!("{} {verb} left out: a range image has points and colors only", names.join(", "))
    })
}

fn quoted(names: &[String]) -> String {
    names.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ")
}

/// The warning about what is lost, if anything is.
fn warning(lost: &[String]) -> Option<String> {
    let last = lost.last()?;
    let all = match &lost[..lost.len() - 1] {
        [] => last.clone(),
        before => format!("{} and {last}", before.join(", ")),
    };
    Some(format!("such a file does not hold {all}, which is left out"))
}

#[cfg(test)]
mod tests {
    use maquette_value::{Faces, Image};
    use nalgebra::Point3;

    use super::*;
    use crate::fidelity;

    #[test]
    fn what_is_left_out_is_named() {
        let held = fidelity::OBJ;
        let places = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.]].map(Point3::from);
        let mesh = Mesh::new(places.to_vec(), Faces::triangles(vec![[0, 1, 2]])).unwrap();
        let mesh = mesh.with_vertex("color", Attribute::Color(vec![[1; 3]; 3].into())).unwrap();
        assert_eq!(of_mesh(&mesh, held), None);
        let mesh = mesh.with_vertex("heat", Attribute::Number(vec![1.0; 3].into())).unwrap();
        fn told(all: &str) -> Option<String> {
            Some(format!("such a file does not hold {all}, which is left out"))
        }
        assert_eq!(of_mesh(&mesh, held), told("`heat` of vertices"));
        let mesh = mesh.with_vertex("uv", Attribute::Pair(vec![[0.0; 2]; 3].into())).unwrap();
        let mesh = mesh.with_face("part", Attribute::Index(vec![4].into())).unwrap();
        let mesh = mesh.with_creases([([0, 1], 1.0)]).unwrap();
        let mesh = mesh.with_texture(Some(Image::new(1, 1, vec![[1; 3]]).unwrap()));
        let all = "`heat` of vertices, `part` of faces and creases";
        assert_eq!(of_mesh(&mesh, held), told(all));
        assert_eq!(of_mesh(&mesh, fidelity::PLY), told("creases"));
        fn flags(name: &str, places: &[Point3<f64>; 3]) -> Mesh {
            let mesh = Mesh::new(places.to_vec(), Faces::triangles(vec![[0, 1, 2]])).unwrap();
            mesh.with_vertex(name, Attribute::Flag(vec![1; 3].into())).unwrap()
        }
        assert_eq!(of_mesh(&flags("seen", &places), held), told("`seen` of vertices"));
        assert_eq!(flags_of_mesh(&flags("seen", &places)), told("`seen` of vertices"));
        assert_eq!(of_mesh(&flags("seen", &places), fidelity::PLY), None);
        assert_eq!(
            (of_mesh(&flags("filled", &places), held), flags_of_mesh(&flags("filled", &places))),
            (None, None)
        );
        let points = Points::new(places.to_vec()).unwrap();
        assert_eq!(of_points(&points, &["color"]), None);
        let points = points.with_attribute("ring", Attribute::Index(vec![1, 2, 3].into())).unwrap();
        assert_eq!(of_points(&points, &["color"]), told("`ring`"));
    }
}
