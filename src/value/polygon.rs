//! Triangulation of polygons along diagonals.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use nalgebra::{Point3, Vector3};
use robust::{Coord, orient2d};

/// The two coordinates of a point in a plane.
pub type PlanePoint = [f64; 2];

/// Projects a point to a coordinate plane, along the coordinate axis that is closest to `normal`. A polygon that is counter-clockwise
/// around `normal` stays counter-clockwise. Nothing is rounded, because the projection only drops one coordinate.
pub fn project_to_plane(at: Point3<f64>, normal: Vector3<f64>) -> PlanePoint {
    let axis = normal.iamax();
    let [x, y] = [(axis + 1) % 3, (axis + 2) % 3].map(|axis| at[axis]);
    if normal[axis] < 0.0 { [y, x] } else { [x, y] }
}

/// Returns a number with the exact sign of the area of a triangle, which is positive if the triangle is counter-clockwise (Shewchuk,
/// "Adaptive precision floating-point arithmetic and fast robust geometric predicates", 1997).
pub fn orientation([a, b, c]: [PlanePoint; 3]) -> f64 {
    fn coord([x, y]: PlanePoint) -> Coord<f64> {
        Coord { x, y }
    }
    orient2d(coord(a), coord(b), coord(c))
}

/// The maximum area of a flipped triangle that is tolerated in a fan, as a fraction of the polygon's area. Areas up to this one are
/// rounding errors.
const ROUNDING: f64 = 1e-9;

/// The maximum cosine of the angle between the normals of a polygon and of a triangle that counts as flipped. A triangle that merely leans
/// by more than a right angle, as in a quad that is folded along its diagonal, does not count as flipped.
const TURNED: f64 = -0.5;

/// Returns true if the fan of triangles around the first corner covers the polygon, which means that no triangle is flipped.
pub(crate) fn is_fan(n: usize, corner: impl Fn(u32) -> Point3<f64>) -> bool {
    let crosses = || fan(n).map(|triangle| cross(triangle.map(&corner)));
    let normal: Vector3<f64> = crosses().sum();
    let length = normal.norm();
    n == 3
        || !crosses().any(|cross: Vector3<f64>| {
            cross.dot(&normal) < length * f64::min(TURNED * cross.norm(), -ROUNDING * length)
        })
}

fn cross([a, b, c]: [Point3<f64>; 3]) -> Vector3<f64> {
    (b - a).cross(&(c - a))
}

/// The triangles of the fan around the first corner of a polygon with `n` corners.
pub(crate) fn fan(n: usize) -> impl Iterator<Item = [u32; 3]> + use<> {
    (2..n as u32).map(|k| [0, k - 1, k])
}

/// Cuts a polygon with `n` corners into `n - 2` triangles, each given by three of the polygon's corners by index. The triangles have the
/// polygon's orientation.
///
/// If the fan around its first corner covers the polygon, the result is that fan. Any other polygon is projected to its mean plane and its
/// ears are clipped there (see [`clip_ears`]), so that no triangle extends beyond a concave corner.
///
/// # Panics
/// If there are fewer than three corners.
pub fn triangulate(corners: &[Point3<f64>]) -> Vec<[u32; 3]> {
    let corner = |k: u32| corners[k as usize];
    if is_fan(corners.len(), corner) {
        return fan(corners.len()).collect();
    }
    let normal = fan(corners.len()).map(|triangle| cross(triangle.map(corner))).sum();
    clip_ears(&corners.iter().map(|at| project_to_plane(*at, normal)).collect::<Vec<_>>())
}

/// The maximum length that counts as zero, as a fraction of the polygon's extent.
const LINE: f64 = 1e-9;

/// The qualities of special ears: `SHORT` if a side at the corner has no length, `SPIKE` if the border doubles back at the corner,
/// `BLOCKED` if the ear contains another corner. All other ears are rated by their shape, by at most 1.
const SHORT: f64 = 3.0;
const SPIKE: f64 = 2.0;
const BLOCKED: f64 = -2.0;

