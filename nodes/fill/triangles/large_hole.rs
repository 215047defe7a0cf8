//! The triangulation of a rim of very many edges: some of its vertices first, then the others, the farthest from the triangles first.
//!
//! The few are chosen and the others follow as Douglas and Peucker do it, "Algorithms for the reduction of the number of points required
//! to represent a digitized line or its caricature" (1973). After each vertex edges are flipped where that makes the two triangles
//! smaller, or of equal ones better shaped, so that the area is nearly the least. Cost grows about with n log n.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use nalgebra::{Point3, Vector3};

use super::min_weight::min_weight;
use super::triangulation::{NONE, Triangulation, area_vector, previous};

/// The number of vertices that dynamic programming triangulates: with fewer the shape is worse, and the cost grows with the cube.
const FEW: usize = 100;

/// Two areas that differ less than this share are the same.
const SAME_AREA: f64 = 1e-9;

/// A part of the rim between two vertices that are in the triangles already.
#[derive(Clone, Copy, Debug)]
struct Gap {
    /// How far its farthest vertex is from the straight line.
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
        let share = (to_point.dot(&along) / length_sq).clamp(0.0, 1.0);
        (to_point - along * share).norm_squared()
    };
    // Of vertices on the line the middle one is taken.
    fn better(best: &(f64, usize), k: usize, off: f64, middle: f64) -> bool {
        off > best.0
            || (off == best.0 && (k as f64 - middle).abs() < (best.1 as f64 - middle).abs())
    }
    let mut best = (distance(from + 1), from + 1);
    for k in from + 2..to {
        let off = distance(k);
        if better(&best, k, off, middle) {
            best = (off, k);
        }
    }
    Some(Gap { distance: best.0, from, to, farthest: best.1 })
}

/// The triangulation of a rim for which dynamic programming would take too long; see [`super::triangulate::triangulate`].
pub(crate) fn triangulate_large(
    points: &[Point3<f64>],
    normals: &[Vector3<f64>],
    is_taken: &dyn Fn(usize, usize) -> bool,
) -> Option<Vec<[u32; 3]>> {
    let count = points.len();
    let mut heap = BinaryHeap::new();
    // From three corners that are far from each other.
    fn far(from: Point3<f64>, count: usize, points: &[Point3<f64>]) -> Option<usize> {
        fn off(k: &usize, from: Point3<f64>, points: &[Point3<f64>]) -> f64 {
            (points[*k] - from).norm_squared()
        }
        (0..count)
            .max_by(|a, b| off(a, from, points).total_cmp(&off(b, from, points)).then(b.cmp(a)))
    }
    let mut chosen = vec![0, far(points[0], count, points)?];
    heap.extend(gap(points, 0, chosen[1]));
    heap.extend(gap(points, chosen[1], count));
    while chosen.len() < FEW {
        let next = heap.pop()?;
        chosen.push(next.farthest);
        heap.extend(gap(points, next.from, next.farthest));
        heap.extend(gap(points, next.farthest, next.to));
    }
    chosen.sort_unstable();
    let few: Vec<Point3<f64>> = chosen.iter().map(|&k| points[k]).collect();
    let beyond: Vec<Vector3<f64>> = (0..FEW)
        .map(|place| {
            let end = chosen.get(place + 1).copied().unwrap_or(count);
            let sum: Vector3<f64> = normals[chosen[place]..end].iter().sum();
            sum.try_normalize(0.0).unwrap_or_default()
        })
        .collect();
    let taken = |a: usize, b: usize| is_taken(chosen[a], chosen[b]);
    let faces = min_weight(&few, &beyond, &taken)?;
    let faces: Vec<[u32; 3]> =
        faces.into_iter().map(|face| face.map(|place| chosen[place as usize] as u32)).collect();
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
    /// Adds the farthest vertex of a gap. `border` has the half-edge of the border that leaves each vertex.
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
        fn area(corners: [Point3<f64>; 3]) -> f64 {
            Vector3::norm(&area_vector(corners))
        }
        let old = area([pa, pb, pc]) + area([pb, pa, pd]);
        let new = area([pa, pd, pc]) + area([pd, pb, pc]);
        let is_smaller = new < old * (1.0 - SAME_AREA);
        let is_same = new <= old * (1.0 + SAME_AREA);
        fn cotangent(at: Point3<f64>, u: Point3<f64>, v: Point3<f64>) -> f64 {
            let [u, v] = [u - at, v - at];
            u.dot(&v) / u.cross(&v).norm().max(f64::MIN_POSITIVE)
        }
        let is_better = || {
            let [old, new] = [
                cotangent(pc, pa, pb) + cotangent(pd, pa, pb),
                cotangent(pa, pc, pd) + cotangent(pb, pc, pd),
            ];
            old < -1e-9 && old < new
        };
        // The new edge cannot exist already: it would have crossed the one that goes.
        (is_smaller || (is_same && is_better())) && !(self.is_taken)(c as usize, d as usize)
    }
}
