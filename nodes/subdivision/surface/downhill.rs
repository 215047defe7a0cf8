//! From a place of a limit surface downhill to the nearest one around, from face to face, but not into all of them.
//!
//! Steps of Newton for the square of the distance lead straight to the side of a face; there the neighbor takes over. Where there is
//! none, or at a crease from which both sides lead away, the walk goes on along the side.

use nalgebra::{Point3, Vector3};

use super::limit_point::LimitPoint;
use crate::refine::connectivity::Connectivity;
use crate::refine::half_edges::{HalfEdges, NONE};

/// A surface over the faces of a mesh that are all triangles or all quads.
pub(crate) trait Parts {
    /// The mesh of the faces.
    fn mesh(&self) -> &Connectivity;

    /// The part over a face.
    fn part(&self, part: u32) -> impl Part;
}

/// A part of a surface. It remembers what the next place is found by.
pub(crate) trait Part {
    /// The point at a place.
    fn at(&mut self, at: [f64; 2]) -> LimitPoint;
}

/// A place on a face.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Spot {
    pub(crate) part: u32,
    pub(crate) at: [f64; 2],
}

/// The end of a walk.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Nearest {
    pub(crate) spot: Spot,
    pub(crate) point: LimitPoint,
    /// Whether it is at the end of what may be entered, at a border or at a crease, where there may be no perpendicular.
    pub(crate) held: bool,
}

/// Most points of the surface that are looked at: some three are usual, some ten at corners with many neighbors.
const MOST_LOOKS: usize = 40;

/// Steps that lead aside by less than this share of the distance are not taken: they change it by half of the share's square.
const ASIDE: f64 = 1e-6;

/// A step that does not come nearer is cut to a quarter, so often.
const QUARTERS: usize = 4;

/// Coordinates this near to a side are on it.
const ON_SIDE: f64 = 1e-13;

/// The place from which no step leads nearer to `to`, on the faces that `may_enter` allows.
pub(crate) fn downhill(
    surface: &impl Parts,
    start: Spot,
    to: Point3<f64>,
    may_enter: impl Fn(u32) -> bool,
) -> Nearest {
    let mesh = surface.mesh();
    let count = mesh.faces.sides().unwrap_or_default() as u32;
    let sides = Sides { mesh, count, may_enter };
    let mut part = surface.part(start.part);
    let (mut spot, mut point) = (start, part.at(start.at));
    let (mut looks, mut came, mut held) = (1, NONE, false);
    while looks < MOST_LOOKS {
        let spoke = to - point.point;
        let Some(slope) = Slope::new(&point, spoke) else { break };
        let way = sides.way(spot, came, &slope);
        fn is_foot(step: [f64; 2], slope: &Slope, spoke: Vector3<f64>) -> bool {
            slope.length_sq(step) <= ASIDE * ASIDE * spoke.norm_squared()
        }
        // At a foot on a side, rounding alone may lead to and fro across it.
        held = matches!(way, Way::Along(_) | Way::Nowhere) && !is_foot(slope.step(), &slope, spoke);
        match way {
            Way::Nowhere => break,
            Way::Through(half) => {
                (spot, came) = (sides.entered(spot, half), half);
                part = surface.part(spot.part);
                (point, looks) = (part.at(spot.at), looks + 1);
            }
            Way::Across(step) | Way::Along(step) => {
                if is_foot(step, &slope, spoke) {
                    break;
                }
                let end = sides.cut(spot.at, step);
                let cuts = (0..QUARTERS)
                    .scan(1.0, |share, _| Some(std::mem::replace(share, *share / 4.0)));
                let nearer = cuts.into_iter().find_map(|share| {
                    let at = match share {
                        1.0 => end,
                        _ => [0, 1].map(|k| spot.at[k] + (end[k] - spot.at[k]) * share),
                    };
                    let point = part.at(at);
                    looks += 1;
                    let is_nearer = (to - point.point).norm_squared() < spoke.norm_squared();
                    is_nearer.then_some((Spot { at, ..spot }, point))
                });
                let Some(nearer) = nearer else { break };
                ((spot, point), came) = (nearer, NONE);
            }
        }
    }
    Nearest { spot, point, held }
}

/// Which way the square of the distance falls, and how it curves.
struct Slope {
    first: [Vector3<f64>; 2],
    falls: [f64; 2],
    curves: [f64; 3],
}

impl Slope {
    /// None where the surface has no derivatives.
    fn new(point: &LimitPoint, spoke: Vector3<f64>) -> Option<Self> {
        let first @ [u, v] = point.first;
        let [uu, uv, vv] = point.second?.map(|second| second.dot(&spoke));
        let flat = [u.norm_squared(), u.dot(&v), v.norm_squared()];
        let curved = [flat[0] - uu, flat[1] - uv, flat[2] - vv];
        // Where it curves down, as if the surface were flat: that leads down as well.
        let curves =
            [curved, flat].into_iter().find(|[a, b, d]| *a > 0.0 && a * d - b * b > 0.0)?;
        Some(Self { first, falls: [u.dot(&spoke), v.dot(&spoke)], curves })
    }