/// Cuts a counter-clockwise polygon into triangles, each given by three of its corners by index. Ears are clipped one by one, the ear with
/// the best shape first (Eberly, "Triangulation by ear clipping", 2002, section 2).
///
/// A polygon that crosses itself also gives `n - 2` triangles, but their positions are not defined. Cost grows with n log n for the shapes
/// of real faces, and at worst with the square of the number of concave corners.
///
/// # Panics
/// If there are fewer than three corners.
pub fn clip_ears(corners: &[PlanePoint]) -> Vec<[u32; 3]> {
    let mut polygon = Clipping::new(corners);
    let mut triangles = Vec::with_capacity(corners.len() - 2);
    while triangles.len() < corners.len() - 2 {
        let tip = polygon.best_ear();
        triangles.push([polygon.before[tip], tip, polygon.next[tip]].map(|k| k as u32));
        polygon.clip(tip);
    }
    triangles
}

/// The remaining polygon while ears are clipped from it.
struct Clipping<'a> {
    corners: &'a [PlanePoint],
    next: Vec<usize>,
    before: Vec<usize>,
    is_left: Vec<bool>,
    /// For each corner, true if it is not convex.
    is_reflex: Vec<bool>,
    /// The indices of all corners, sorted by x.
    by_x: Vec<usize>,
    quality: Vec<f64>,
    /// Ears by quality; among ears of equal quality the one with the lowest index comes first. Entries with an outdated quality are
    /// skipped.
    queue: BinaryHeap<(i64, Reverse<usize>)>,
    /// Lengths up to this one count as zero.
    min_length: f64,
}

impl<'a> Clipping<'a> {
    fn new(corners: &'a [PlanePoint]) -> Self {
        let n = corners.len();
        let extent = corners.iter().fold(0.0f64, |extent, at| {
            extent.max((at[0] - corners[0][0]).abs()).max((at[1] - corners[0][1]).abs())
        });
        let mut polygon = Self {
            corners,
            next: (1..n).chain([0]).collect(),
            before: [n - 1].into_iter().chain(0..n - 1).collect(),
            is_left: vec![true; n],
            is_reflex: vec![false; n],
            by_x: (0..n).collect(),
            quality: vec![0.0; n],
            queue: BinaryHeap::new(),
            min_length: LINE * extent,
        };
        for k in 0..n {
            polygon.is_reflex[k] = polygon.turn_at(k) <= 0.0;
        }
        polygon.by_x.sort_by(|&a, &b| corners[a][0].total_cmp(&corners[b][0]));
        polygon.judge_all();
        polygon
    }

    fn turn_at(&self, k: usize) -> f64 {
        orientation([self.before[k], k, self.next[k]].map(|k| self.corners[k]))
    }

    /// Takes the best ear from the queue. If no ear can be clipped, rates all ears again, because the corners that blocked them may have
    /// been removed.
    fn best_ear(&mut self) -> usize {
        if let Some(tip) = self.pop().filter(|&tip| self.quality[tip] >= 0.0) {
            return tip;
        }
        self.judge_all();
        self.pop().expect("three corners are left")
    }

    fn pop(&mut self) -> Option<usize> {
        loop {
            let (order, Reverse(tip)) = self.queue.pop()?;
            if self.is_left[tip] && order == sortable(self.quality[tip]) {
                return Some(tip);
            }
        }
    }

    /// Removes a corner and rates its two neighbors again.
    fn clip(&mut self, tip: usize) {
        let (a, c) = (self.before[tip], self.next[tip]);
        self.is_left[tip] = false;
        (self.next[a], self.before[c]) = (c, a);
        for k in [a, c] {
            self.is_reflex[k] = self.turn_at(k) <= 0.0;
        }
        for k in [a, c] {
            self.judge(k);
        }
    }

    fn judge_all(&mut self) {
        self.queue.clear();
        for k in 0..self.corners.len() {
            if self.is_left[k] {
                self.judge(k);
            }
        }
    }

