//! Warnings about points that do not fit to one surface, and about parts of the result that are hardly wanted.

use maquette_value::Mesh;

use super::orient;
use super::pieces::Pieces;

/// Minimum fraction of opposite normals of near points for a warning; normals with random signs have a half.
const OPPOSED: f64 = 0.1;

/// Distance of a point from all others, in multiples of the points' spacing, from which it counts as isolated.
const ISOLATED: f64 = 5.0;

/// Maximum number of points of an isolated group.
const FEW: f64 = 3.0;

/// Minimum fraction of points that are far from the surface for a warning.
const MISSED: f64 = 0.005;

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

/// Returns a warning if a fraction of the points is far from the surface.
pub(super) fn about_thin_parts(missed: f64, spacing: f64) -> Option<String> {
    (missed > MISSED).then(|| {
        let percent = 100.0 * missed;
        format!(
            "{percent:.1} % of the points are farther than half of `spacing` from the surface, because they form parts thinner than {spacing} mm: choose a smaller `spacing`"
        )
    })
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
