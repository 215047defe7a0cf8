//! The triangles over a rim that bend least.

use nalgebra::{Point3, Vector3};

/// A triangle whose area is below this share of the square of its longest edge has no side that it looks to.
const FLAT: f64 = 1e-10;

/// How much a face without a side counts as bent: as if folded.
const FOLDED: f64 = 2.0;

/// What is known of the part of the rim from one vertex to another.
#[derive(Clone, Copy)]
pub(crate) struct Part {
    /// One less the cosine of the sharpest bend in it; infinite if it cannot be covered.
    bend: f64,
    area: f64,
    /// The normal of the triangle at the chord.
    normal: Vector3<f64>,
    /// The third corner of that triangle.
    apex: u32,
}

/// The best of all triangulations.
pub(crate) fn least_bent(
    points: &[Point3<f64>],
    normals: &[Vector3<f64>],
    is_taken: &dyn Fn(usize, usize) -> bool,
) -> Option<Vec<[u32; 3]>> {
    let count = points.len();
    // Bends also by themselves: nearly always one of the two parts is worse by itself than the best that is known.
    let mut bends = vec![f64::INFINITY; count * count];
    let none = Part { bend: f64::INFINITY, area: 0.0, normal: Vector3::zeros(), apex: 0 };
    let mut parts = vec![none; count * count];
    for k in 0..count - 1 {
        parts[k * count + k + 1] = Part { bend: 0.0, normal: normals[k], ..none };
        // The same turned around, so that both sides of a search lie in rows.
        parts[(k + 1) * count + k] = parts[k * count + k + 1];
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
            let best = best_apex(points, &parts, &bends, [from, to], beyond);
            parts[from * count + to] = best;
            parts[to * count + from] = best;
            bends[from * count + to] = best.bend;
            bends[to * count + from] = best.bend;
        }
    }
    if parts[count - 1].bend.is_infinite() {
        return None;
    }
    let mut faces = Vec::with_capacity(count - 2);
    let mut open = vec![(0, count - 1)];
    while let Some((from, to)) = open.pop() {
        if to - from < 2 {
            continue;
        }
        let apex = parts[from * count + to].apex as usize;
        faces.push([from as u32, apex as u32, to as u32]);
        open.extend([(from, apex), (apex, to)]);
    }
    Some(faces)
}

fn best_apex(
    points: &[Point3<f64>],
    parts: &[Part],
    bends: &[f64],
    [from, to]: [usize; 2],
    beyond: Option<Vector3<f64>>,
) -> Part {
    let count = points.len();
    let mut best =
        Part { bend: f64::INFINITY, area: f64::INFINITY, normal: Vector3::zeros(), apex: 0 };
    let left = &bends[from * count + from + 1..from * count + to];
    let right = &bends[to * count + from + 1..to * count + to];
    let chord = points[to] - points[from];
    let length_sq = chord.norm_squared();
    for ((apex, &left), &right) in (from + 1..).zip(left).zip(right) {
        let bend = if left > right { left } else { right };
        if bend > best.bend || bend == f64::INFINITY {
            continue;
        }
        let (left, right) = (&parts[from * count + apex], &parts[to * count + apex]);
        let spoke = points[apex] - points[from];
        let normal = spoke.cross(&chord);
        let size = normal.norm();
        let longest = length_sq.max(spoke.norm_squared());
        let (normal, bend) = if size <= FLAT * longest {
            (Vector3::zeros(), FOLDED)
        } else {
            let normal = normal / size;
            let turn = |other: Vector3<f64>| 1.0 - normal.dot(&other);
            let bend = bend.max(turn(left.normal)).max(turn(right.normal));
            (normal, beyond.map_or(bend, |other| bend.max(turn(other))))
        };
        let area = size + left.area + right.area;
        if bend < best.bend || (bend == best.bend && area < best.area) {
            best = Part { bend, area, normal, apex: apex as u32 };
        }
    }
    best
}
