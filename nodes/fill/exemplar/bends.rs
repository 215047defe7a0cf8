//! Gives the dihedral angles of the filled edges the distribution of those around the hole.
//!
//! The mean of many exemplars bends too evenly: its crests are dull, and between them it is not as flat as the data. So filled edges are
//! ranked by the size of their angles, and each gets the angle of the edge of the same rank around the hole, to the side to which it bends
//! already. The order stays, and so does the pattern: along a groove edges stay flat, and across it they become sharp.
//!
//! Ranks: Heeger and Bergen, "Pyramid-based texture analysis/synthesis" (1995), section 3.1, there for the values of pixels. Angles and
//! their gradients: Grinspun, Hirani, Desbrun and Schröder, "Discrete shells" (2003).

use maquette_base::linear::cholesky::{Cholesky, Symmetric};
use maquette_node::{Cancelled, Progress};
use nalgebra::{Point3, Vector3};

use super::hole::Hole;
use super::surface::{NONE, Surface};

/// How strongly vertices stay where they are, over the squared length of the data's edges: with 1, to move by an edge counts as much as an
/// angle that is off by a radian. With a fifth of it, crests over curls become spikes.
const HOLD: f64 = 1.0;

/// Rounds, as ranks change while vertices move. After half as many, flat edges of curls are a quarter off.
const ROUNDS: usize = 16;

/// How far around a hole the data counts, in the distance that the hole reaches from its rim: as wide as it is across.
const AROUND: f64 = 2.0;

/// With fewer edges around a hole, their distribution is not known well enough.
const FEWEST: usize = 100;

/// Moves the vertices of `points` that are missing along their `normals` until the edges bend as those around each hole. The `sharp` ones
/// stay.
///
/// # Errors
/// If the evaluation is told to stop.
pub(super) fn bend_alike(
    surface: &Surface<'_>,
    points: &mut [Point3<f64>],
    normals: &[Vector3<f64>],
    hole: &Hole,
    sharp: &[bool],
    progress: &Progress<'_>,
) -> Result<(), Cancelled> {
    let data = points.len() - normals.len();
    let goals = around(surface, points, data, hole);
    let moves = |vertex: u32| {
        let missing = (vertex as usize).checked_sub(data)?;
        (sharp.get(missing) != Some(&true)).then_some(missing)
    };
    let mut hinges: Vec<Hinge> = hinges(surface)
        .filter_map(|corners| {
            let number = hole.numbers[corners.into_iter().find_map(moves)?];
            let is_missing = corners.map(|corner| data <= corner as usize);
            let is_inside = is_missing[0] || is_missing[1] || (is_missing[2] && is_missing[3]);
            let slopes = slopes(corners, points);
            let slopes = std::array::from_fn(|k: usize| {
                moves(corners[k]).map_or(0.0, |missing| slopes[k].dot(&normals[missing]))
            });
            Some(Hinge { corners, hole: number, is_inside, angle: 0.0, slopes })
        })
        .collect();
    let stiff = HOLD / (hole.edge * hole.edge);
    let Some(factors) = Cholesky::new(&equations(&hinges, data, normals.len(), stiff)) else {
        return Ok(());
    };
    let mut moved = vec![0.0; normals.len()];
    for _ in 0..ROUNDS {
        progress.check()?;
        hinges.iter_mut().for_each(|hinge| hinge.angle = angle(hinge.corners, points));
        // Those at the rim, where the data end, have ranks of their own.
        hinges.sort_by(|a, b| {
            fn part(hinge: &Hinge) -> (u32, bool) {
                (hinge.hole, hinge.is_inside)
            }
            part(a).cmp(&part(b)).then(a.angle.abs().total_cmp(&b.angle.abs()))
        });
        let mut load: Vec<[f64; 3]> = moved.iter().map(|far| [-stiff * far, 0.0, 0.0]).collect();
        for part in hinges.chunk_by(|a, b| (a.hole, a.is_inside) == (b.hole, b.is_inside)) {
            let goal = &goals[part[0].hole as usize];
            if goal.len() < FEWEST {
                continue;
            }
            for (rank, hinge) in part.iter().enumerate() {
                let wanted = goal[(2 * rank + 1) * goal.len() / (2 * part.len())];
                let miss = wanted.copysign(hinge.angle) - hinge.angle;
                for (corner, slope) in hinge.corners.iter().zip(hinge.slopes) {
                    if let Some(missing) = moves(*corner) {
                        load[missing][0] += slope * miss;
                    }
                }
            }
        }
        factors.solve(&mut load);
        for (missing, [far, ..]) in load.into_iter().enumerate() {
            moved[missing] += far;
            points[data + missing] += normals[missing] * far;
        }
    }
    Ok(())
}

