//! Determines for each part of a mesh which side of its faces is the outside.

use maquette_base::solid_angle::half_solid_angle;
use maquette_base::topology::lists::Lists;
use maquette_value::Mesh;
use maquette_value::parallel::*;
use nalgebra::{Point3, Vector3};

use super::sheets::Sheets;

/// Minimum and maximum number of faces that are sampled on an open part. Between these limits, [`SOLID_ANGLES`] determines the number.
const SAMPLED_FACES: std::ops::RangeInclusive<usize> = 16..=256;

/// Maximum number of solid angles that are computed for an open part, within the limits of [`SAMPLED_FACES`]. Computing this many takes
/// half a second on one thread.
const SOLID_ANGLES: usize = 1 << 23;

/// Minimum absolute winding number of an open part for which an outside is determined. The winding number of a plane is 0, except for
/// rounding; that of a relief a tenth as high as wide is about 0.1, and that of a half sphere 0.25.
const MIN_BULGE: f64 = 1e-3;

/// Returns a number for each part: positive if its faces look outward, negative if they look inward, 0 if no outside can be determined.
pub(super) fn outward_sides(mesh: &Mesh, sheets: &Sheets) -> Vec<f64> {
    let count = sheets.is_closed.len();
    let faces =
        Lists::<u32>::group(count, || (0..).zip(&sheets.of_face).map(|(face, &part)| (part, face)));
    let boxes: Vec<_> = (0..count).map(|part| bounds(mesh, faces.list(part))).collect();
    let own = (0..count).into_par_iter().map(|part| {
        let faces = faces.list(part);
        match sheets.is_closed[part] {
            true => volume(mesh, faces, boxes[part].0),
            false => bulge(mesh, faces),
        }
    });
    let own: Vec<f64> = own.collect();
    fn is_within(
        inner: usize,
        outer: usize,
        boxes: &[(Point3<f64>, Point3<f64>)],
        faces: &Lists,
        mesh: &Mesh,
    ) -> bool {
        let ((low, high), (outer_low, outer_high)) = (boxes[inner], boxes[outer]);
        let is_boxed = (0..3).all(|k| outer_low[k] < low[k] && high[k] < outer_high[k]);
        is_boxed && {
            let faces_of = faces.list(inner);
            let some = [0, faces_of.len() / 2, faces_of.len() - 1];
            some.into_iter().all(|place| {
                let vertex = mesh.faces().face(faces_of[place] as usize)[0];
                let at = mesh.positions()[vertex as usize];
                winding(mesh, faces.list(outer), at, None).abs() > 0.5
            })
        }
    }
    let is_shell: Vec<bool> =
        (0..count).map(|part| sheets.is_closed[part] && own[part] != 0.0).collect();
    let sides = (0..count).into_par_iter().map(|part| {
        if !is_shell[part] {
            return own[part];
        }
        let around = (0..count).filter(|&outer| outer != part && is_shell[outer]);
        let depth = around.filter(|&outer| is_within(part, outer, &boxes, &faces, mesh)).count();
        if depth % 2 == 1 { -own[part] } else { own[part] }
    });
    sides.collect()
}

fn bounds(mesh: &Mesh, faces: &[u32]) -> (Point3<f64>, Point3<f64>) {
    let faces = faces.iter().until_stopped();
    let corners = faces.flat_map(|&face| mesh.faces().face(face as usize));
    let places = corners.map(|&vertex| mesh.positions()[vertex as usize]);
    let infinite = Vector3::from_element(f64::INFINITY);
    let nothing = (Point3::from(infinite), Point3::from(-infinite));
    places.fold(nothing, |(low, high), at| (low.inf(&at), high.sup(&at)))
}

/// Returns six times the volume that closed faces enclose, computed relative to the point `near`; negative if the faces look inward.
fn volume(mesh: &Mesh, faces: &[u32], near: Point3<f64>) -> f64 {
    let faces = faces.iter().until_stopped();
    let triangles = faces.flat_map(|&face| fan(mesh, mesh.faces().face(face as usize)));
    triangles
        .map(|corners| corners.map(|corner| corner - near))
        .map(|[a, b, c]| a.dot(&b.cross(&c)))
        .sum()
}

/// Returns the winding number of faces around a point: the sum of their solid angles divided by 4 pi. The face `on`, which contains the
/// point, is left out.
fn winding(mesh: &Mesh, faces: &[u32], at: Point3<f64>, on: Option<u32>) -> f64 {
    let others = faces.iter().until_stopped().filter(|face| Some(**face) != on);
    let triangles = others.flat_map(|&face| fan(mesh, mesh.faces().face(face as usize)));
    let halves = triangles.map(|corners| half_solid_angle(corners, &at));
    halves.sum::<f64>() / std::f64::consts::TAU
}

/// Returns the mean winding number of an open part at its own faces; 0 if the winding number is too small to determine an outside.
///
/// Seen from a point on a face, the face itself has the solid angle 0, so the winding number is the mean of the values on both sides of the
/// face. For a closed surface, this is half of the value inside.
fn bulge(mesh: &Mesh, faces: &[u32]) -> f64 {
    let judges = (SOLID_ANGLES / faces.len()).clamp(*SAMPLED_FACES.start(), *SAMPLED_FACES.end());
    let step = faces.len().div_ceil(judges);
    let sampled: Vec<u32> = faces.iter().step_by(step).copied().collect();
    let judged = sampled.par_iter().map(|&face| {
        let corners = mesh.faces().face(face as usize);
        let first = fan(mesh, corners).next().expect("a face has three corners");
        let middle = first.iter().map(|corner| corner.coords).sum::<Vector3<f64>>() / 3.0;
        let area = mesh.area_vector(corners).norm();
        (area * winding(mesh, faces, middle.into(), Some(face)), area)
    });
    let judged: Vec<(f64, f64)> = judged.collect();
    let sum = judged.iter().fold((0.0, 0.0), |sum, it| (sum.0 + it.0, sum.1 + it.1));
    let mean = sum.0 / sum.1;
    if mean.abs() >= MIN_BULGE { mean } else { 0.0 }
}

/// Returns the triangles of a polygon, divided as a fan.
fn fan<'a>(mesh: &'a Mesh, face: &'a [u32]) -> impl Iterator<Item = [Point3<f64>; 3]> + 'a {
    face[1..].windows(2).map(move |pair| {
        [face[0], pair[0], pair[1]].map(|vertex: u32| mesh.positions()[vertex as usize])
    })
}
