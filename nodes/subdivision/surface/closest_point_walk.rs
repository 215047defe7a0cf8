//! Local search for the closest point of a limit surface: a descent from face to face, restricted to a given set of faces.
//!
//! Newton steps for the squared distance are clipped at the sides of a face. At a side the walk continues in the neighboring face. If there
//! is no neighbor, or if the steps on both sides of a crease lead back to the crease, the walk continues along the side.

use nalgebra::{Point3, Vector3};

use super::limit_point::LimitPoint;
use crate::refine::connectivity::Connectivity;
use crate::refine::half_edges::{HalfEdges, NONE};

/// A surface made of parts, one over each face of a triangle mesh or quad mesh.
pub(crate) trait Parts {
    /// The mesh whose faces carry the parts.
    fn mesh(&self) -> &Connectivity;

    /// Returns the part of the surface over the face with the index `part`.
    fn part(&self, part: u32) -> impl Part;
}

/// A part of a surface. It may cache data between evaluations.
pub(crate) trait Part {
    /// Evaluates the surface at the coordinates `at` of the face.
    fn evaluate(&mut self, at: [f64; 2]) -> LimitPoint;
}

/// A face and the coordinates of a position on it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FacePosition {
    pub(crate) part: u32,
    pub(crate) at: [f64; 2],
}

/// The closest point that a walk has found.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Nearest {
    pub(crate) spot: FacePosition,
    pub(crate) point: LimitPoint,
    /// True if the walk was stopped by a border, by a crease, or by a face that the walk may not enter. Then the line to the closest point
    /// need not be perpendicular to the surface.
    pub(crate) held: bool,
}

/// The maximum number of evaluations of the surface. About three are usual; near corners with many neighbors about ten.
const MAX_EVALUATIONS: usize = 40;

/// The minimum length of a step relative to the distance. A step of the relative length `s` changes the distance by less than the fraction
/// `s^2 / 2`, so shorter steps are useless.
const MIN_RELATIVE_STEP: f64 = 1e-6;

/// The maximum number of times that a step is shortened to a quarter, as long as it does not reduce the distance.
const MAX_REDUCTIONS: usize = 4;

/// A position whose coordinates are within this distance of a side of a face counts as on the side.
const SIDE_TOLERANCE: f64 = 1e-13;

/// Walks to a local minimum of the distance to `to`. The walk enters only faces for which `may_enter` returns true.
pub(crate) fn walk_to_closest_point(
    surface: &impl Parts,
    start: FacePosition,
    to: Point3<f64>,
    may_enter: impl Fn(u32) -> bool,
) -> Nearest {
    let mesh = surface.mesh();
    let count = mesh.faces.sides().unwrap_or_default() as u32;
    let sides = Sides { mesh, count, may_enter };
    let mut part = surface.part(start.part);
    let (mut spot, mut point) = (start, part.evaluate(start.at));
    let (mut looks, mut came, mut held) = (1, NONE, false);
    while looks < MAX_EVALUATIONS {
        let spoke = to - point.point;
        let Some(slope) = Slope::new(&point, spoke) else { break };
        let way = sides.continuation(spot, came, &slope);
        fn is_foot(step: [f64; 2], slope: &Slope, spoke: Vector3<f64>) -> bool {
            slope.length_sq(step) <= MIN_RELATIVE_STEP * MIN_RELATIVE_STEP * spoke.norm_squared()
        }
        // If the closest point is on a side, rounding errors may lead back to the side from both faces, as at a crease. The point does not
        // count as held if the unrestricted step would be negligible.
        held = matches!(way, Continuation::Along(_) | Continuation::Nowhere)
            && !is_foot(slope.step(), &slope, spoke);
        match way {
            Continuation::Nowhere => break,
            Continuation::Through(half) => {
                (spot, came) = (sides.enter_face(spot, half), half);
                part = surface.part(spot.part);
                (point, looks) = (part.evaluate(spot.at), looks + 1);
            }
            Continuation::Across(step) | Continuation::Along(step) => {
                if is_foot(step, &slope, spoke) {
                    break;
                }
                let end = sides.clip_step(spot.at, step);
                let cuts = (0..MAX_REDUCTIONS)
                    .scan(1.0, |fraction, _| Some(std::mem::replace(fraction, *fraction / 4.0)));
                let nearer = cuts.into_iter().find_map(|fraction| {
                    let at = match fraction {
                        1.0 => end,
                        _ => [0, 1].map(|k| spot.at[k] + (end[k] - spot.at[k]) * fraction),
                    };
                    let point = part.evaluate(at);
                    looks += 1;
                    let is_nearer = (to - point.point).norm_squared() < spoke.norm_squared();
                    is_nearer.then_some((FacePosition { at, ..spot }, point))
                });
                let Some(nearer) = nearer else { break };
                ((spot, point), came) = (nearer, NONE);
            }
        }
    }
    Nearest { spot, point, held }
}

/// The gradient and the second derivatives of the squared distance, as a function of the position on a face.
struct Slope {
    first: [Vector3<f64>; 2],
    falls: [f64; 2],
    curves: [f64; 3],
}

