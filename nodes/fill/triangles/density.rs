//! Isotropic remeshing: brings the triangles to a wanted size by edge splits, collapses and flips, and tangential relaxation.
//!
//! Botsch and Kobbelt, "A remeshing approach to multiresolution modeling" (2004), section 4, except that edges are flipped where the
//! angles opposite to them add up to more than two right ones.

use std::collections::VecDeque;

use maquette_node::{Cancelled, Limit, Progress};
use nalgebra::{Point3, Vector3};

use super::triangulation::{NONE, Triangulation, area_vector, next, previous};

/// An edge longer than this many times its target is split. Both halves are longer than [`SHORT`] targets up to 1.6, so that
/// splitting and collapsing do not alternate.
const LONG: f64 = 4.0 / 3.0;

/// An edge shorter than this many times its target is collapsed.
const SHORT: f64 = 0.8;

/// Passes over all edges; four or five are the rule.
const MOST_PASSES: usize = 20;

/// Passes end when at most one of so many edges changed: later ones move few vertices, and those little.
const CONVERGED: usize = 100;

/// Least cosine of the angle by which a face may turn when an edge collapses: 75 degrees.
const LEAST_COSINE: f64 = 0.25881904510252074;

/// Flips of one pass, for each edge: in a plane all edges together need fewer than the square of their number, and about one.
const MOST_FLIPS: usize = 10;

/// The most triangles of one fill: more take minutes and some GB, and nearly always come from a vertex of the rim that lies far off.
pub(crate) const TRIANGLES: Limit = Limit {
    most: 1_000_000,
    of: "triangles",
    help: "see whether a vertex of the rim lies far off or `edges` are too short, or leave the rim out by `holes: Edges` or `holes: Loops`",
};

/// Why a triangulation is not refined.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Stop {
    /// The evaluation was told to stop.
    Cancelled,
    /// It would have about so many triangles.
    TooMany(f64),
}

impl From<Cancelled> for Stop {
    fn from(_: Cancelled) -> Self {
        Self::Cancelled
    }
}

/// Brings the edges of `triangulation` near `target`, which is asked at each vertex once: at the rim, and where an edge is split.
///
/// # Errors
/// If it would have too many triangles, or the evaluation is told to stop.
pub(crate) fn refine(
    triangulation: &mut Triangulation,
    target: impl Fn(Point3<f64>) -> f64,
    progress: &Progress<'_>,
) -> Result<(), Stop> {
    let mut sizes: Vec<f64> = triangulation.points.iter().map(|&point| target(point)).collect();
    for _ in 0..MOST_PASSES {
        let split = split_long(triangulation, &mut sizes, &target, progress)?;
        flip_all(triangulation, progress)?;
        let collapsed = collapse_short(triangulation, &sizes, progress)?;
        if !collapsed.is_empty() {
            let edges = edges_near(triangulation, &collapsed);
            flip(triangulation, edges, progress)?;
        }
        relax(triangulation, progress)?;
        if split + collapsed.len() <= triangulation.corners.len() / 2 / CONVERGED {
            break;
        }
    }
    Ok(flip_all(triangulation, progress)?)
}

/// The area of a triangle whose edges are 1.
const EQUILATERAL: f64 = 0.4330127018922193;

/// About how many triangles [`refine`] makes of `triangulation`. Triangles much larger than wanted are divided, at most `divisions`
/// times.
pub(crate) fn estimate(
    triangulation: &Triangulation,
    target: impl Fn(Point3<f64>) -> f64,
    divisions: usize,
) -> f64 {
    let faces = triangulation.corners.as_chunks::<3>().0.iter().filter(|face| face[0] != NONE);
    let mut open: VecDeque<[(Point3<f64>, f64); 3]> = faces
        .map(|face| {
            face.map(|vertex: u32| {
                (
                    triangulation.points[vertex as usize],
                    target(triangulation.points[vertex as usize]),
                )
            })
        })
        .collect();
    let (mut need, mut left) = (0.0, divisions);
    while let Some(corners) = open.pop_front() {
        fn length(k: usize, corners: &[(Point3<f64>, f64); 3]) -> f64 {
            (corners[(k + 1) % 3].0 - corners[k].0).norm()
        }
        let first = (0..3)
            .max_by(|&a, &b| length(a, &corners).total_cmp(&length(b, &corners)))
            .unwrap_or(0);
        let [a, b, c] = [0, 1, 2].map(|k| corners[(first + k) % 3]);
        let size = ((a.1 + b.1 + c.1) / 3.0).max(f64::MIN_POSITIVE);
        let longest = length(first, &corners);
        if LONG * size < longest && left > 0 {
            left -= 1;
            let middle = nalgebra::center(&a.0, &b.0);
            let middle = (middle, target(middle));
            open.extend([[a, middle, c], [middle, b, c]]);
        } else if longest > 0.0 {
            // Thin ones are cut along their length, too.
            let (times, width) = (longest / size, area_vector([a.0, b.0, c.0]).norm() / longest);
            let along = if LONG < times { 2.0 * times } else { 0.0 };
            need += times * (width / size) / (2.0 * EQUILATERAL) + along;
        }
    }
    need
}