    fn judge(&mut self, tip: usize) {
        self.quality[tip] = self.ear_quality(tip);
        self.queue.push((sortable(self.quality[tip]), Reverse(tip)));
    }

    /// The quality of the triangle at a corner. An ear that can be clipped has a quality from 0 to 1 for its shape, or else [`SHORT`] or
    /// [`SPIKE`]. The quality of any other ear is negative: the worse the result of clipping it, the lower.
    fn ear_quality(&self, tip: usize) -> f64 {
        let triangle = [self.before[tip], tip, self.next[tip]];
        let ear = triangle.map(|k| self.corners[k]);
        let twice = orientation(ear);
        let longest = (0..3).map(|i| distance_sq(ear[i], ear[(i + 1) % 3])).fold(0.0, f64::max);
        let [there, back] = [ear[0], ear[2]].map(|end| [end[0] - ear[1][0], end[1] - ear[1][1]]);
        let along = there[0] * back[0] + there[1] * back[1];
        if [there, back].iter().any(|it| it[0].abs().max(it[1].abs()) <= self.min_length) {
            return SHORT;
        }
        // If the border doubles back at the corner, the ear has no area. It must be clipped before a larger triangle cuts off the rest of
        // the border.
        if twice.abs() <= self.min_length * longest.sqrt() && 0.0 < along {
            return SPIKE;
        }
        let shape = if longest > 0.0 { twice / longest } else { 0.0 };
        if twice <= 0.0 {
            return shape.min(-f64::MIN_POSITIVE);
        }
        if self.is_blocked(triangle, ear) { BLOCKED } else { shape }
    }

    /// Returns true if the triangle contains a corner that is not convex.
    fn is_blocked(&self, triangle: [usize; 3], ear: [PlanePoint; 3]) -> bool {
        let [low, high] = [f64::min, f64::max]
            .map(|pick| [0, 1].map(|axis| pick(pick(ear[0][axis], ear[1][axis]), ear[2][axis])));
        let first = self.by_x.partition_point(|&k| self.corners[k][0] < low[0]);
        let near = self.by_x[first..].iter().take_while(|&&k| self.corners[k][0] <= high[0]);
        near.copied().any(|k| {
            let at = self.corners[k];
            self.is_left[k]
                && self.is_reflex[k]
                && low[1] <= at[1]
                && at[1] <= high[1]
                && !triangle.contains(&k)
                && !ear.contains(&at)
                && is_in_triangle(ear, at)
        })
    }
}

fn distance_sq(a: PlanePoint, b: PlanePoint) -> f64 {
    (a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1])
}

/// Maps a number to an integer with the same order as [`f64::total_cmp`].
fn sortable(x: f64) -> i64 {
    let bits = x.to_bits().cast_signed();
    bits ^ ((bits >> 63).cast_unsigned() >> 1).cast_signed()
}