impl Slope {
    /// Computes the derivatives of the squared distance; `None` where the surface has no derivatives.
    fn new(point: &LimitPoint, spoke: Vector3<f64>) -> Option<Self> {
        let first @ [u, v] = point.first;
        let [uu, uv, vv] = point.second?.map(|second| second.dot(&spoke));
        let flat = [u.norm_squared(), u.dot(&v), v.norm_squared()];
        let curved = [flat[0] - uu, flat[1] - uv, flat[2] - vv];
        // If the second derivatives are not positive definite, use the second derivatives for a flat surface, which also give a descent
        // direction.
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

/// The next move of a walk.
enum Continuation {
    /// The walk takes a step, given by its change of the two coordinates, within the face.
    Across([f64; 2]),
    /// The walk takes a step, given by its change of the two coordinates, along a side that it cannot cross.
    Along([f64; 2]),
    /// The walk crosses a side into a neighboring face, given by the half-edge of that face at the side.
    Through(u32),
    Nowhere,
}

/// The sides of the faces. Side `k` runs from corner `k` to the next corner, and is half-edge `k` of its face.
struct Sides<'a, F> {
    mesh: &'a Connectivity,
    /// The number of sides of each face: 3 or 4.
    count: u32,
    may_enter: F,
}

impl<F: Fn(u32) -> bool> Sides<'_, F> {
    /// Returns the next move from a position. `came` is the half-edge through which the walk entered the face.
    fn continuation(&self, spot: FacePosition, came: u32, slope: &Slope) -> Continuation {
        let step = slope.step();
        let Some(side) = self.exit_sides(spot.at, step).next() else {
            return Continuation::Across(step);
        };
        if let Some(half) = self.entrance(spot, came, step) {
            return Continuation::Through(half);
        }
        let [from, to] = [0.0, 1.0].map(|fraction| self.point_on_side(side, fraction));
        let along = slope.step_along([to[0] - from[0], to[1] - from[1]]);
        match (self.entrance(spot, came, along), self.exit_sides(spot.at, along).next()) {
            (Some(half), _) => Continuation::Through(half),
            (None, Some(_)) => Continuation::Nowhere,
            (None, None) => Continuation::Along(along),
        }
    }

    /// Returns the half-edge of an allowed neighboring face through which a step enters that face; `None` if there is none. A step never
    /// leads back through `came`.
    fn entrance(&self, spot: FacePosition, came: u32, step: [f64; 2]) -> Option<u32> {
        self.exit_sides(spot.at, step)
            .map(|side| self.count * spot.part + side)
            .filter(|&half| half != came)
            .map(|half| self.mesh.twin(half))
            .find(|&twin| twin != NONE && (self.may_enter)(twin / self.count))
    }

    /// Returns the sides on which a position lies and which a step crosses outwards.
    fn exit_sides(&self, at: [f64; 2], step: [f64; 2]) -> impl Iterator<Item = u32> {
        (0..self.count).filter(move |side| {
            self.distance_to_side(*side, at) <= SIDE_TOLERANCE
                && self.approach_rate(*side, step) < 0.0
        })
    }

    /// The distance of a position from a side, in coordinates scaled to 1 at the opposite end of the face.
    fn distance_to_side(&self, side: u32, [u, v]: [f64; 2]) -> f64 {
        match (self.count, side) {
            (_, 0) => v,
            (3, 1) => 1.0 - u - v,
            (3, _) | (_, 3) => u,
            (_, 1) => 1.0 - u,
            _ => 1.0 - v,
        }
    }

    /// The change of `distance_to_side` caused by a step.
    fn approach_rate(&self, side: u32, [u, v]: [f64; 2]) -> f64 {
        match (self.count, side) {
            (_, 0) => v,
            (3, 1) => -(u + v),
            (3, _) | (_, 3) => u,
            (_, 1) => -u,
            _ => -v,
        }
    }

    /// Returns the position on a side at a fraction of the side's length.
    fn point_on_side(&self, side: u32, fraction: f64) -> [f64; 2] {
        let rest = 1.0 - fraction;
        match (self.count, side) {
            (_, 0) => [fraction, 0.0],
            (3, 1) => [rest, fraction],
            (3, _) | (_, 3) => [0.0, rest],
            (_, 1) => [1.0, fraction],
            _ => [rest, 1.0],
        }
    }

    /// Returns the fraction of a side's length at which a position on the side lies.
    fn side_fraction(&self, side: u32, [u, v]: [f64; 2]) -> f64 {
        let fraction = match (self.count, side) {
            (_, 0) => u,
            (_, 1) => v,
            (4, 2) => 1.0 - u,
            _ => 1.0 - v,
        };
        fraction.clamp(0.0, 1.0)
    }

    /// Returns the end of a step, or the first point where the step meets a side.
    fn clip_step(&self, at: [f64; 2], step: [f64; 2]) -> [f64; 2] {
        fn advance(fraction: f64, at: [f64; 2], step: [f64; 2]) -> [f64; 2] {
            [at[0] + step[0] * fraction, at[1] + step[1] * fraction]
        }
        let meets = (0..self.count).filter_map(|side| {
            let rate = self.approach_rate(side, step);
            let fraction = self.distance_to_side(side, at).max(0.0) / -rate;
            (rate < 0.0 && fraction < 1.0).then_some((fraction, side))
        });
        match meets.min_by(|a, b| a.0.total_cmp(&b.0)) {
            Some((fraction, side)) => {
                self.point_on_side(side, self.side_fraction(side, advance(fraction, at, step)))
            }
            None => advance(1.0, at, step),
        }
    }

    /// Converts a position on a side to a position on the face at the other side of `half`.
    fn enter_face(&self, spot: FacePosition, half: u32) -> FacePosition {
        let side = self.mesh.twin(half) % self.count;
        let fraction = 1.0 - self.side_fraction(side, spot.at);
        FacePosition {
            part: half / self.count,
            at: self.point_on_side(half % self.count, fraction),
        }
    }
}
