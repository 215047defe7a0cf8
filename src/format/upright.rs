//! Rotates captures for viewers, which expect y up and z towards the viewer.
//!
//! Values in memory keep the axes of the sensor. Only files for viewers are rotated, and only the functions of this module rotate them.

use std::borrow::Cow;

use maquette_value::parallel::*;
use maquette_value::{Attribute, Attributes, ControlNetError, Mesh, MeshError, Surface};
use nalgebra::Point3;

/// Rotates by 180 degrees about x: from the axes of a sensor (y down, z away) to the axes of viewers.
fn rotate(point: &Point3<f64>) -> Point3<f64> {
    Point3::new(point.x, -point.y, -point.z)
}

/// The sign by which y and z of a mesh's vectors are multiplied when they are written. A writer that uses this sign needs no rotated copy.
pub(super) fn upright_sign(mesh: &Mesh) -> f64 {
    if mesh.frame().is_some() { -1.0 } else { 1.0 }
}

/// Returns the points; they are rotated upright if `is_captured` is true.
pub(super) fn upright_points(points: &[Point3<f64>], is_captured: bool) -> Vec<Point3<f64>> {
    if is_captured {
        points.par_iter().with_min_len(4096).map(rotate).collect()
    } else {
        points.to_vec()
    }
}

/// Returns the mesh. If it has a capture frame, the positions and vectors are rotated upright.
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

/// Returns the surface. If it has a capture frame, it is rotated upright.
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

    /// Creates a triangle that faces its sensor, in the axes of a capture: y down, z away.
    fn capture() -> Mesh {
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
    fn captures_are_upright_and_face_the_viewer_in_all_formats() {
        let expected =
            [[0.0, 0.0, -500.0], [0.0, -10.0, -500.0], [20.0, 0.0, -520.0]].map(Point3::from);
        fn write<F: FileFormat<Value = Mesh>>() -> Vec<u8> {
            F::write(&capture(), "it.x").unwrap().swap_remove(0).bytes
        }
        let read = [
            ply::read(&write::<MeshPly>()).unwrap(),
            obj::read(&write::<MeshObj>()).unwrap(),
            stl::read(&write::<MeshStl>()).unwrap(),
            glb::read(&write::<MeshGlb>()).unwrap(),
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
    fn values_without_a_capture_frame_are_not_rotated() {
        let plain = capture().with_frame(None);
        assert!(matches!(upright(&plain), Ok(Cow::Borrowed(_))));
        assert_eq!(upright_points(plain.positions(), false), plain.positions().to_vec());
    }
}
