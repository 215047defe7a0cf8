//! Warnings about points that do not fit to one surface, and about parts of the result that are hardly wanted.

use maquette_value::Mesh;
use nalgebra::{Point3, Vector3};

use super::contour::Skin;
use super::fit::Missed;
use super::orient;
use super::pieces::Pieces;
use super::thin::{Gap, RESOLVED};

/// Minimum fraction of opposite normals of near points for a warning; normals with random signs have a half.
const OPPOSED: f64 = 0.1;

/// Distance of a point from all others, in multiples of the points' spacing, from which it counts as isolated.
const ISOLATED: f64 = 5.0;

/// Maximum number of points of an isolated group.
const FEW: f64 = 3.0;

/// Minimum fraction of points that are far from the surface for a warning.
const MISSED: f64 = 0.005;

/// Minimum fraction of vertices far from all points for a warning.
const FILLED: f64 = 0.4;

/// Maximum area of a small part, as a fraction of the area of the largest part.
const SMALL: f64 = 0.01;

/// Returns warnings about outliers and about given normals that do not agree.
pub(super) fn about_points(pieces: &Pieces) -> Vec<String> {
    let mut warnings = Vec::new();
    let opposed = orient::opposed_fraction(&pieces.pyramid, &pieces.surfels);
    if opposed > OPPOSED {
        let percent = (100.0 * opposed).round();
        warnings.push(format!(
            "the given normals of neighboring points are opposite to each other in {percent} % of all cases: `normals: Estimated` ignores them"
        ));
    }
    let cube = &pieces.pyramid.cube;
    let depth = (0..=cube.depth).rev().find(|&it| cube.edge_at(it) >= ISOLATED * pieces.distance);
    let layer = &pieces.pyramid.layers[depth.unwrap_or(0) as usize];
    let isolated = (0..layer.cells.len())
        .filter(|&cell| {
            let near = layer.cells.neighbors(layer.cells.place(cell));
            near.map(|cell| layer.moments[cell].count).sum::<f64>() <= FEW
        })
        .map(|cell| layer.moments[cell].count);
    let count = isolated.sum::<f64>().round();
    if count > 0.0 {
        let away = ISOLATED * pieces.distance;
        warnings.push(format!(
            "{count} points are more than {away:.3} mm from all others, and may deform the surface: `RemoveOutliers` removes such points"
        ));
    }
    warnings
}

/// Returns a warning if a fraction of the points is far from the surface. `gap` is the distance of opposite sides, if it is known, and
/// `origin` the origin of the coordinates.
pub(super) fn about_thin_parts(
    missed: Missed,
    spacing: f64,
    gap: Option<Gap>,
    origin: &Vector3<f64>,
) -> Option<String> {
    let Missed { fraction, farthest } = missed;
    let place = format_place(&(farthest? + origin));
    let thickness = gap.map_or(f64::INFINITY, |gap| gap.width);
    let less = (thickness / RESOLVED).min(spacing / 2.0);
    (fraction > MISSED).then(|| {
        let percent = 100.0 * fraction;
        format!(
            "{percent:.1} % of the points are farther than half of `spacing` from the surface, the farthest near {place}, because they form parts thinner than {spacing} mm: choose a smaller `spacing`, such as {less:.3}"
        )
    })
}

/// Returns a warning if much of a closed surface is far from all points whose sides are not known: the points may be sides of a thin part
/// that were not told apart. `origin` is the origin of the coordinates.
pub(super) fn about_filled_parts(
    skin: &Skin,
    supported: &[bool],
    gap: Option<Gap>,
    origin: &Vector3<f64>,
) -> Option<String> {
    let all = skin.positions.iter().zip(supported);
    let filled: Vec<Point3<f64>> =
        all.filter(|(_, supported)| !**supported).map(|(at, _)| *at).collect();
    let fraction = filled.len() as f64 / supported.len().max(1) as f64;
    let sum: Vector3<f64> = skin.positions.iter().map(|at| at.coords).sum();
    let middle = Point3::from(sum / skin.positions.len().max(1) as f64);
    let farthest = filled
        .iter()
        .max_by(|a, b| (*a - middle).norm_squared().total_cmp(&(*b - middle).norm_squared()))?;
    let place = format_place(&(farthest + origin));
    let percent = (100.0 * fraction).round();
    let reason = match gap {
        Some(Gap { width, place, .. }) => {
            let place = format_place(&(place + origin));
            format!("opposite sides are only {width:.3} mm apart, as near {place}")
        }
        None => "of a part only one side was captured, or its sides were not told apart".into(),
    };
    (fraction > FILLED).then(|| {
        format!(
            "{percent} % of the surface is far from all points, most near {place}: {reason}; give the points normals, or use `skin: Open`"
        )
    })
}

fn format_place(at: &Point3<f64>) -> String {
    format!("({:.3}, {:.3}, {:.3})", at.x, at.y, at.z)
}

/// Returns a warning if there are parts far smaller than the largest one. `parts` is the part of each vertex.
pub(super) fn about_parts(mesh: &Mesh, parts: &[u32]) -> Option<String> {
    let count = parts.iter().max().map_or(0, |&last| last as usize + 1);
    let mut areas = vec![(0.0, 0_usize); count];
    for face in mesh.faces().iter() {
        let part = &mut areas[parts[face[0] as usize] as usize];
        part.0 += mesh.area_vector(face).norm();
        part.1 += 1;
    }
    let largest = areas.iter().map(|part| part.0).fold(0.0, f64::max);
    let small: Vec<_> = areas.iter().filter(|part| part.0 < SMALL * largest).collect();
    if small.is_empty() {
        return None;
    }
    let (number, faces) = (small.len(), small.iter().map(|part| part.1).sum::<usize>());
    let area = small.iter().map(|part| part.0).fold(0.0, f64::max);
    let parts = if number == 1 { "1 part is" } else { &format!("{number} parts are") };
    Some(format!(
        "{parts} smaller than a hundredth of the largest part: {faces} faces, at most {area:.3} mm2 each: `Pieces` keeps the largest part"
    ))
}
