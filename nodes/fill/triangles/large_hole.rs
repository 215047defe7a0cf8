//! The triangulation of a hole whose rim has many edges. Some of the rim's vertices are triangulated first. The others are inserted one by
//! one, the farthest from the triangles first.
//!
//! Vertices are chosen and inserted as in Douglas and Peucker, "Algorithms for the reduction of the number of points required to represent
//! a digitized line or its caricature" (1973). After each insertion, edges are flipped if that reduces the area of the two triangles, or
//! improves their shape at equal area. So the total area is nearly minimal. The cost is about proportional to n log n.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use nalgebra::{Point3, Vector3};

use super::min_weight::min_weight;
use super::triangulation::{NONE, Triangulation, area_vector, cotangent, previous};

/// Number of rim vertices that are triangulated first, by dynamic programming. With fewer, the shape is worse; the cost grows with the cube
/// of the number.
const MAX_VERTICES: usize = 100;

/// Relative difference below which two areas count as equal.
const SAME_AREA: f64 = 1e-9;

/// A part of the rim between two vertices that are in the triangulation; the vertices between them are not.
#[derive(Clone, Copy, Debug)]
struct Gap {
    /// The squared distance between the gap's farthest vertex and the line through the gap's ends.
    distance: f64,
    from: usize,
    to: usize,
    farthest: usize,
}

impl Ord for Gap {
    fn cmp(&self, other: &Self) -> Ordering {
        self.distance.total_cmp(&other.distance).then(other.from.cmp(&self.from))
    }
}

impl PartialOrd for Gap {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Gap {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Gap {}

fn gap(points: &[Point3<f64>], from: usize, to: usize) -> Option<Gap> {
    if to - from < 2 {
        return None;
    }
    let count = points.len();
    let (a, b) = (points[from], points[to % count]);
    let along = b - a;
    let length_sq = along.norm_squared().max(f64::MIN_POSITIVE);
    let middle = (from + to) as f64 / 2.0;
    let distance = |k: usize| {
        let to_point = points[k] - a;
        let fraction = (to_point.dot(&along) / length_sq).clamp(0.0, 1.0);
        (to_point - along * fraction).norm_squared()
    };
    // Of several vertices on the line, take the one nearest to the middle of the gap.
    fn is_better(best: &(f64, usize), k: usize, off: f64, middle: f64) -> bool {
        off > best.0
            || (off == best.0 && (k as f64 - middle).abs() < (best.1 as f64 - middle).abs())
    }
    let mut best = (distance(from + 1), from + 1);
    for k in from + 2..to {
        let off = distance(k);
        if is_better(&best, k, off, middle) {
            best = (off, k);
        }
    }
    Some(Gap { distance: best.0, from, to, farthest: best.1 })
}

/// Returns the index of the point that is farthest from `from`; if several are equally far, the lowest index.
fn farthest(points: &[Point3<f64>], from: Point3<f64>) -> Option<usize> {
    let distances = points.iter().map(|point| (point - from).norm_squared());
    let farthest = distances.enumerate().max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)));
    farthest.map(|(k, _)| k)
}

