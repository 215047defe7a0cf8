//! Warnings about what of a value a file of some format does not hold.

use maquette_value::{Attributes, Mesh, Points};

/// What a format holds of a mesh, beside positions and faces. `normal` is no loss where a format has normals of its own for faces.
pub(super) struct Holds {
    /// Attributes of vertices by name; `None` if all.
    pub(super) vertex: Option<&'static [&'static str]>,
    /// Attributes of corners by name.
    pub(super) corner: &'static [&'static str],
    /// All attributes of faces.
    pub(super) face: bool,
    pub(super) picture: bool,
}

impl Holds {
    /// A warning that names what of a mesh is left out of a file, if anything is.
    pub(super) fn left_out(&self, mesh: &Mesh) -> Option<String> {
        let all =
            |attributes: &Attributes| Vec::from_iter(attributes.iter().map(|it| it.0.to_owned()));
        let mut lost = Vec::new();
        let vertex = self.vertex.map_or_else(Vec::new, |held| without(all(mesh.vertex()), held));
        let corner = without(all(mesh.corner()), self.corner);
        let face = if self.face { Vec::new() } else { all(mesh.face()) };
        for (names, domain) in [(vertex, "vertices"), (corner, "corners"), (face, "faces")] {
            if !names.is_empty() {
                lost.push(format!("{} of {domain}", quoted(&names)));
            }
        }
        if mesh.creases().len() > 0 {
            lost.push("creases".to_owned());
        }
        if mesh.texture().is_some() && !self.picture {
            lost.push("the picture".to_owned());
        }
        told(&lost)
    }
}

/// A warning that names attributes of points that are left out of a file, if any is.
pub(super) fn of_points(points: &Points, held: &[&str]) -> Option<String> {
    let names = points.attributes().iter().map(|(name, _)| name.to_owned());
    let names = without(names.collect(), held);
    told(&Vec::from_iter((!names.is_empty()).then(|| quoted(&names))))
}

fn without(names: Vec<String>, held: &[&str]) -> Vec<String> {
    names.into_iter().filter(|name| !held.contains(&&name[..])).collect()
}

fn quoted(names: &[String]) -> String {
    Vec::from_iter(names.iter().map(|name| format!("`{name}`"))).join(", ")
}

fn told(lost: &[String]) -> Option<String> {
    let last = lost.last()?;
    let all = match &lost[..lost.len() - 1] {
        [] => last.clone(),
        before => format!("{} and {last}", before.join(", ")),
    };
    Some(format!("such a file does not hold {all}, which is left out"))
}

#[cfg(test)]
mod tests {
    use maquette_value::{Attribute, Faces, Image};
    use nalgebra::Point3;

    use super::*;

    #[test]
    fn what_is_left_out_is_named() {
        let places = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.]].map(Point3::from);
        let mesh = Mesh::new(places.to_vec(), Faces::triangles(vec![[0, 1, 2]])).unwrap();
        let holds = Holds {
            vertex: Some(&["normal", "color"]),
            corner: &["uv"],
            face: false,
            picture: false,
        };
        let mesh = mesh.with_vertex("color", Attribute::Color(vec![[1; 3]; 3].into())).unwrap();
        assert_eq!(holds.left_out(&mesh), None);
        let mesh = mesh.with_vertex("heat", Attribute::Number(vec![1.0; 3].into())).unwrap();
        let told = |all: &str| Some(format!("such a file does not hold {all}, which is left out"));
        assert_eq!(holds.left_out(&mesh), told("`heat` of vertices"));
        let mesh = mesh.with_vertex("uv", Attribute::Pair(vec![[0.0; 2]; 3].into())).unwrap();
        let mesh = mesh.with_face("part", Attribute::Index(vec![4].into())).unwrap();
        let mesh = mesh.with_creases([([0, 1], 1.0)]).unwrap();
        let mesh = mesh.with_texture(Some(Image::new(1, 1, vec![[1; 3]]).unwrap()));
        let all = "`heat`, `uv` of vertices, `part` of faces, creases and the picture";
        assert_eq!(holds.left_out(&mesh), told(all));
        let all = Holds { vertex: None, corner: &["uv"], face: true, picture: true };
        assert_eq!(all.left_out(&mesh), told("creases"));
        let points = Points::new(places.to_vec()).unwrap();
        assert_eq!(of_points(&points, &["color"]), None);
        let points = points.with_attribute("ring", Attribute::Index(vec![1, 2, 3].into())).unwrap();
        assert_eq!(of_points(&points, &["color"]), told("`ring`"));
    }
}
