//! Extends the smooth segments of the surface around a hole until they meet in creases, and connects the creases across the hole.
//!
//! Each vertex of a smooth fill is assigned to the nearest segment. An edge between two segments is split at the crease between them, or at
//! the corner where three meet. Then vertices slide along their segments, and crease vertices along the creases. At the hole's rim, each
//! crease meets a crease of the input surface.

use maquette_node::{CancelledError, Progress};
use nalgebra::{Point3, Vector3};

use super::charts::{Charts, CreaseKind};
use crate::border::rim::Rim;
use crate::plain::sizes::Sizes;
use crate::triangles::filling::Filling;
use crate::triangles::triangulation::{
    NONE, Triangulation, area_vector, cotangent, next, previous,
};

/// Numbers of smoothing rounds to try in turn. In each round, vertices slide and are projected to their surfaces; after the last round,
/// edges are split at creases. If some faces are folded in the end, the next number is tried, because creases then cross other edges.
const ROUND_COUNTS: [usize; 6] = [12, 4, 24, 8, 16, 2];

/// Minimum and maximum number of smoothing rounds after edges are split at creases. Once the minimum is reached, the rounds end when no
/// face is folded.
const MIN_ROUNDS_AFTER: usize = 6;
const MAX_ROUNDS_AFTER: usize = 30;

/// An edge shorter than this multiple of its target length is collapsed, unless that would damage a crease.
const SHORT_RATIO: f64 = 0.6;

/// Maximum distance of a corner from a segment that meets others there, as a multiple of the target edge length.
const MAX_CORNER_MISFIT: f64 = 0.15;

/// Maximum displacement of a vertex, as a multiple of the maximum distance between a rim vertex and the rim's centroid. Segments that meet
/// farther away are parts of different shapes.
const MAX_DISPLACEMENT: f64 = 1.0;

/// Returns the smooth fill `triangulation` with the creases of the surrounding surface extended across it. Returns `None` if no crease ends
/// at the hole's rim, if the creases do not meet, or if more than `max_folded` faces are folded.
///
/// # Errors
/// Returns an error if the evaluation is cancelled.
pub(crate) fn sharpen(
    filling: &Filling,
    triangulation: &Triangulation,
    rim: &Rim,
    sizes: &Sizes,
    max_folded: usize,
    progress: &Progress<'_>,
) -> Result<Option<Triangulation>, CancelledError> {
    let Some(charts) = Charts::find(filling, rim) else { return Ok(None) };
    let mut best: Option<(usize, Sharpening<'_>)> = None;
    for rounds in ROUND_COUNTS {
        let mut sets = charts.rim_sets.clone();
        sets.resize(triangulation.points.len(), 0);
        let mut sharp = Sharpening {
            triangulation: triangulation.clone(),
            charts: &charts,
            sets,
            rim,
            sizes,
            is_cut: false,
        };
        for _ in 0..rounds {
            progress.check()?;
            sharp.choose_segments();
            sharp.slide();
        }
        sharp.choose_segments();
        sharp.split_at_creases();
        sharp.is_cut = true;
        for round in 0..MAX_ROUNDS_AFTER {
            progress.check()?;
            if round >= MIN_ROUNDS_AFTER && sharp.count_folded() == 0 {
                break;
            }
            sharp.slide();
            sharp.collapse_short();
            sharp.flip_all();
        }
        sharp.slide();
        let folded = sharp.count_folded();
        let is_better = best.as_ref().is_none_or(|(min_folded, _)| folded < *min_folded);
        if is_better && sharp.is_near(triangulation, rim) {
            best = Some((folded, sharp));
        }
        if best.as_ref().is_some_and(|(min_folded, _)| *min_folded == 0) {
            break;
        }
    }
    let best = best.filter(|(folded, _)| *folded <= max_folded);
    Ok(best.map(|(_, sharp)| sharp.triangulation))
}

struct Sharpening<'a> {
    triangulation: Triangulation,
    charts: &'a Charts,
    /// For each vertex, the set of smooth segments that contain it, one bit per segment.
    sets: Vec<u32>,
    rim: &'a Rim,
    sizes: &'a Sizes,
    /// True once edges are split at the creases; from then on, no move may turn a face over.
    is_cut: bool,
}

