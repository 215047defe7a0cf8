//! Extends the smooth segments around a hole until they meet in creases, and joins these across it.
//!
//! Each vertex of a smooth fill is assigned to the nearest segment. Where an edge runs from one segment to another, it is split at the
//! crease between them, or at the corner where three meet. Then vertices slide along their segments, and those of creases along the
//! creases. So creases end at the rim where those of the data do.

use maquette_node::{Cancelled, Progress};
use nalgebra::{Point3, Vector3};

use super::charts::{Charts, Edge};
use crate::border::rim::Rim;
use crate::plain::sizes::Sizes;
use crate::triangles::filling::Filling;
use crate::triangles::triangulation::{NONE, Triangulation, area_vector, next, previous};

/// How often vertices slide and go back to their surfaces before creases are cut into them. Where faces are folded in the end, another
/// number is tried: then other edges cross the creases.
const ROUNDS: [usize; 6] = [12, 4, 24, 8, 16, 2];

/// The same afterwards, at most; it ends when no face is folded any more.
const AFTER: usize = 6;
const MOST_AFTER: usize = 30;

/// An edge shorter than this many times its target is collapsed, where creases allow it.
const SHORT: f64 = 0.6;

/// The most that any vertex may move, in the largest distance of the rim from its centroid: segments that meet farther out do not belong
/// together.
const FARTHEST: f64 = 1.0;