/// An edge that bends as vertices move.
struct Hinge {
    corners: [u32; 4],
    /// The number of its hole.
    hole: u32,
    /// Whether both of its faces have a missing vertex.
    is_inside: bool,
    angle: f64,
    /// How the angle changes as each corner moves along its normal; 0 for those that stay.
    slopes: [f64; 4],
}

/// The ends of each edge that has two faces, and the corners across it.
pub(super) fn hinges(surface: &Surface<'_>) -> impl Iterator<Item = [u32; 4]> {
    let hinge = |face: u32, k: usize| {
        let other = surface.beside(face, k);
        let [a, b, c] = [0, 1, 2].map(|j| surface.faces[face as usize][(k + j) % 3]);
        (face < other.face && other.face != NONE).then_some([a, b, c, other.across])
    };
    (0..surface.faces.len() as u32).flat_map(move |face| (0..3).filter_map(move |k| hinge(face, k)))
}

/// By how much the edges around each hole bend, in ascending order.
fn around(
    surface: &Surface<'_>,
    points: &[Point3<f64>],
    data: usize,
    hole: &Hole,
) -> Vec<Vec<f64>> {
    let missing = data as u32..points.len() as u32;
    let nearest = surface.nearest(points, missing, AROUND * hole.width);
    let near = |vertex: u32| {
        let missing = (nearest[vertex as usize] as usize).checked_sub(data)?;
        let far = (points[vertex as usize] - points.get(data + missing)?).norm();
        (far <= AROUND * hole.widths[missing]).then_some(hole.numbers[missing])
    };
    let count = hole.numbers.iter().max().map_or(0, |most| most + 1);
    let mut angles = vec![Vec::new(); count as usize];
    for corners in hinges(surface) {
        if corners.iter().any(|&corner| data <= corner as usize) {
            continue;
        }
        if let (Some(number), Some(_)) = (near(corners[0]), near(corners[1])) {
            angles[number as usize].push(angle(corners, points).abs());
        }
    }
    angles.iter_mut().for_each(|angles| angles.sort_by(f64::total_cmp));
    angles
}

/// By how much an edge bends, in radians; less than 0 in a valley, and 0 where a face has no area.
pub(super) fn angle(corners: [u32; 4], points: &[Point3<f64>]) -> f64 {
    let [a, b, c, d] = corners.map(|corner| points[corner as usize]);
    let along = b - a;
    let [one, two] = [along.cross(&(c - a)), (d - a).cross(&along)];
    let sine = one.cross(&two).dot(&along.try_normalize(0.0).unwrap_or_default());
    libm::atan2(sine, one.dot(&two))
}

/// The gradient of the angle at each corner; 0 where a face has no area.
pub(super) fn slopes(corners: [u32; 4], points: &[Point3<f64>]) -> [Vector3<f64>; 4] {
    let [a, b, c, d] = corners.map(|corner| points[corner as usize]);
    let along = b - a;
    let length = along.norm();
    let [one, two] =
        [along.cross(&(c - a)), (d - a).cross(&along)].map(|area| area / area.norm_squared());
    fn share(from: Point3<f64>, to: Point3<f64>, along: Vector3<f64>, length: f64) -> f64 {
        (to - from).dot(&along) / length
    }
    let slopes = [
        -one * share(b, c, along, length) - two * share(b, d, along, length),
        one * share(a, c, along, length) + two * share(a, d, along, length),
        -one * length,
        -two * length,
    ];
    let is_finite = slopes.iter().flatten().all(|slope| slope.is_finite());
    if is_finite { slopes } else { Default::default() }
}

/// The normal equations of the motions of so many missing vertices, behind the `data`, that change the angles as wanted.
fn equations(hinges: &[Hinge], data: usize, count: usize, stiff: f64) -> Symmetric {
    let mut entries: Vec<(u32, u32, f64)> = (0..count as u32).map(|k| (k, k, stiff)).collect();
    let data = data as u32;
    for Hinge { corners, slopes, .. } in hinges {
        let ends = || (0..4).filter(|&k| data <= corners[k]);
        entries.extend(ends().flat_map(|j| {
            ends().map(move |k| (corners[j] - data, corners[k] - data, slopes[j] * slopes[k]))
        }));
    }
    // The order of equal places is kept, and so that of their sum.
    entries.sort_by_key(|&(row, column, _)| (row, column));
    let mut matrix = Symmetric { starts: vec![0], indices: vec![], entries: vec![] };
    for sums in entries.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
        let (row, column, _) = sums[0];
        if matrix.starts.len() <= row as usize {
            matrix.starts.push(matrix.indices.len() as u32);
        }
        matrix.indices.push(column);
        matrix.entries.push(sums.iter().map(|&(.., entry)| entry).sum());
    }
    matrix.starts.push(matrix.indices.len() as u32);
    matrix
}
