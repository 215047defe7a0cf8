//! What a capture gave, as it stands in files for viewers: y up, z towards the viewer.
//!
//! Values keep the axes of the sensor, so that a cell is where its camera saw it. Only files for viewers are rotated, and only here.

use std::borrow::Cow;

use maquette_value::parallel::*;
use maquette_value::{Attribute, Attributes, ControlNetError, Mesh, MeshError, Surface};
use nalgebra::Point3;

/// Half a turn about x: from a sensor's axes (y down, z away) to those of viewers.
fn turned(point: &Point3<f64>) -> Point3<f64> {
    Point3::new(point.x, -point.y, -point.z)
}

/// The sign that y and z of a mesh's vectors get in files: a writer that goes through all of them needs no turned copy.
pub(super) fn upright_sign(mesh: &Mesh) -> f64 {
    if mesh.frame().is_some() { -1.0 } else { 1.0 }
}

/// The points of something that a capture gave if `is_captured`, else as they are.
pub(super) fn upright_points(points: &[Point3<f64>], is_captured: bool) -> Vec<Point3<f64>> {
    if is_captured {
        points.par_iter().with_min_len(4096).map(turned).collect()
    } else {
        points.to_vec()
    }
}

/// The mesh, half a turn about x away if a capture gave it; its vectors turn along.
pub(super) fn upright(mesh: &Mesh) -> Result<Cow<'_, Mesh>, MeshError> {
    if mesh.frame().is_none() {
        return Ok(Cow::Borrowed(mesh));
    }
    fn vectors(attributes: &Attributes) -> Vec<(String, Attribute)> {
        attributes
            .iter()
            .filter_map(|(name, attribute): (&str, &Attribute)| match attribute {
                Attribute::Vector(vectors) => {
                    let vectors = vectors.iter().map(|&[x, y, z]| [x, -y, -z]).collect();
                    Some((name.to_owned(), Attribute::Vector(vectors)))
                }
                _ => None,
            })
            .collect()
    }
    let mut upright = mesh.with_positions(upright_points(mesh.positions(), true))?.with_frame(None);
    for (name, attribute) in vectors(mesh.vertex()) {
        upright = upright.with_vertex(&name, attribute)?;
    }
    for (name, attribute) in vectors(mesh.corner()) {
        upright = upright.with_corner(&name, attribute)?;
    }
    for (name, attribute) in vectors(mesh.face()) {
        upright = upright.with_face(&name, attribute)?;
    }
    Ok(Cow::Owned(upright))
}

/// The surface, half a turn about x away if a capture gave it.
pub(super) fn upright_surface(surface: &Surface) -> Result<Cow<'_, Surface>, ControlNetError> {
    let net = surface.net();
    if net.frame().is_none() {
        return Ok(Cow::Borrowed(surface));
    }
    let points = upright_points(net.points(), true);
    let net = net.clone().with_points(points)?.with_frame(None);
    let upright = Surface::new(net, surface.u().clone(), surface.v().clone());
    Ok(Cow::Owned(upright.expect("the knots fit as before")))
}

#[cfg(test)]
mod tests {
    use maquette_node::pack::FileFormat;
    use maquette_value::{CaptureFrame, Faces};

    use super::*;
    use crate::glb::MeshGlb;
    use crate::obj::MeshObj;
    use crate::ply::MeshPly;
    use crate::stl::MeshStl;
    use crate::{glb, obj, ply, stl};

    /// A triangle that looks at its sensor, as a capture gives it: y down, z away.
    fn captured() -> Mesh {
        let places = [[0.0, 0.0, 500.0], [0.0, 10.0, 500.0], [20.0, 0.0, 520.0]].map(Point3::from);
        let frame =
            CaptureFrame { camera: None, picture: [4, 4], depth: 500.0, world_from_camera: None };
        Mesh::new(places.to_vec(), Faces::triangles(vec![[0, 1, 2]]))
            .and_then(|it| {
                it.with_vertex("normal", Attribute::Vector(vec![[0.0, 0.6, -0.8]; 3].into()))
            })
            .unwrap()
            .with_frame(Some(frame))
    }

    #[test]
    fn every_file_for_viewers_has_a_capture_upright_and_facing() {
        let expected =
            [[0.0, 0.0, -500.0], [0.0, -10.0, -500.0], [20.0, 0.0, -520.0]].map(Point3::from);
        let write = |write: fn(&Mesh, &str) -> _| -> Vec<u8> {
            let files: Result<Vec<maquette_node::pack::NewFile>, maquette_syntax::error::Error> =
                write(&captured(), "it.x");
            files.unwrap().swap_remove(0).bytes
        };
        let read = [
            ply::read(&write(MeshPly::write)).unwrap(),
            obj::read(&write(MeshObj::write)).unwrap(),
            stl::read(&write(MeshStl::write)).unwrap(),
            glb::read(&write(MeshGlb::write)).unwrap(),
        ];
        for mesh in &read {
            let places: Vec<_> =
                mesh.faces().face(0).iter().map(|&at| mesh.positions()[at as usize]).collect();
            let off = places.iter().zip(expected).map(|(a, b)| (a - b).norm());
            assert!(off.fold(0.0, f64::max) < 1e-3, "{places:?}");
            assert!(mesh.area_vector(mesh.faces().face(0)).z > 0.0);
        }
        for mesh in &read[..2] {
            let normal = mesh.vertex().vectors("normal").unwrap()[0];
            assert!((normal[1] + 0.6).abs() < 1e-6 && (normal[2] - 0.8).abs() < 1e-6, "{normal:?}");
        }
    }

    #[test]
    fn what_no_capture_gave_is_written_as_it_is() {
        let plain = captured().with_frame(None);
        assert!(matches!(upright(&plain), Ok(Cow::Borrowed(_))));
        assert_eq!(upright_points(plain.positions(), false), plain.positions().to_vec());
    }
}