impl Sharpening<'_> {
    fn inner_vertices(&self) -> impl Iterator<Item = u32> + use<> {
        let alive: Vec<u32> = (self.triangulation.fixed as u32
            ..self.triangulation.points.len() as u32)
            .filter(|&vertex| self.triangulation.leaving[vertex as usize] != NONE)
            .collect();
        alive.into_iter()
    }

    fn vertex_set(&self, vertex: u32) -> u32 {
        self.sets[vertex as usize]
    }

    /// Returns the set of segments that contain all three corners of a face.
    fn face_set(&self, half: u32) -> u32 {
        let first = half / 3 * 3;
        (first..first + 3).fold(u32::MAX, |set, half| {
            set & self.vertex_set(self.triangulation.corners[half as usize])
        })
    }

    /// Assigns each inner vertex to one segment. If segments meet convexly, this is the segment with the largest signed distance; if
    /// concavely, the one with the smallest signed distance; otherwise the one with the smallest absolute distance.
    fn choose_segments(&mut self) {
        for vertex in self.inner_vertices() {
            let point = self.triangulation.points[vertex as usize];
            let ranks = self.charts.charts.iter().map(|chart| {
                let distance = chart.distance(point).0;
                match self.charts.kind {
                    CreaseKind::Convex => -distance,
                    CreaseKind::Concave => distance,
                    CreaseKind::Mixed => distance.abs(),
                }
            });
            let best = ranks.enumerate().min_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
            self.sets[vertex as usize] = best.map_or(1, |(chart, _)| 1 << chart);
        }
    }

    /// Moves a point approximately to the nearest position that is on the surfaces of all segments in `set`.
    fn project(&self, mut point: Point3<f64>, set: u32) -> Point3<f64> {
        for _ in 0..4 {
            // Project to one surface after the other, each time at right angles to the previous steps, so that the point stays on the
            // surfaces that it has already reached.
            let mut done: Vec<Vector3<f64>> = Vec::new();
            for (_, chart) in (0_u32..).zip(&self.charts.charts).filter(|(k, _)| set >> k & 1 == 1)
            {
                let (distance, normal) = chart.distance(point);
                let along: Vector3<f64> = done.iter().map(|other| other * other.dot(&normal)).sum();
                let free = normal - along;
                let size_sq = free.norm_squared();
                if size_sq > 1e-4 {
                    point -= free * (distance / size_sq);
                    done.push(free / size_sq.sqrt());
                }
            }
        }
        point
    }

    /// Moves each inner vertex halfway to the centroid of its neighbors, and projects it to its segments.
    fn slide(&mut self) {
        for vertex in self.inner_vertices() {
            let set = self.vertex_set(vertex);
            if set.count_ones() > 2 {
                continue;
            }
            let (mut sum, mut weight) = (Vector3::zeros(), 0.0);
            let at = self.triangulation.points[vertex as usize];
            for half in self.triangulation.halves_around(vertex) {
                let other = self.triangulation.ends(half)[1];
                if self.vertex_set(other) & set == set || set.count_ones() < 2 {
                    sum += self.triangulation.points[other as usize] - at;
                    weight += 1.0;
                }
            }
            let middle = if weight > 0.0 { at + sum * (0.5 / weight) } else { at };
            let position = self.project(middle, set);
            if !self.is_cut || self.stays_upright(vertex, position) {
                self.triangulation.points[vertex as usize] = position;
            }
        }
    }

    /// Returns true if no face around the vertex turns over when the vertex moves to `position`.
    fn stays_upright(&self, vertex: u32, position: Point3<f64>) -> bool {
        self.triangulation.halves_around(vertex).all(|half| {
            let [b, c] = [next(half), previous(half)].map(|half| {
                self.triangulation.points[self.triangulation.corners[half as usize] as usize]
            });
            let set = self.face_set(half);
            let at = self.triangulation.points[vertex as usize];
            set == 0 || self.is_upright([position, b, c], set) || !self.is_upright([at, b, c], set)
        })
    }

    /// Splits the edges that cross creases, that is, whose ends have no segment in common.
    fn split_at_creases(&mut self) {
        for _ in 0..4 {
            let halves: Vec<u32> = self.triangulation.inner_edges().collect();
            let mut count = 0;
            for half in halves {
                let [a, b] = self.triangulation.ends(half);
                if self.triangulation.twins[half as usize] == NONE
                    || self.vertex_set(a) & self.vertex_set(b) != 0
                {
                    continue;
                }
                let position = self.crossing(a, b);
                let set = self.vertex_set(a) | self.vertex_set(b);
                self.triangulation.split(half, position);
                let (position, set) = self.crease_point(position, set);
                self.sets.push(set);
                let vertex = self.sets.len() as u32 - 1;
                self.triangulation.points[vertex as usize] = position;
                count += 1;
            }
            if count == 0 {
                return;
            }
        }
    }

    /// Returns the point near a position where the segments in `set` meet, and the set of all segments that meet there. Beyond a corner,
    /// the curve in which two segments meet is cut off by a third one; then the point is the corner. More than three segments may meet in
    /// one corner.
    fn crease_point(&self, position: Point3<f64>, mut set: u32) -> (Point3<f64>, u32) {
        let tolerance = MAX_CORNER_MISFIT * self.sizes.length_at(position);
        let sign = match self.charts.kind {
            CreaseKind::Convex => 1.0,
            CreaseKind::Concave => -1.0,
            CreaseKind::Mixed => 0.0,
        };
        loop {
            let point = self.project(position, set);
            let others = (0_u32..).zip(&self.charts.charts).filter(|(k, _)| set >> k & 1 == 0);
            let heights = others.map(|(k, chart)| (chart.distance(point).0, k));
            let heights: Vec<(f64, u32)> = heights.collect();
            let above = heights.iter().map(|&(height, k)| (sign * height, k));
            let highest = above.max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)));
            match highest {
                Some((height, other)) if height > tolerance && set.count_ones() < 3 => {
                    set |= 1 << other;
                }
                _ if set.count_ones() < 3 => return (point, set),
                _ => {
                    let near = heights.iter().filter(|(height, _)| height.abs() <= tolerance);
                    return (point, near.fold(set, |set, (_, k)| set | 1 << k));
                }
            }
        }
    }

    /// Returns the point on the edge between two vertices that is about equally far from the segments of both vertices.
    fn crossing(&self, a: u32, b: u32) -> Point3<f64> {
        let [chart_a, chart_b] = [a, b]
            .map(|vertex| &self.charts.charts[self.vertex_set(vertex).trailing_zeros() as usize]);
        let [pa, pb] = [a, b].map(|vertex| self.triangulation.points[vertex as usize]);
        let [at_a, at_b] =
            [pa, pb].map(|point| chart_a.distance(point).0 - chart_b.distance(point).0);
        let fraction = if at_a * at_b < 0.0 { at_a / (at_a - at_b) } else { 0.5 };
        pa + (pb - pa) * fraction.clamp(0.1, 0.9)
    }

    /// Collapses each short edge into one of its ends. That end must be on all segments that contain the other end.
    fn collapse_short(&mut self) {
        let halves: Vec<u32> = self.triangulation.inner_edges().collect();
        for half in halves {
            let twin = self.triangulation.twins[half as usize];
            if !self.triangulation.is_alive(half) || twin == NONE {
                continue;
            }
            let [a, b] = self
                .triangulation
                .ends(half)
                .map(|vertex| self.triangulation.points[vertex as usize]);
            let size = self.sizes.length_at(nalgebra::center(&a, &b));
            if (b - a).norm() < SHORT_RATIO * size && !self.collapse(half) {
                self.collapse(twin);
            }
        }
    }

    fn collapse(&mut self, half: u32) -> bool {
        let [v, u] = self.triangulation.ends(half);
        let along = self.face_set(half) & self.face_set(self.triangulation.twins[half as usize]);
        let stays_sharp = self.vertex_set(v).count_ones() == 1 || along == 0;
        let is_within = self.vertex_set(v) & !self.vertex_set(u) == 0;
        if !stays_sharp || !is_within || !self.triangulation.may_collapse(half) {
            return false;
        }
        let position = self.triangulation.points[u as usize];
        let keeps = self.triangulation.halves_around(v).all(|half| {
            let [b, c] =
                [next(half), previous(half)].map(|half| self.triangulation.corners[half as usize]);
            b == u || c == u || {
                let set = self.vertex_set(u) & self.vertex_set(b) & self.vertex_set(c);
                let points = [
                    position,
                    self.triangulation.points[b as usize],
                    self.triangulation.points[c as usize],
                ];
                set != 0 && self.is_upright(points, set)
            }
        });
        if keeps {
            self.triangulation.collapse(half);
        }
        keeps
    }

    /// Returns true if a triangle has the orientation of the segments in `set`, which contain it.
    fn is_upright(&self, points: [Point3<f64>; 3], set: u32) -> bool {
        let area = area_vector(points);
        let normal = self.charts.charts[set.trailing_zeros() as usize].distance(points[0]).1;
        area.dot(&normal) > 0.3 * area.norm()
    }

    fn flip_all(&mut self) {
        let mut queue: Vec<u32> = self.triangulation.inner_edges().collect();
        let mut left = 4 * queue.len();
        while let Some(half) = queue.pop() {
            if left == 0 {
                return;
            }
            if self.triangulation.is_alive(half) && self.should_flip(half) {
                self.triangulation.flip(half);
                left -= 1;
                let (f, g) =
                    (half / 3 * 3, self.triangulation.twins[half as usize / 3 * 3 + 1] / 3 * 3);
                queue.extend([f, f + 2, g, g + 1]);
            }
        }
    }

    fn should_flip(&self, half: u32) -> bool {
        let twin = self.triangulation.twins[half as usize];
        if twin == NONE {
            return false;
        }
        let triangulation = &self.triangulation;
        let [a, b] = triangulation.ends(half);
        let c = triangulation.corners[previous(half) as usize];
        let d = triangulation.corners[previous(twin) as usize];
        let [on_f, on_g] = [half, twin].map(|half| self.face_set(half));
        let new = [a, b].map(|end| self.vertex_set(end) & self.vertex_set(c) & self.vertex_set(d));
        let is_crease = on_f & on_g == 0;
        if c == d || new.contains(&0) {
            return false;
        }
        let [pa, pb, pc, pd] = [a, b, c, d].map(|vertex| triangulation.points[vertex as usize]);
        if !self.is_upright([pa, pd, pc], new[0]) || !self.is_upright([pd, pb, pc], new[1]) {
            return false;
        }
        // A face that spans a crease has no segment that contains all its corners. Flip its edge, whatever the angles are.
        if on_f == 0 || on_g == 0 {
            return !self.is_edge(c, d);
        }
        !is_crease && cotangent(pc, pa, pb) + cotangent(pd, pa, pb) < -1e-9 && !self.is_edge(c, d)
    }

    /// Returns true if the fill or the input mesh has an edge between two vertices, or if the input mesh may get one when another hole is
    /// filled.
    fn is_edge(&self, c: u32, d: u32) -> bool {
        let triangulation = &self.triangulation;
        if triangulation.is_rim(c) && triangulation.is_rim(d) {
            // The faces of the fill around a rim vertex do not form a closed ring, so search all half-edges.
            let ends = (0..triangulation.corners.len() as u32)
                .filter(|&half| triangulation.is_alive(half));
            return self.rim.is_taken(c as usize, d as usize)
                || ends
                    .map(|half| triangulation.ends(half))
                    .any(|ends| ends == [c, d] || ends == [d, c]);
        }
        let [inner, other] = if triangulation.is_rim(c) { [d, c] } else { [c, d] };
        triangulation.halves_around(inner).any(|half| triangulation.ends(half)[1] == other)
    }

    /// Returns the number of faces that have no segment common to all corners, or whose orientation is wrong.
    fn count_folded(&self) -> usize {
        let faces = (0..self.triangulation.corners.len() as u32).step_by(3);
        faces
            .filter(|&half| self.triangulation.is_alive(half))
            .filter(|&half| {
                let corners = [half, half + 1, half + 2]
                    .map(|half| self.triangulation.corners[half as usize]);
                let set = self.face_set(half);
                let points = corners.map(|vertex| self.triangulation.points[vertex as usize]);
                set == 0 || !self.is_upright(points, set)
            })
            .count()
    }

    /// Returns true if each inner vertex is within the allowed distance of its position in `start`.
    fn is_near(&self, start: &Triangulation, rim: &Rim) -> bool {
        let sum: Vector3<f64> = rim.points.iter().map(|point| point.coords).sum();
        let middle = Point3::from(sum / rim.len() as f64);
        let radius = rim.points.iter().map(|point| (point - middle).norm()).fold(0.0, f64::max);
        self.inner_vertices().all(|vertex: u32| {
            let from = start.points.get(vertex as usize);
            from.is_none_or(|from| {
                (self.triangulation.points[vertex as usize] - from).norm()
                    <= MAX_DISPLACEMENT * radius
            })
        })
    }
}
