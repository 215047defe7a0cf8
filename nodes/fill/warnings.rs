//! The warnings about fills whose surface is not the requested one.

use nalgebra::{Point3, Vector3};

use super::plain::hole_fill::{Fallback, HoleFill};
use super::triangles::filling::Filling;

/// Maximum number of rims that a warning names.
const MAX_NAMED: usize = 3;

/// Returns the text of a position: its coordinates in mm.
pub(super) fn describe_place(point: Point3<f64>) -> String {
    format!("({:.3}, {:.3}, {:.3})", point.x, point.y, point.z)
}

/// Returns the center of a face of a filled mesh.
pub(super) fn face_center(filling: &Filling, face: u32) -> Point3<f64> {
    let corners = filling.faces[face as usize].map(|vertex| filling.points[vertex as usize].coords);
    (corners.iter().sum::<Vector3<f64>>() / 3.0).into()
}

/// Returns the warnings about fills with another surface than the requested one. `numbers` are the rim numbers of the holes, `holes` their
/// rims.
pub(super) fn describe_fallbacks(
    numbers: &[usize],
    holes: &[Vec<u32>],
    fills: &[HoleFill],
    filling: &Filling,
) -> Vec<String> {
    let texts = [
        (
            Fallback::Intersection,
            "is filled with another surface than requested, because the requested one would intersect the mesh or itself; cut out what is in the way with `holes: Region`",
        ),
        (
            Fallback::RoughRim,
            "is too rough for a thin plate and is filled with a membrane; cut out the rough border with `holes: Region`, or smooth it",
        ),
        (
            Fallback::NoCreases,
            "has no creases that can be extended and is filled with a thin plate; if there are creases, enlarge the hole up to where they are sharp with `holes: Region`",
        ),
    ];
    let mut warnings = Vec::new();
    for (fallback, text) in texts {
        let own = (numbers.iter().zip(holes).zip(fills))
            .filter(|(_, fill)| fill.fallback == Some(fallback));
        let rims: Vec<String> = own
            .map(|((number, rim), _)| {
                format!("{number} at {}", describe_place(filling.points[rim[0] as usize]))
            })
            .collect();
        if !rims.is_empty() {
            warnings.push(format!("rim {} {text}", join(&rims)));
        }
    }
    warnings
}

/// Joins the first names, and counts the others.
fn join(names: &[String]) -> String {
    match names.len().saturating_sub(MAX_NAMED) {
        0 => names.join(", "),
        more => format!("{} and {more} more", names[..MAX_NAMED].join(", ")),
    }
}
