//! Adjusts the dihedral angles of a fill's edges to the distribution of the angles around the hole.
//!
//! The mean of many copied patches bends too evenly: its crests are rounded, and between them it is less flat than the input surface.
//! Therefore the fill's edges are ranked by the size of their angles. Each edge gets the angle of the edge around the hole that has the
//! same rank, and keeps the sign of its own angle. The ranking, and with it the pattern, is kept: edges along a groove stay flat, edges
//! across it become sharp.
//!
//! Matching by ranks: Heeger and Bergen, "Pyramid-based texture analysis/synthesis" (1995), section 3.1, which ranks pixel values.
//! Angles and their gradients: Grinspun, Hirani, Desbrun and Schröder, "Discrete shells" (2003).

use maquette_base::linear::cholesky::{Cholesky, Symmetric};
use maquette_node::{CancelledError, Progress};
use nalgebra::{Point3, Vector3};

use super::hole::Hole;
use super::surface::{NONE, Surface};
use super::surroundings::Surroundings;

/// Stiffness that holds vertices at their positions, times the squared mean edge length of the input mesh. With 1, a motion by one edge
/// length counts as much as an angle error of one radian. With 0.2, crests become spikes on curly surfaces.
const STIFFNESS: f64 = 1.0;

/// Number of rounds. Several are needed because ranks change while vertices move: after half as many rounds, the angles of flat edges on
/// curly surfaces are still wrong by a quarter.
const ROUNDS: usize = 16;

/// The fractions of their motion that vertices keep, if with the whole motion an angle would be larger than all around the hole.
const FRACTIONS: [f64; 4] = [0.9, 0.75, 0.5, 0.25];

/// Minimum number of edges around a hole; fewer edges do not give a reliable distribution of angles.
const MIN_EDGES: usize = 100;

