//! What a capture gave, as it stands in files for viewers: y up, z towards the viewer.

use std::borrow::Cow;

use nalgebra::Point3;

use crate::value::{Attribute, Attributes, ControlNetError, Mesh, MeshError, Surface};

/// Half a turn about x: from a sensor's axes (y down, z away) to those of viewers.
fn turned(point: &Point3<f64>) -> Point3<f64> {
    Point3::new(point.x, -point.y, -point.z)
}

/// The points of something that a capture gave if `is_captured`, else as they are.
pub(super) fn upright_points(points: &[Point3<f64>], is_captured: bool) -> Vec<Point3<f64>> {
    if is_captured { points.iter().map(turned).collect() } else { points.to_vec() }
}

/// The mesh, half a turn about x away if a capture gave it; its vectors turn along.
pub(super) fn upright(mesh: &Mesh) -> Result<Cow<'_, Mesh>, MeshError> {
    if mesh.frame().is_none() {
        return Ok(Cow::Borrowed(mesh));
    }
    let vectors = |attributes: &Attributes| -> Vec<(String, Attribute)> {
        let turn = |(name, attribute): (&str, &Attribute)| match attribute {
            Attribute::Vector(vectors) => {
                let vectors = vectors.iter().map(|&[x, y, z]| [x, -y, -z]).collect();
                Some((name.to_owned(), Attribute::Vector(vectors)))
            }
            _ => None,
        };
        attributes.iter().filter_map(turn).collect()
    };
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