/// `triangulation`, a smooth fill, with the data's creases extended across it; none if no creases end at the rim, or they do not meet.
///
/// # Errors
/// If the evaluation is told to stop.
pub(crate) fn sharpen(
    filling: &Filling,
    triangulation: &Triangulation,
    rim: &Rim,
    sizes: &Sizes,
    progress: &Progress<'_>,
) -> Result<Option<Triangulation>, Cancelled> {
    let Some(charts) = Charts::around(filling, rim) else { return Ok(None) };
    let mut best: Option<(usize, Sharp<'_>)> = None;
    for rounds in ROUNDS {
        let mut sets = charts.of_rim.clone();
        sets.resize(triangulation.points.len(), 0);
        let mut sharp = Sharp {
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
        sharp.cut();
        sharp.is_cut = true;
        for round in 0..MOST_AFTER {
            progress.check()?;
            if round >= AFTER && sharp.folded() == 0 {
                break;
            }
            sharp.slide();
            sharp.collapse_short();
            sharp.flip_all();
        }
        sharp.slide();
        let folded = sharp.folded();
        let better = best.as_ref().is_none_or(|(least, _)| folded < *least);
        if better && sharp.is_sound(triangulation, rim) {
            best = Some((folded, sharp));
        }
        if best.as_ref().is_some_and(|(least, _)| *least == 0) {
            break;
        }
    }
    Ok(best.map(|(_, sharp)| sharp.triangulation))
}

struct Sharp<'a> {
    triangulation: Triangulation,
    charts: &'a Charts,
    /// Of each vertex the set of segments on which it lies.
    sets: Vec<u32>,
    rim: &'a Rim,
    sizes: &'a Sizes,
    /// Whether edges are split at the creases; from then on no face may turn over.
    is_cut: bool,
}

impl Sharp<'_> {
    fn inner(&self) -> impl Iterator<Item = u32> + use<> {
        let alive: Vec<u32> = (self.triangulation.fixed as u32
            ..self.triangulation.points.len() as u32)
            .filter(|&vertex| self.triangulation.leaving[vertex as usize] != NONE)
            .collect();
        alive.into_iter()
    }

    fn set(&self, vertex: u32) -> u32 {
        self.sets[vertex as usize]
    }

    /// The segments that all corners of a face have in common.
    fn face_set(&self, half: u32) -> u32 {
        let first = half / 3 * 3;
        (first..first + 3)
            .fold(u32::MAX, |set, half| set & self.set(self.triangulation.corners[half as usize]))
    }

    /// Assigns each inner vertex to the segment whose surface is outermost there (of convex ones), innermost, or nearest.
    fn choose_segments(&mut self) {
        for vertex in self.inner() {
            let point = self.triangulation.points[vertex as usize];
            fn rank(distance: f64, charts_meeting: &Edge) -> f64 {
                match *charts_meeting {
                    Edge::Convex => -distance,
                    Edge::Concave => distance,
                    Edge::Mixed => distance.abs(),
                }
            }
            let ranks = self
                .charts
                .charts
                .iter()
                .map(|chart| rank(chart.distance(point).0, &self.charts.meeting));
            let best = ranks.enumerate().min_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
            self.sets[vertex as usize] = best.map_or(1, |(chart, _)| 1 << chart);
        }
    }

    /// The nearest place, about, that is on all surfaces of a set.
    fn onto(&self, mut point: Point3<f64>, set: u32) -> Point3<f64> {
        let charts = || (0..self.charts.charts.len()).filter(|chart| set >> chart & 1 == 1);
        for _ in 0..4 {
            // One surface after the other until they agree, each step at right angles to the surfaces before it.
            let mut done: Vec<Vector3<f64>> = Vec::new();
            for chart in charts() {
                let (distance, normal) = self.charts.charts[chart].distance(point);
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

    /// Relaxes vertices along the segments that they are on: each goes half-way to the centroid of its neighbors.
    fn slide(&mut self) {
        for vertex in self.inner() {
            let set = self.set(vertex);
            if set.count_ones() > 2 {
                continue;
            }
            let (mut sum, mut weight) = (Vector3::zeros(), 0.0);
            let at = self.triangulation.points[vertex as usize];
            for half in self.triangulation.around(vertex) {
                let other = self.triangulation.ends(half)[1];
                if self.set(other) & set == set || set.count_ones() < 2 {
                    sum += self.triangulation.points[other as usize] - at;
                    weight += 1.0;
                }
            }
            let middle = if weight > 0.0 { at + sum * (0.5 / weight) } else { at };
            let place = self.onto(middle, set);
            if !self.is_cut || self.stays_upright(vertex, place) {
                self.triangulation.points[vertex as usize] = place;
            }
        }
    }

    /// Whether no face around a vertex turns over if it goes to a place.
    fn stays_upright(&self, vertex: u32, place: Point3<f64>) -> bool {
        self.triangulation.around(vertex).all(|half| {
            let [b, c] = [next(half), previous(half)].map(|half| {
                self.triangulation.points[self.triangulation.corners[half as usize] as usize]
            });
            let set = self.face_set(half);
            let at = self.triangulation.points[vertex as usize];
            set == 0 || self.is_upright([place, b, c], set) || !self.is_upright([at, b, c], set)
        })
    }

    /// Splits edges where they cross creases: those from one segment to another.
    fn cut(&mut self) {
        for _ in 0..4 {
            let halves: Vec<u32> = self.triangulation.inner_edges().collect();
            let mut count = 0;
            for half in halves {
                let [a, b] = self.triangulation.ends(half);
                if self.triangulation.twins[half as usize] == NONE || self.set(a) & self.set(b) != 0
                {
                    continue;
                }
                let place = self.crossing(a, b);
                let set = self.set(a) | self.set(b);
                self.triangulation.split(half, place);
                self.sets.push(set);
                let vertex = self.sets.len() as u32 - 1;
                self.triangulation.points[vertex as usize] = self.onto(place, set);
                count += 1;
            }
            if count == 0 {
                return;
            }
        }
    }

    /// The point between two vertices of different segments that is equally far from both segments.
    fn crossing(&self, a: u32, b: u32) -> Point3<f64> {
        let chart = |vertex: u32| &self.charts.charts[self.set(vertex).trailing_zeros() as usize];
        let (pa, pb) =
            (self.triangulation.points[a as usize], self.triangulation.points[b as usize]);
        let lead = |point| chart(a).distance(point).0 - chart(b).distance(point).0;
        let (at_a, at_b) = (lead(pa), lead(pb));
        let share = if at_a * at_b < 0.0 { at_a / (at_a - at_b) } else { 0.5 };
        pa + (pb - pa) * share.clamp(0.1, 0.9)
    }

    /// Collapses short edges into an end that is on all segments of the other one.
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
            let size = self.sizes.at(nalgebra::center(&a, &b));
            if (b - a).norm() < SHORT * size && !self.collapse(half) {
                self.collapse(twin);
            }
        }
    }

    fn collapse(&mut self, half: u32) -> bool {
        let [v, u] = self.triangulation.ends(half);
        let along = self.face_set(half) & self.face_set(self.triangulation.twins[half as usize]);
        let stays_sharp = self.set(v).count_ones() == 1 || along == 0;
        let is_within = self.set(v) & !self.set(u) == 0;
        if !stays_sharp || !is_within || !self.triangulation.may_collapse(half) {
            return false;
        }
        let place = self.triangulation.points[u as usize];
        let keeps = self.triangulation.around(v).all(|half| {
            let [b, c] =
                [next(half), previous(half)].map(|half| self.triangulation.corners[half as usize]);
            b == u || c == u || {
                let set = self.set(u) & self.set(b) & self.set(c);
                let points = [
                    place,
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

    /// Whether a triangle faces the same side as the segments that it is on.
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
        let new = [a, b].map(|end| self.set(end) & self.set(c) & self.set(d));
        let is_crease = on_f & on_g == 0;
        if c == d || new.contains(&0) {
            return false;
        }
        let [pa, pb, pc, pd] = [a, b, c, d].map(|vertex| triangulation.points[vertex as usize]);
        if !self.is_upright([pa, pd, pc], new[0]) || !self.is_upright([pd, pb, pc], new[1]) {
            return false;
        }
        // A face that bridges a crease, on no segment, goes first.
        if on_f == 0 || on_g == 0 {
            return !self.is_edge(c, d);
        }
        fn cotangent(at: Point3<f64>, pa: Point3<f64>, pb: Point3<f64>) -> f64 {
            let [u, v] = [pa - at, pb - at];
            u.dot(&v) / u.cross(&v).norm().max(f64::MIN_POSITIVE)
        }
        !is_crease && cotangent(pc, pa, pb) + cotangent(pd, pa, pb) < -1e-9 && !self.is_edge(c, d)
    }

    /// Whether there is an edge between two vertices, or the data has one, or may get one.
    fn is_edge(&self, c: u32, d: u32) -> bool {
        let triangulation = &self.triangulation;
        if triangulation.is_rim(c) && triangulation.is_rim(d) {
            // The faces around a vertex of the rim do not go all around it.
            let ends = (0..triangulation.corners.len() as u32)
                .filter(|&half| triangulation.is_alive(half));
            return self.rim.is_taken(c as usize, d as usize)
                || ends
                    .map(|half| triangulation.ends(half))
                    .any(|ends| ends == [c, d] || ends == [d, c]);
        }
        let [inner, other] = if triangulation.is_rim(c) { [d, c] } else { [c, d] };
        triangulation.around(inner).any(|half| triangulation.ends(half)[1] == other)
    }

    /// How many faces lie on no segment, or do not face the side of theirs.
    fn folded(&self) -> usize {
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

    /// Whether no vertex went too far.
    fn is_sound(&self, start: &Triangulation, rim: &Rim) -> bool {
        let sum: Vector3<f64> = rim.points.iter().map(|point| point.coords).sum();
        let middle = Point3::from(sum / rim.len() as f64);
        let radius = rim.points.iter().map(|point| (point - middle).norm()).fold(0.0, f64::max);
        self.inner().all(|vertex: u32| {
            let from = start.points.get(vertex as usize);
            from.is_none_or(|from| {
                (self.triangulation.points[vertex as usize] - from).norm() <= FARTHEST * radius
            })
        })
    }
}
