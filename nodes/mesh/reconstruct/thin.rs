//! Parts whose opposite sides are near each other, compared with the spacing of the points.

use maquette_value::parallel::*;
use nalgebra::{Point3, Vector3};

use super::cells::Cube;
use super::cloud::Cloud;
use super::surfels::{Pyramid, Surfel, TWO_SHEETS, split};

/// Minimum distance of opposite sides, in cells, so that the function is above its value at the surface between them.
pub(super) const RESOLVED: f64 = 1.8;

/// Number of places at which opposite sides are looked for.
const SAMPLES: usize = 512;

/// Minimum number of points of a neighborhood in which two sides are looked for.
const MIN_POINTS: usize = 24;

/// Minimum fraction of the points of a neighborhood on each side.
const MIN_SIDE: f64 = 0.25;

/// Maximum number of times that neighborhoods are doubled until they have enough points.
const LARGER: u32 = 2;

/// Minimum fraction of the places with opposite sides; fewer may be due to chance.
const MIN_PLACES: f64 = 0.04;

/// Opposite sides of a thin part.
#[derive(Clone, Copy, Debug)]
pub(super) struct Gap {
    /// The distance of the sides, in mm.
    pub(super) width: f64,
    /// A point between the sides.
    pub(super) place: Point3<f64>,
    /// The standard deviation of the points from their side, in mm.
    pub(super) noise: f64,
}

/// Finds opposite sides that are near each other. Of the distances found, the result has the lower quartile. `None` if there are no such
/// sides, or if the sides of the points are known. `flat` is the depth at which most neighborhoods are flat. Sides nearer to each other
/// than the spacing of the points, `distance` in mm, cannot be told from chance.
pub(super) fn find_gap(pyramid: &Pyramid, cloud: &Cloud, flat: u32, distance: f64) -> Option<Gap> {
    if pyramid.min_gap == f64::INFINITY {
        return None;
    }
    let count = pyramid.finest().moments.len();
    let step = count.div_ceil(SAMPLES).max(1);
    let cells: Vec<usize> = (0..count).step_by(step).collect();
    let found: Vec<Option<Gap>> =
        cells.par_iter().map(|&cell: &usize| gap_at(pyramid, cloud, flat, cell)).collect();
    let mut gaps: Vec<Gap> =
        found.into_iter().flatten().filter(|gap| gap.width >= distance).collect();
    if (gaps.len() as f64) < MIN_PLACES * cells.len() as f64 {
        return None;
    }
    gaps.sort_by(|a, b| a.width.total_cmp(&b.width));
    gaps.get(gaps.len() / 4).copied()
}

/// Returns the gap between opposite sides in the neighborhood of a cell. The neighborhoods are those of a flat depth or, where the surface
/// is bent, of the next one; larger ones where they have too few points.
fn gap_at(pyramid: &Pyramid, cloud: &Cloud, flat: u32, cell: usize) -> Option<Gap> {
    let at = pyramid.finest().moments[cell].mean();
    let depths = flat.saturating_sub(LARGER).max(1)..=(flat + 1).min(pyramid.cube.depth);
    depths.rev().find_map(|depth| {
        let plane = pyramid.plane_of(&pyramid.sums_around(at, depth).0, depth)?;
        let middle = pyramid.cube.point(at, pyramid.cube.depth);
        let radius = pyramid.cube.edge_at(depth);
        let heights = heights(pyramid, cloud, &middle, radius, &plane.normal);
        if heights.len() < MIN_POINTS {
            return None;
        }
        let split = split(heights.iter().map(|&height| (height, 1.0)))
            .filter(|split| split.between > TWO_SHEETS)?;
        let lower = split.lower as f64 / heights.len() as f64;
        let is_pair = (MIN_SIDE..=1.0 - MIN_SIDE).contains(&lower);
        let between = (heights[split.lower - 1] + heights[split.lower]) / 2.0;
        is_pair.then(|| Gap {
            width: split.gap,
            place: middle + plane.normal * between,
            noise: split.deviation,
        })
    })
}

/// Returns the heights above a plane through `middle` of the points whose distance from its axis is at most `radius`, ascending. Points
/// farther from the plane than that are left out.
fn heights(
    pyramid: &Pyramid,
    cloud: &Cloud,
    middle: &Point3<f64>,
    radius: f64,
    normal: &Vector3<f64>,
) -> Vec<f64> {
    let cube = &pyramid.cube;
    let cells = &pyramid.finest().cells;
    let [low, high] = [-radius, radius].map(|offset| {
        cube.cell(cube.in_cells(&(middle + Vector3::repeat(offset)), cube.depth), cube.depth)
    });
    let mut heights = Vec::new();
    for z in low[2]..=high[2] {
        for y in low[1]..=high[1] {
            let row = cells.row(y, z);
            let first = cells.from(row.clone(), low[0]);
            for cell in (first..row.end).take_while(|&cell| cells.place(cell)[0] <= high[0]) {
                let points = pyramid.starts[cell] as usize..pyramid.starts[cell + 1] as usize;
                heights.extend(pyramid.order[points].iter().filter_map(|&point| {
                    let away = cloud.positions[point as usize] - middle;
                    (away.norm_squared() <= radius * radius).then(|| away.dot(normal))
                }));
            }
        }
    }
    heights.sort_by(f64::total_cmp);
    // Points that are there several times are no more evidence than one.
    heights.dedup();
    heights
}

/// Returns the depth of neighborhoods that show both of two opposite sides: at most `flat`.
pub(super) fn flat_depth(cube: &Cube, flat: u32) -> u32 {
    flat.min(cube.depth.saturating_sub(2)).max(1)
}

/// Maximum number of pieces along each side of a surfel.
const MAX_PIECES: u32 = 4;

/// Divides surfels larger than the cells into pieces along their planes, so that grids that are finer than the points have no holes. The
/// pieces are on the planes of the neighborhoods, because fine grids would follow the noise of single points.
pub(super) fn divide(pyramid: &Pyramid, surfels: &[Surfel]) -> Vec<Surfel> {
    let edge = pyramid.cube.edge;
    surfels
        .par_iter()
        .flat_map_iter(|surfel: &Surfel| {
            let surfel = *surfel;
            let pieces = (1..MAX_PIECES).find(|&k| surfel.spacing <= edge * f64::from(k));
            let pieces = pieces.unwrap_or(MAX_PIECES);
            let axes = tangents(&surfel.normal);
            (0..pieces * pieces).map(move |k| {
                let [u, v] = [k % pieces, k / pieces]
                    .map(|k| ((f64::from(k) + 0.5) / f64::from(pieces) - 0.5) * surfel.spacing);
                Surfel {
                    at: surfel.on_plane + axes[0] * u + axes[1] * v,
                    area: surfel.area / f64::from(pieces * pieces),
                    spacing: surfel.spacing / f64::from(pieces),
                    ..surfel
                }
            })
        })
        .collect()
}

/// Returns two unit vectors that are perpendicular to a unit normal and to each other; zero vectors if the normal is 0.
fn tangents(normal: &Vector3<f64>) -> [Vector3<f64>; 2] {
    let smallest = Vector3::ith(normal.iamin(), 1.0);
    let first = normal.cross(&smallest).try_normalize(0.0).unwrap_or_default();
    [first, normal.cross(&first)]
}