fn wanted(triangulation: &Triangulation, sizes: &[f64], half: u32) -> f64 {
    let [a, b] = triangulation.ends(half);
    (sizes[a as usize] + sizes[b as usize]) / 2.0
}

/// Splits the edges that are too long, the longest first.
fn split_long(
    triangulation: &mut Triangulation,
    sizes: &mut Vec<f64>,
    target: &impl Fn(Point3<f64>) -> f64,
    progress: &Progress<'_>,
) -> Result<usize, Stop> {
    fn excess(half: u32, triangulation: &Triangulation, sizes: &[f64]) -> f64 {
        triangulation.length(half) / wanted(triangulation, sizes, half)
    }
    let mut long: Vec<(f64, u32)> = triangulation
        .inner_edges()
        .map(|half| (excess(half, triangulation, sizes), half))
        .filter(|(excess, _)| *excess > LONG)
        .collect();
    long.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let mut count = 0;
    for (excess, half) in long {
        // A split nearby may have given this half-edge to another edge.
        let twin = triangulation.twins[half as usize];
        if twin == NONE
            || triangulation.length(half) < excess * wanted(triangulation, sizes, half) * 0.999
        {
            continue;
        }
        let [a, b] = triangulation.ends(half).map(|vertex| triangulation.points[vertex as usize]);
        let middle = nalgebra::center(&a, &b);
        triangulation.split(half, middle);
        sizes.push(target(middle));
        count += 1;
        progress.check()?;
        if 3 * TRIANGLES.most < triangulation.corners.len() {
            return Err(Stop::TooMany(estimate(triangulation, target, 0)));
        }
    }
    Ok(count)
}

/// Flips edges until none is left that should be.
fn flip_all(triangulation: &mut Triangulation, progress: &Progress<'_>) -> Result<(), Cancelled> {
    let edges = triangulation.inner_edges().collect();
    flip(triangulation, edges, progress)
}

/// The inner edges with an end in the one-ring of one of these vertices. If these vertices alone have changed since all edges were
/// flipped, only such edges may have to be flipped now.
fn edges_near(triangulation: &Triangulation, vertices: &[u32]) -> Vec<u32> {
    let mut near = vec![false; triangulation.points.len()];
    vertices.iter().for_each(|&vertex| near[vertex as usize] = true);
    let faces = triangulation.corners.as_chunks::<3>().0;
    let all = faces.iter().filter(|face| face[0] != NONE);
    let next_to: Vec<[u32; 3]> =
        all.filter(|face| face.iter().any(|&vertex| near[vertex as usize])).copied().collect();
    next_to.as_flattened().iter().for_each(|&vertex| near[vertex as usize] = true);
    let is_near =
        |&half: &u32| triangulation.ends(half).iter().any(|&vertex| near[vertex as usize]);
    triangulation.inner_edges().filter(is_near).collect()
}

/// Flips these edges, and those that should be flipped then.
fn flip(
    triangulation: &mut Triangulation,
    mut queue: Vec<u32>,
    progress: &Progress<'_>,
) -> Result<(), Cancelled> {
    queue.reverse();
    let mut left = MOST_FLIPS * queue.len();
    while let Some(half) = queue.pop() {
        progress.check()?;
        if left == 0 {
            break;
        }
        if !triangulation.is_alive(half) || !should_flip(triangulation, half) {
            continue;
        }
        triangulation.flip(half);
        left -= 1;
        let (f, g) = (half / 3 * 3, triangulation.twins[half as usize / 3 * 3 + 1] / 3 * 3);
        queue.extend([f, f + 2, g, g + 1]);
    }
    Ok(())
}

fn should_flip(triangulation: &Triangulation, half: u32) -> bool {
    let twin = triangulation.twins[half as usize];
    if twin == NONE {
        return false;
    }
    let [a, b] = triangulation.ends(half);
    let c = triangulation.corners[previous(half) as usize];
    let d = triangulation.corners[previous(twin) as usize];
    if c == d || (triangulation.is_rim(c) && triangulation.is_rim(d)) {
        return false;
    }
    let [pa, pb, pc, pd] = [a, b, c, d].map(|vertex| triangulation.points[vertex as usize]);
    let across = [pc, pd].map(|at| [pa - at, pb - at]);
    // Nearly always both angles are acute.
    if across.iter().all(|[u, v]| u.dot(v) >= 0.0) {
        return false;
    }
    let cotangent =
        |[u, v]: [Vector3<f64>; 2]| u.dot(&v) / u.cross(&v).norm().max(f64::MIN_POSITIVE);
    // The angles add up to more than two right ones if their cotangents are less than nothing.
    if across.map(cotangent).iter().sum::<f64>() >= -1e-9 {
        return false;
    }
    let old = area_vector([pa, pb, pc]) + area_vector([pb, pa, pd]);
    let new = [area_vector([pa, pd, pc]), area_vector([pd, pb, pc])];
    if new.iter().any(|area| area.dot(&old) <= 0.0) {
        return false;
    }
    // The new edge must not exist yet; then no vertex is left with two faces, either.
    let inner = if triangulation.is_rim(c) { d } else { c };
    let other = if inner == c { d } else { c };
    !triangulation.around(inner).any(|half| triangulation.ends(half)[1] == other)
}

