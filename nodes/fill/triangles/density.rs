//! Isotropic remeshing: adapts triangles to a target size by edge splits, collapses, flips and tangential relaxation.
//!
//! Botsch and Kobbelt, "A remeshing approach to multiresolution modeling" (2004), section 4, except that edges are flipped if the angles
//! opposite to them add up to more than 180 degrees.

use std::collections::VecDeque;
use std::fmt::Display;

use maquette_node::{CancelledError, Error, Limit, Progress};
use nalgebra::{Point3, Vector3};

use super::triangulation::{NONE, Triangulation, area_vector, cotangent, next, previous};

/// An edge longer than this multiple of its target length is split. The value is much larger than [`SHORT_RATIO`], so that splitting and
/// collapsing do not alternate.
const LONG_RATIO: f64 = 4.0 / 3.0;

/// An edge shorter than this multiple of its target length is collapsed.
const SHORT_RATIO: f64 = 0.8;

/// Maximum number of passes over all edges; four or five are usual.
const MAX_PASSES: usize = 20;

/// The passes end when a pass has changed at most this fraction of the edges: 1 / `CONVERGED_DIVISOR`. Further passes would move few
/// vertices, by small distances.
const CONVERGED_DIVISOR: usize = 100;

/// Cosine of the maximum angle, 75 degrees, by which a face may rotate when an edge collapses.
const MIN_COSINE: f64 = 0.25881904510252074;

/// Maximum number of flips in one pass, per edge. Usually about one flip per edge is needed. In a plane, the total number of flips is less
/// than the square of the number of edges.
const MAX_FLIPS_PER_EDGE: usize = 10;

/// Maximum number of triangles in a fill. More triangles take minutes and some GB of memory, and nearly always result from an outlier
/// vertex on the rim.
pub(crate) const TRIANGLES: Limit = Limit {
    max: 1_000_000,
    items: "triangles",
    help: "check whether a vertex of the rim is an outlier or `edges` are too short, or leave the rim out with `holes: Edges` or `holes: Loops`",
};

/// The reason why a triangulation cannot be refined.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum RefineError {
    /// The evaluation was cancelled.
    Cancelled,
    /// The fill would have about this number of triangles.
    TooMany(f64),
}

impl RefineError {
    /// Returns the error that the node reports. `what` names the fill that would have too many triangles.
    pub(crate) fn error(self, what: impl Display) -> Error {
        match self {
            Self::Cancelled => CancelledError.into(),
            Self::TooMany(need) => TRIANGLES.error(what, need).into(),
        }
    }
}

impl From<CancelledError> for RefineError {
    fn from(_: CancelledError) -> Self {
        Self::Cancelled
    }
}

/// Adapts the edge lengths of `triangulation` to the target lengths. `target` is evaluated once per vertex: at each rim vertex, and at each
/// vertex that a split adds.
///
/// # Errors
/// Returns an error if there would be too many triangles, or if the evaluation is cancelled.
pub(crate) fn refine(
    triangulation: &mut Triangulation,
    target: impl Fn(Point3<f64>) -> f64,
    progress: &Progress<'_>,
) -> Result<(), RefineError> {
    let mut sizes: Vec<f64> = triangulation.points.iter().map(|&point| target(point)).collect();
    for _ in 0..MAX_PASSES {
        let split = split_long(triangulation, &mut sizes, &target, progress)?;
        flip_all(triangulation, progress)?;
        let collapsed = collapse_short(triangulation, &sizes, progress)?;
        if !collapsed.is_empty() {
            let edges = edges_near(triangulation, &collapsed);
            flip(triangulation, edges, progress)?;
        }
        relax(triangulation, progress)?;
        if split + collapsed.len() <= triangulation.corners.len() / 2 / CONVERGED_DIVISOR {
            break;
        }
    }
    Ok(flip_all(triangulation, progress)?)
}

/// The area of an equilateral triangle with edges of length 1.
const EQUILATERAL: f64 = 0.4330127018922193;

