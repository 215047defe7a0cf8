//! The minimum-weight triangulation of a hole's rim, by dynamic programming over parts of the rim.

use nalgebra::{Point3, Vector3};

/// A triangle whose area is below this fraction of the square of its longest edge has no reliable normal.
const FLAT: f64 = 1e-10;

/// The bend assigned to an edge of a triangle without a reliable normal: the maximum, as if the triangles were folded.
const FOLDED: f64 = 2.0;

/// The best triangulation of a sub-polygon: the part of the rim from one vertex to another, closed by the straight edge (chord) between
/// them.
#[derive(Clone, Copy)]
struct SubPolygon {
    /// One minus the cosine of the largest angle between normals of adjacent triangles; infinite if the sub-polygon has no triangulation.
    bend: f64,
    area: f64,
    /// The normal of the triangle at the chord.
    normal: Vector3<f64>,
    /// The third corner of the triangle at the chord.
    apex: u32,
}

/// Returns the best triangulation of a hole's rim; `None` if every triangulation contains an edge for which `is_taken` is true.
pub(crate) fn min_weight(
    points: &[Point3<f64>],
    normals: &[Vector3<f64>],
    is_taken: &dyn Fn(usize, usize) -> bool,
) -> Option<Vec<[u32; 3]>> {
    let count = points.len();
    // Store bends also in a separate table, for a fast test: nearly always, one sub-polygon alone bends more than the best triangulation so
    // far.
    let mut bends = vec![f64::INFINITY; count * count];
    let none = SubPolygon { bend: f64::INFINITY, area: 0.0, normal: Vector3::zeros(), apex: 0 };
    let mut polygons = vec![none; count * count];
    for k in 0..count - 1 {
        polygons[k * count + k + 1] = SubPolygon { bend: 0.0, normal: normals[k], ..none };
        // Make the table symmetric, so that both sub-polygons of an apex are read from rows, which are contiguous in memory.
        polygons[(k + 1) * count + k] = polygons[k * count + k + 1];
        bends[k * count + k + 1] = 0.0;
        bends[(k + 1) * count + k] = 0.0;
    }
    for length in 2..count {
        for from in 0..count - length {
            let to = from + length;
            let is_last = length == count - 1;
            if !is_last && is_taken(from, to) {
                continue;
            }
            let beyond = is_last.then(|| normals[to]);
            let best = best_apex(points, &polygons, &bends, [from, to], beyond);
            polygons[from * count + to] = best;
            polygons[to * count + from] = best;
            bends[from * count + to] = best.bend;
            bends[to * count + from] = best.bend;
        }
    }
    if polygons[count - 1].bend.is_infinite() {
        return None;
    }
    let mut faces = Vec::with_capacity(count - 2);
    let mut open = vec![(0, count - 1)];
    while let Some((from, to)) = open.pop() {
        if to - from < 2 {
            continue;
        }
        let apex = polygons[from * count + to].apex as usize;
        faces.push([from as u32, apex as u32, to as u32]);
        open.extend([(from, apex), (apex, to)]);
    }
    Some(faces)
}

fn best_apex(
    points: &[Point3<f64>],
    polygons: &[SubPolygon],
    bends: &[f64],
    [from, to]: [usize; 2],
    beyond: Option<Vector3<f64>>,
) -> SubPolygon {
    let count = points.len();
    let mut best =
        SubPolygon { bend: f64::INFINITY, area: f64::INFINITY, normal: Vector3::zeros(), apex: 0 };
    let left = &bends[from * count + from + 1..from * count + to];
    let right = &bends[to * count + from + 1..to * count + to];
    let chord = points[to] - points[from];
    let length_sq = chord.norm_squared();
    for ((apex, &left), &right) in (from + 1..).zip(left).zip(right) {
        let bend = if left > right { left } else { right };
        if bend > best.bend || bend == f64::INFINITY {
            continue;
        }
        let (left, right) = (&polygons[from * count + apex], &polygons[to * count + apex]);
        let spoke = points[apex] - points[from];
        let normal = spoke.cross(&chord);
        let size = normal.norm();
        let longest = length_sq.max(spoke.norm_squared());
        let (normal, bend) = if size <= FLAT * longest {
            (Vector3::zeros(), FOLDED)
        } else {
            let normal = normal / size;
            fn bend_between(other: Vector3<f64>, normal: Vector3<f64>) -> f64 {
                1.0 - normal.dot(&other)
            }
            let bend =
                bend.max(bend_between(left.normal, normal)).max(bend_between(right.normal, normal));
            (normal, beyond.map_or(bend, |other| bend.max(bend_between(other, normal))))
        };
        let area = size + left.area + right.area;
        if bend < best.bend || (bend == best.bend && area < best.area) {
            best = SubPolygon { bend, area, normal, apex: apex as u32 };
        }
    }
    best
}