/// Moves the vertices of the fill along their `normals` until the edges in each hole have the same angle distribution as the edges around
/// it. No angle becomes larger than all angles around the hole. Vertices for which `sharp` is true do not move.
///
/// # Errors
/// Returns an error if the evaluation is cancelled.
pub(super) fn match_dihedral_angles(
    surface: &Surface<'_>,
    points: &mut [Point3<f64>],
    normals: &[Vector3<f64>],
    hole: &Hole,
    around: &Surroundings,
    sharp: &[bool],
    progress: &Progress<'_>,
) -> Result<(), CancelledError> {
    let data = points.len() - normals.len();
    let goals = angles_around_holes(surface, points, data, hole, around);
    let moves = |vertex: u32| {
        let missing = (vertex as usize).checked_sub(data)?;
        (sharp.get(missing) != Some(&true)).then_some(missing)
    };
    let mut hinges: Vec<Hinge> = hinges(surface)
        .filter_map(|corners| {
            let number = hole.numbers[corners.into_iter().find_map(moves)?];
            let is_missing = corners.map(|corner| data <= corner as usize);
            let is_inside = is_missing[0] || is_missing[1] || (is_missing[2] && is_missing[3]);
            let gradients = angle_gradients(corners, points);
            let slopes = std::array::from_fn(|k: usize| {
                moves(corners[k]).map_or(0.0, |missing| gradients[k].dot(&normals[missing]))
            });
            Some(Hinge { corners, hole: number, is_inside, angle: 0.0, slopes })
        })
        .collect();
    let stiff = STIFFNESS / (hole.edge * hole.edge);
    let Some(factors) = Cholesky::new(&equations(&hinges, data, normals.len(), stiff)) else {
        return Ok(());
    };
    let (start, fills) = (points[data..].to_vec(), hole.fills(data));
    let mut moved = vec![0.0; normals.len()];
    for _ in 0..ROUNDS {
        progress.check()?;
        hinges.iter_mut().for_each(|hinge| hinge.angle = dihedral_angle(hinge.corners, points));
        // Rank edges at the rim of a hole separately from inner edges.
        hinges.sort_by(|a, b| {
            fn part(hinge: &Hinge) -> (u32, bool) {
                (hinge.hole, hinge.is_inside)
            }
            part(a).cmp(&part(b)).then(a.angle.abs().total_cmp(&b.angle.abs()))
        });
        let mut load: Vec<[f64; 3]> = moved.iter().map(|far| [-stiff * far, 0.0, 0.0]).collect();
        for part in hinges.chunk_by(|a, b| (a.hole, a.is_inside) == (b.hole, b.is_inside)) {
            let goal = &goals[part[0].hole as usize];
            if goal.len() < MIN_EDGES {
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
    for fill in hinges.chunk_by(|a, b| a.hole == b.hole) {
        let number = fill[0].hole as usize;
        let max = goals[number].last().copied().unwrap_or(0.0);
        limit_angles(fill, max, &fills[number], &start, points);
    }
    Ok(())
}

/// Moves the vertices of a fill back towards their positions in `start` until no angle exceeds `max` or the largest angle at the start,
/// whichever is larger. `start` has the positions of all vertices of fills.
fn limit_angles(
    hinges: &[Hinge],
    max: f64,
    fill: &[u32],
    start: &[Point3<f64>],
    points: &mut [Point3<f64>],
) {
    let data = points.len() - start.len();
    let end: Vec<Point3<f64>> = fill.iter().map(|&vertex| points[vertex as usize]).collect();
    let mut largest_at = |fraction: f64| {
        for (&vertex, end) in fill.iter().zip(&end) {
            let start = start[vertex as usize - data];
            points[vertex as usize] = start + (end - start) * fraction;
        }
        let angles = hinges.iter().map(|hinge| dihedral_angle(hinge.corners, points).abs());
        angles.fold(0.0, f64::max)
    };
    let max = max.max(largest_at(0.0));
    // The fraction 0 is left if no other is good enough.
    if largest_at(1.0) <= max || FRACTIONS.into_iter().any(|fraction| largest_at(fraction) <= max) {
        return;
    }
    largest_at(0.0);
}

/// An edge that has two faces, of which at least one has a corner that moves.
struct Hinge {
    corners: [u32; 4],
    /// The index of the hole that contains the edge.
    hole: u32,
    /// True if both faces have a vertex of the fill.
    is_inside: bool,
    angle: f64,
    /// The derivative of the angle as each corner moves along its normal; 0 for corners that do not move.
    slopes: [f64; 4],
}

/// Returns the ends of each edge that has two faces, followed by the two opposite corners.
pub(super) fn hinges(surface: &Surface<'_>) -> impl Iterator<Item = [u32; 4]> {
    let hinge = |face: u32, k: usize| {
        let other = surface.adjacent_face(face, k);
        let [a, b, c] = [0, 1, 2].map(|j| surface.faces[face as usize][(k + j) % 3]);
        (face < other.face && other.face != NONE).then_some([a, b, c, other.across])
    };
    (0..surface.faces.len() as u32).flat_map(move |face| (0..3).filter_map(move |k| hinge(face, k)))
}

/// Returns, for each hole, the absolute angles of the input mesh's edges around the hole, in radians and in ascending order.
fn angles_around_holes(
    surface: &Surface<'_>,
    points: &[Point3<f64>],
    data: usize,
    hole: &Hole,
    around: &Surroundings,
) -> Vec<Vec<f64>> {
    let mut numbers = vec![NONE; data];
    for number in 0..hole.count() {
        around.weighted(number).for_each(|near| numbers[near.vertex as usize] = number as u32);
    }
    let mut angles = vec![Vec::new(); hole.count()];
    for corners in hinges(surface) {
        if corners.iter().any(|&corner| data <= corner as usize) {
            continue;
        }
        let [number, other, ..] = corners.map(|corner| numbers[corner as usize]);
        if number != NONE && other != NONE {
            angles[number as usize].push(dihedral_angle(corners, points).abs());
        }
    }
    angles.iter_mut().for_each(|angles| angles.sort_by(f64::total_cmp));
    angles
}

/// Returns the dihedral angle of an edge in radians; negative in a valley, and 0 if a face has no area.
pub(super) fn dihedral_angle(corners: [u32; 4], points: &[Point3<f64>]) -> f64 {
    let [a, b, c, d] = corners.map(|corner| points[corner as usize]);
    let along = b - a;
    let [one, two] = [along.cross(&(c - a)), (d - a).cross(&along)];
    let sine = one.cross(&two).dot(&along.try_normalize(0.0).unwrap_or_default());
    libm::atan2(sine, one.dot(&two))
}

/// Returns the gradient of the dihedral angle with respect to each corner; 0 if a face has no area.
pub(super) fn angle_gradients(corners: [u32; 4], points: &[Point3<f64>]) -> [Vector3<f64>; 4] {
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

/// Returns the normal equations for the motions of the fill's `count` vertices, whose indices follow those of the `data` input vertices.
fn equations(hinges: &[Hinge], data: usize, count: usize, stiff: f64) -> Symmetric {
    let mut entries: Vec<(u32, u32, f64)> = (0..count as u32).map(|k| (k, k, stiff)).collect();
    let data = data as u32;
    for Hinge { corners, slopes, .. } in hinges {
        for j in (0..4).filter(|&j| data <= corners[j]) {
            for k in (0..4).filter(|&k| data <= corners[k]) {
                entries.push((corners[j] - data, corners[k] - data, slopes[j] * slopes[k]));
            }
        }
    }
    // The sort must be stable, so that entries with the same row and column are summed in a fixed order.
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