/// Estimates the number of triangles of `triangulation` after [`refine`]. For the estimate, triangles much larger than their target are
/// divided, at most `divisions` times in all.
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
        if LONG_RATIO * size < longest && left > 0 {
            left -= 1;
            let middle = nalgebra::center(&a.0, &b.0);
            let middle = (middle, target(middle));
            open.extend([[a, middle, c], [middle, b, c]]);
        } else if longest > 0.0 {
            // A thin triangle is also divided along its length.
            let (times, width) = (longest / size, area_vector([a.0, b.0, c.0]).norm() / longest);
            let along = if LONG_RATIO < times { 2.0 * times } else { 0.0 };
            need += times * (width / size) / (2.0 * EQUILATERAL) + along;
        }
    }
    need
}

fn target_length(triangulation: &Triangulation, sizes: &[f64], half: u32) -> f64 {
    let [a, b] = triangulation.ends(half);
    (sizes[a as usize] + sizes[b as usize]) / 2.0
}

/// Splits the edges that are too long, the longest first. Returns the number of splits.
fn split_long(
    triangulation: &mut Triangulation,
    sizes: &mut Vec<f64>,
    target: &impl Fn(Point3<f64>) -> f64,
    progress: &Progress<'_>,
) -> Result<usize, RefineError> {
    fn excess(half: u32, triangulation: &Triangulation, sizes: &[f64]) -> f64 {
        triangulation.length(half) / target_length(triangulation, sizes, half)
    }
    let mut long: Vec<(f64, u32)> = triangulation
        .inner_edges()
        .map(|half| (excess(half, triangulation, sizes), half))
        .filter(|(excess, _)| *excess > LONG_RATIO)
        .collect();
    long.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let mut count = 0;
    for (excess, half) in long {
        // Skip the half-edge if an earlier split has assigned it to another edge.
        let twin = triangulation.twins[half as usize];
        if twin == NONE
            || triangulation.length(half)
                < excess * target_length(triangulation, sizes, half) * 0.999
        {
            continue;
        }
        let [a, b] = triangulation.ends(half).map(|vertex| triangulation.points[vertex as usize]);
        let middle = nalgebra::center(&a, &b);
        triangulation.split(half, middle);
        sizes.push(target(middle));
        count += 1;
        progress.check()?;
        if 3 * TRIANGLES.max < triangulation.corners.len() {
            return Err(RefineError::TooMany(estimate(triangulation, target, 0)));
        }
    }
    Ok(count)
}

/// Flips edges until no edge needs a flip.
fn flip_all(
    triangulation: &mut Triangulation,
    progress: &Progress<'_>,
) -> Result<(), CancelledError> {
    let edges = triangulation.inner_edges().collect();
    flip(triangulation, edges, progress)
}

/// Returns the inner edges that have an end among `vertices` or their neighbors. If only `vertices` have changed since all edges were
/// flipped, no other edges can need a flip.
fn edges_near(triangulation: &Triangulation, vertices: &[u32]) -> Vec<u32> {
    let mut near = vec![false; triangulation.points.len()];
    vertices.iter().for_each(|&vertex| near[vertex as usize] = true);
    let faces = triangulation.corners.as_chunks::<3>().0;
    let all = faces.iter().filter(|face| face[0] != NONE);
    let next_to: Vec<[u32; 3]> =
        all.filter(|face| face.iter().any(|&vertex| near[vertex as usize])).copied().collect();
    next_to.as_flattened().iter().for_each(|&vertex| near[vertex as usize] = true);
    triangulation
        .inner_edges()
        .filter(|&half| triangulation.ends(half).iter().any(|&vertex| near[vertex as usize]))
        .collect()
}

/// Flips the edges in `queue` that need a flip, and then the edges that need one because of these flips.
fn flip(
    triangulation: &mut Triangulation,
    mut queue: Vec<u32>,
    progress: &Progress<'_>,
) -> Result<(), CancelledError> {
    queue.reverse();
    let mut left = MAX_FLIPS_PER_EDGE * queue.len();
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
    // Fast check: if both angles opposite to the edge are acute, as they nearly always are, no flip is needed.
    if [pc, pd].iter().all(|apex| (pa - apex).dot(&(pb - apex)) >= 0.0) {
        return false;
    }
    // The opposite angles add up to more than 180 degrees if the sum of their cotangents is negative.
    if cotangent(pc, pa, pb) + cotangent(pd, pa, pb) >= -1e-9 {
        return false;
    }
    let old = area_vector([pa, pb, pc]) + area_vector([pb, pa, pd]);
    let new = [area_vector([pa, pd, pc]), area_vector([pd, pb, pc])];
    if new.iter().any(|area| area.dot(&old) <= 0.0) {
        return false;
    }
    // The flipped edge would connect `c` and `d`, so do not flip if they have an edge already. This is also the case if an end of the old
    // edge has only three faces; so no vertex is left with two faces.
    let inner = if triangulation.is_rim(c) { d } else { c };
    let other = if inner == c { d } else { c };
    !triangulation.halves_around(inner).any(|half| triangulation.ends(half)[1] == other)
}