/// Returns true if a point is inside a counter-clockwise triangle, or on the border of the triangle.
pub fn is_in_triangle(triangle: [PlanePoint; 3], at: PlanePoint) -> bool {
    (0..3).all(|k| orientation([triangle[k], triangle[(k + 1) % 3], at]) >= 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::Random;

    /// Returns twice the signed area of a polygon, which is positive if the polygon is counter-clockwise.
    fn area(points: &[PlanePoint]) -> f64 {
        let next = points[1..].iter().chain(&points[..1]);
        points.iter().zip(next).map(|(a, b)| a[0] * b[1] - a[1] * b[0]).sum()
    }

    /// Triangulates a polygon in several planes and from each of its corners. Checks that no triangle is flipped and that the areas of the
    /// triangles add up to the polygon's area.
    #[track_caller]
    fn check(polygon: &[PlanePoint]) {
        let wanted = area(polygon);
        for start in 0..polygon.len() {
            let turned = [&polygon[start..], &polygon[..start]].concat();
            for slant in [[0.0, 0.0], [0.3, -0.2], [4.0, 5.0]] {
                let lifted = turned
                    .iter()
                    .map(|at| Point3::new(at[0], at[1], slant[0] * at[0] + slant[1] * at[1]));
                let triangles = triangulate(&lifted.collect::<Vec<_>>());
                assert_eq!(triangles.len(), polygon.len() - 2);
                let areas = triangles.iter().map(|it| area(&it.map(|k| turned[k as usize])));
                let areas = Vec::from_iter(areas);
                assert!(areas.iter().all(|it| -1e-9 * wanted <= *it), "{start} {areas:?}");
                assert!((areas.iter().sum::<f64>() - wanted).abs() < 1e-9 * wanted, "{areas:?}");
            }
        }
    }

    const L: [PlanePoint; 6] = [[0., 0.], [20., 0.], [20., 10.], [10., 10.], [10., 20.], [0., 20.]];

    #[test]
    fn concave_polygons_become_triangles_within_them() {
        check(&L);
        check(&[[0., 0.], [4., 0.], [1., 1.], [0., 4.]]);
        let teeth =
            (0..12).flat_map(|k| [[0.5, -1.0], [1.0, -5.0]].map(|[x, y]| [f64::from(k) + x, y]));
        check(&Vec::from_iter([[12.0, 0.0], [0.0, 0.0]].into_iter().chain(teeth)));
    }

    #[test]
    fn random_stars_become_triangles_within_them() {
        let mut random = Random(7);
        for n in (3..40).chain([400]) {
            let star: Vec<_> = (0..n)
                .map(|k: usize| {
                    let (sin, cos) = libm::sincos(std::f64::consts::TAU * k as f64 / n as f64);
                    let radius = 0.1 + random.even().abs();
                    [radius * cos, radius * sin]
                })
                .collect();
            check(&star[..]);
        }
    }

    #[test]
    fn polygons_that_are_convex_become_fans() {
        let bent = [[0., 0., 0.], [1., 0., 0.2], [1., 1., 0.], [0., 1., 0.2]].map(Point3::from);
        assert_eq!(triangulate(&bent), [[0, 1, 2], [0, 2, 3]]);
        let dart = [[0., 0., 0.], [1., 0., 0.], [0.1, 0.1, 0.], [0., 1., 0.]].map(Point3::from);
        assert_eq!(triangulate(&dart), [[0, 1, 2], [0, 2, 3]]);
        let turned = [dart[1], dart[2], dart[3], dart[0]];
        assert!(!is_fan(4, |k| turned[k as usize]));
        assert_eq!(triangulate(&turned), [[3, 0, 1], [3, 1, 2]]);
    }

    #[test]
    fn polygons_without_an_area_get_triangles_too() {
        for n in 3..9 {
            let line: Vec<_> = (0..n).map(|k| Point3::new(f64::from(k), 0.0, 0.0)).collect();
            assert_eq!(triangulate(&line).len(), n as usize - 2);
        }
    }

    /// A spiral of 40 000 corners. Most corners are concave, so a scan of all other corners for each of them would take too long.
    #[test]
    fn a_long_spiral_becomes_triangles_within_it() {
        fn wall(k: u32, out: f64) -> [f64; 2] {
            let angle = f64::from(k) * 0.01;
            let (sin, cos) = libm::sincos(angle);
            [(1.0 + angle + out) * cos, (1.0 + angle + out) * sin]
        }
        let outer = (0..20_000).map(|k| wall(k, 2.0));
        let spiral: Vec<_> = outer.chain((0..20_000).rev().map(|k| wall(k, 0.0))).collect();
        let triangles = clip_ears(&spiral);
        let areas =
            triangles.iter().map(|it| area(&it.map(|k| spiral[k as usize]))).collect::<Vec<_>>();
        assert!(areas.iter().all(|it| *it >= 0.0));
        assert!((areas.iter().sum::<f64>() / area(&spiral) - 1.0).abs() < 1e-9);
    }
}