/// Collapses the edges that are too short, the shortest first; gives the vertices that are left of them.
fn collapse_short(
    triangulation: &mut Triangulation,
    sizes: &[f64],
    progress: &Progress<'_>,
) -> Result<Vec<u32>, Cancelled> {
    fn share(triangulation: &Triangulation, half: u32, sizes: &[f64]) -> f64 {
        triangulation.length(half) / wanted(triangulation, sizes, half)
    }
    let mut short: Vec<(f64, u32)> = triangulation
        .inner_edges()
        .map(|half| (share(triangulation, half, sizes), half))
        .filter(|(share, _)| *share < SHORT)
        .collect();
    short.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let mut left = Vec::new();
    for (_, half) in short {
        progress.check()?;
        if !triangulation.is_alive(half)
            || triangulation.twins[half as usize] == NONE
            || share(triangulation, half, sizes) >= SHORT
        {
            continue;
        }
        let twin = triangulation.twins[half as usize];
        // The vertex at which a half-edge begins goes into its other end.
        let ends = triangulation.ends(half);
        if collapse(triangulation, sizes, half) {
            left.push(ends[1]);
        } else if collapse(triangulation, sizes, twin) {
            left.push(ends[0]);
        }
    }
    Ok(left)
}

/// Collapses an edge into its middle, or into the rim if it ends there, unless that would spoil the surface.
fn collapse(triangulation: &mut Triangulation, sizes: &[f64], half: u32) -> bool {
    if !triangulation.may_collapse(half) {
        return false;
    }
    let [v, u] = triangulation.ends(half);
    let [pv, pu] = [v, u].map(|vertex| triangulation.points[vertex as usize]);
    let place = if triangulation.is_rim(u) { pu } else { nalgebra::center(&pv, &pu) };
    let keeps = |at: u32, other: u32| {
        triangulation.around(at).all(|half| {
            let [b, c] =
                [next(half), previous(half)].map(|half| triangulation.corners[half as usize]);
            if b == other || c == other {
                return true;
            }
            let [pa, pb, pc] = [at, b, c].map(|vertex| triangulation.points[vertex as usize]);
            let (old, new) = (area_vector([pa, pb, pc]), area_vector([place, pb, pc]));
            let long = LONG * (sizes[b as usize] + sizes[u as usize]) / 2.0;
            old.dot(&new) > LEAST_COSINE * old.norm() * new.norm() && (pb - place).norm() <= long
        })
    };
    if !keeps(v, u) || !(triangulation.is_rim(u) || keeps(u, v)) {
        return false;
    }
    triangulation.points[u as usize] = place;
    triangulation.collapse(half);
    true
}

/// How far a vertex goes towards the centroid of its faces in one pass; more makes neighbors oscillate.
const SLIDE: f64 = 0.6;

/// Tangential relaxation: each inner vertex goes along the surface towards the centroid of the faces around it.
fn relax(triangulation: &mut Triangulation, progress: &Progress<'_>) -> Result<(), Cancelled> {
    let mut ring: Vec<Point3<f64>> = Vec::new();
    for vertex in triangulation.fixed as u32..triangulation.points.len() as u32 {
        progress.check()?;
        if triangulation.leaving[vertex as usize] == NONE {
            continue;
        }
        let at = triangulation.points[vertex as usize];
        ring.clear();
        ring.extend(
            triangulation
                .around(vertex)
                .map(|half| triangulation.points[triangulation.ends(half)[1] as usize]),
        );
        // The first one closes the ring.
        ring.push(ring[0]);
        let (mut normal, mut middle, mut weight) = (Vector3::zeros(), Vector3::zeros(), 0.0);
        for pair in ring.windows(2) {
            let [b, c] = [pair[0] - at, pair[1] - at];
            let area = b.cross(&c);
            let size = area.norm();
            normal += area;
            middle += (b + c) * (size / 3.0);
            weight += size;
        }
        let Some(normal) = normal.try_normalize(0.0).filter(|_| weight > 0.0) else { continue };
        let step = middle * (SLIDE * 1.5 / weight);
        let place = at + (step - normal * normal.dot(&step));
        let keeps =
            |pair: &[Point3<f64>]| area_vector([place, pair[0], pair[1]]).dot(&normal) > 0.0;
        if ring.windows(2).all(keeps) {
            triangulation.points[vertex as usize] = place;
        }
    }
    Ok(())
}