/// Collapses the edges that are too short, the shortest first. Returns the vertices into which they collapsed.
fn collapse_short(
    triangulation: &mut Triangulation,
    sizes: &[f64],
    progress: &Progress<'_>,
) -> Result<Vec<u32>, CancelledError> {
    fn ratio(triangulation: &Triangulation, half: u32, sizes: &[f64]) -> f64 {
        triangulation.length(half) / target_length(triangulation, sizes, half)
    }
    let mut short: Vec<(f64, u32)> = triangulation
        .inner_edges()
        .map(|half| (ratio(triangulation, half, sizes), half))
        .filter(|(ratio, _)| *ratio < SHORT_RATIO)
        .collect();
    short.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let mut left = Vec::new();
    for (_, half) in short {
        progress.check()?;
        if !triangulation.is_alive(half)
            || triangulation.twins[half as usize] == NONE
            || ratio(triangulation, half, sizes) >= SHORT_RATIO
        {
            continue;
        }
        let twin = triangulation.twins[half as usize];
        // Collapsing a half-edge moves its start vertex into its end.
        let ends = triangulation.ends(half);
        if collapse(triangulation, sizes, half) {
            left.push(ends[1]);
        } else if collapse(triangulation, sizes, twin) {
            left.push(ends[0]);
        }
    }
    Ok(left)
}

/// Collapses an edge into its midpoint, or into its end on the rim, unless that would damage the surface. Returns true if the edge was
/// collapsed.
fn collapse(triangulation: &mut Triangulation, sizes: &[f64], half: u32) -> bool {
    if !triangulation.may_collapse(half) {
        return false;
    }
    let [v, u] = triangulation.ends(half);
    let [pv, pu] = [v, u].map(|vertex| triangulation.points[vertex as usize]);
    let position = if triangulation.is_rim(u) { pu } else { nalgebra::center(&pv, &pu) };
    let keeps = |at: u32, other: u32| {
        triangulation.halves_around(at).all(|half| {
            let [b, c] =
                [next(half), previous(half)].map(|half| triangulation.corners[half as usize]);
            if b == other || c == other {
                return true;
            }
            let [pa, pb, pc] = [at, b, c].map(|vertex| triangulation.points[vertex as usize]);
            let (old, new) = (area_vector([pa, pb, pc]), area_vector([position, pb, pc]));
            let long = LONG_RATIO * (sizes[b as usize] + sizes[u as usize]) / 2.0;
            old.dot(&new) > MIN_COSINE * old.norm() * new.norm() && (pb - position).norm() <= long
        })
    };
    if !keeps(v, u) || !(triangulation.is_rim(u) || keeps(u, v)) {
        return false;
    }
    triangulation.points[u as usize] = position;
    triangulation.collapse(half);
    true
}

/// Fraction of the way to the centroid of the adjacent faces that a vertex moves in one pass. With a larger fraction, neighboring vertices
/// oscillate.
const SLIDE: f64 = 0.6;

/// Tangential relaxation: moves each inner vertex along the surface towards the centroid of the faces around it.
fn relax(triangulation: &mut Triangulation, progress: &Progress<'_>) -> Result<(), CancelledError> {
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
                .halves_around(vertex)
                .map(|half| triangulation.points[triangulation.ends(half)[1] as usize]),
        );
        // Repeat the first point to close the ring.
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
        let position = at + (step - normal * normal.dot(&step));
        let keeps_orientation = ring
            .windows(2)
            .all(|pair| area_vector([position, pair[0], pair[1]]).dot(&normal) > 0.0);
        if keeps_orientation {
            triangulation.points[vertex as usize] = position;
        }
    }
    Ok(())
}