/// Triangulates a hole whose rim is too long for dynamic programming alone; see [`super::triangulate::triangulate`].
pub(crate) fn triangulate_large(
    points: &[Point3<f64>],
    normals: &[Vector3<f64>],
    is_taken: &dyn Fn(usize, usize) -> bool,
) -> Option<Vec<[u32; 3]>> {
    let count = points.len();
    let mut heap = BinaryHeap::new();
    // Start with two vertices that are far from each other.
    let mut chosen = vec![0, farthest(points, points[0])?];
    heap.extend(gap(points, 0, chosen[1]));
    heap.extend(gap(points, chosen[1], count));
    while chosen.len() < MAX_VERTICES {
        let next = heap.pop()?;
        chosen.push(next.farthest);
        heap.extend(gap(points, next.from, next.farthest));
        heap.extend(gap(points, next.farthest, next.to));
    }
    chosen.sort_unstable();
    let few: Vec<Point3<f64>> = chosen.iter().map(|&k| points[k]).collect();
    let beyond: Vec<Vector3<f64>> = (0..MAX_VERTICES)
        .map(|index| {
            let end = chosen.get(index + 1).copied().unwrap_or(count);
            let sum: Vector3<f64> = normals[chosen[index]..end].iter().sum();
            sum.try_normalize(0.0).unwrap_or_default()
        })
        .collect();
    let faces = min_weight(&few, &beyond, &|a, b| is_taken(chosen[a], chosen[b]))?;
    let faces: Vec<[u32; 3]> =
        faces.into_iter().map(|face| face.map(|index| chosen[index as usize] as u32)).collect();
    let mut growing =
        Growing { triangulation: Triangulation::new(points.to_vec(), 0, &faces), is_taken };
    let mut border = vec![NONE; count];
    for half in 0..growing.triangulation.corners.len() as u32 {
        if growing.triangulation.twins[half as usize] == NONE {
            border[growing.triangulation.corners[half as usize] as usize] = half;
        }
    }
    while let Some(next) = heap.pop() {
        growing.insert(&mut border, next);
        heap.extend(gap(points, next.from, next.farthest));
        heap.extend(gap(points, next.farthest, next.to));
    }
    let clashes = growing.triangulation.inner_edges().any(|half| {
        let [a, b] = growing.triangulation.ends(half);
        is_taken(a as usize, b as usize)
    });
    (!clashes).then(|| growing.triangulation.compact().0)
}

struct Growing<'a> {
    triangulation: Triangulation,
    is_taken: &'a dyn Fn(usize, usize) -> bool,
}

impl Growing<'_> {
    /// Inserts the farthest vertex of a gap into the triangulation. `border` contains, for each rim vertex, the border half-edge that
    /// leaves it.
    fn insert(&mut self, border: &mut [u32], gap: Gap) {
        let half = border[gap.from];
        let face = half / 3 * 3;
        let added = self.triangulation.corners.len() as u32;
        self.triangulation.split_border(half, gap.farthest as u32);
        let mut queue = vec![face + 1, face + 2, added + 1];
        self.mark(border, &[face, added]);
        let mut left = 1000;
        while let Some(half) = queue.pop() {
            let twin = self.triangulation.twins[half as usize];
            if twin == NONE || left == 0 || !self.should_flip(half) {
                continue;
            }
            self.triangulation.flip(half);
            left -= 1;
            let (f, g) = (half / 3 * 3, twin / 3 * 3);
            self.mark(border, &[f, g]);
            queue.extend([f, f + 2, g, g + 1]);
        }
    }

    fn mark(&self, border: &mut [u32], faces: &[u32]) {
        for half in faces.iter().flat_map(|&first| first..first + 3) {
            if self.triangulation.twins[half as usize] == NONE {
                border[self.triangulation.corners[half as usize] as usize] = half;
            }
        }
    }

    fn should_flip(&self, half: u32) -> bool {
        let triangulation = &self.triangulation;
        let twin = triangulation.twins[half as usize];
        let [a, b] = triangulation.ends(half);
        let c = triangulation.corners[previous(half) as usize];
        let d = triangulation.corners[previous(twin) as usize];
        let [pa, pb, pc, pd] = [a, b, c, d].map(|vertex| triangulation.points[vertex as usize]);
        let old = area_vector([pa, pb, pc]).norm() + area_vector([pb, pa, pd]).norm();
        let new = area_vector([pa, pd, pc]).norm() + area_vector([pd, pb, pc]).norm();
        let is_smaller = new < old * (1.0 - SAME_AREA);
        let is_same = new <= old * (1.0 + SAME_AREA);
        let is_better = is_same && {
            let [old, new] = [
                cotangent(pc, pa, pb) + cotangent(pd, pa, pb),
                cotangent(pa, pc, pd) + cotangent(pb, pc, pd),
            ];
            old < -1e-9 && old < new
        };
        // The flipped edge cannot be in the triangulation already: it would cross the current edge.
        (is_smaller || is_better) && !(self.is_taken)(c as usize, d as usize)
    }
}