    fn step(&self) -> [f64; 2] {
        let ([a, b, d], [x, y]) = (self.curves, self.falls);
        let area = a * d - b * b;
        [(x * d - y * b) / area, (y * a - x * b) / area]
    }

    fn step_along(&self, [s, t]: [f64; 2]) -> [f64; 2] {
        let ([a, b, d], [x, y]) = (self.curves, self.falls);
        let length = (s * x + t * y) / (a * s * s + 2.0 * b * s * t + d * t * t);
        [s * length, t * length]
    }

    fn length_sq(&self, [s, t]: [f64; 2]) -> f64 {
        (self.first[0] * s + self.first[1] * t).norm_squared()
    }
}

/// Where a walk goes on.
enum Way {
    /// By a step within the face.
    Across([f64; 2]),
    /// By a step along a side, which holds it back.
    Along([f64; 2]),
    /// In the face of this half-edge, across a side.
    Through(u32),
    Nowhere,
}

/// The sides of the faces: side `k` runs from corner `k` to the next, and is half-edge `k` of its face.
struct Sides<'a, F> {
    mesh: &'a Connectivity,
    /// Three or four.
    count: u32,
    may_enter: F,
}

impl<F: Fn(u32) -> bool> Sides<'_, F> {
    /// Where the slope leads from a spot in whose face the walk came through the half-edge `came`.
    fn way(&self, spot: Spot, came: u32, slope: &Slope) -> Way {
        let step = slope.step();
        let Some(side) = self.out(spot.at, step).next() else { return Way::Across(step) };
        let door = |step: [f64; 2]| {
            let halves = self.out(spot.at, step).map(|side| self.count * spot.part + side);
            let twins = halves.filter(|&half| half != came).map(|half| self.mesh.twin(half));
            twins.into_iter().find(|&twin| twin != NONE && (self.may_enter)(twin / self.count))
        };
        if let Some(half) = door(step) {
            return Way::Through(half);
        }
        let [from, to] = [0.0, 1.0].map(|share| self.place(side, share));
        let along = slope.step_along([to[0] - from[0], to[1] - from[1]]);
        match (door(along), self.out(spot.at, along).next()) {
            (Some(half), _) => Way::Through(half),
            (None, Some(_)) => Way::Nowhere,
            (None, None) => Way::Along(along),
        }
    }

    /// The sides on which a place lies and across which a step leads.
    fn out(&self, at: [f64; 2], step: [f64; 2]) -> impl Iterator<Item = u32> {
        (0..self.count)
            .filter(move |side| self.room(*side, at) <= ON_SIDE && self.rate(*side, step) < 0.0)
    }

    /// How far a place is from a side, which is 1 at the other end of the face.
    fn room(&self, side: u32, [u, v]: [f64; 2]) -> f64 {
        match (self.count, side) {
            (_, 0) => v,
            (3, 1) => 1.0 - u - v,
            (3, _) | (_, 3) => u,
            (_, 1) => 1.0 - u,
            _ => 1.0 - v,
        }
    }

    /// How much of that a step gains.
    fn rate(&self, side: u32, [u, v]: [f64; 2]) -> f64 {
        match (self.count, side) {
            (_, 0) => v,
            (3, 1) => -(u + v),
            (3, _) | (_, 3) => u,
            (_, 1) => -u,
            _ => -v,
        }
    }

    /// The place on a side at a share of its way.
    fn place(&self, side: u32, share: f64) -> [f64; 2] {
        let rest = 1.0 - share;
        match (self.count, side) {
            (_, 0) => [share, 0.0],
            (3, 1) => [rest, share],
            (3, _) | (_, 3) => [0.0, rest],
            (_, 1) => [1.0, share],
            _ => [rest, 1.0],
        }
    }

    /// The share of the way of a side at which a place on it is.
    fn share(&self, side: u32, [u, v]: [f64; 2]) -> f64 {
        let share = match (self.count, side) {
            (_, 0) => u,
            (_, 1) => v,
            (4, 2) => 1.0 - u,
            _ => 1.0 - v,
        };
        share.clamp(0.0, 1.0)
    }

    /// The end of a step, or where it first meets a side.
    fn cut(&self, at: [f64; 2], step: [f64; 2]) -> [f64; 2] {
        fn reached(share: f64, at: [f64; 2], step: [f64; 2]) -> [f64; 2] {
            [at[0] + step[0] * share, at[1] + step[1] * share]
        }
        let meets = (0..self.count).filter_map(|side| {
            let rate = self.rate(side, step);
            let share = self.room(side, at).max(0.0) / -rate;
            (rate < 0.0 && share < 1.0).then_some((share, side))
        });
        match meets.min_by(|a, b| a.0.total_cmp(&b.0)) {
            Some((share, side)) => self.place(side, self.share(side, reached(share, at, step))),
            None => reached(1.0, at, step),
        }
    }

    /// The same place in the face of a half-edge.
    fn entered(&self, spot: Spot, half: u32) -> Spot {
        let side = self.mesh.twin(half) % self.count;
        let share = 1.0 - self.share(side, spot.at);
        Spot { part: half / self.count, at: self.place(half % self.count, share) }
    }
}
