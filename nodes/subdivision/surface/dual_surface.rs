//! The limit surface of Doo's and Sabin's scheme at any place, not only at vertices.
//!
//! After one step four faces meet at each vertex. Between their middles, which are limit points that no step moves, the surface has a
//! patch: a part of a corner of the control mesh, which runs from the control point's limit at `(0, 0)` to the middle of the face at
//! `(1, 1)`. Where the four faces are quads it is a biquadratic B-spline; else it is refined, with nothing but these faces, until the
//! place is in such a patch.

use std::borrow::Cow;

use maquette_value::parallel::*;
use nalgebra::{Point3, Vector3};

use super::face_point::{FacePoint, QUAD};
use super::limit_point::LimitPoint;
use super::patches::{Jet, tensor};
use crate::masks::turns::turns;
use crate::refine::connectivity::Connectivity;
use crate::refine::doo_sabin::Inside;
use crate::refine::half_edges::{HalfEdges, NONE};

/// So many steps bring a place as near to a corner as its coordinates can tell.
const DEEPEST: usize = 40;

/// What lies around a vertex amid four faces: their corners counter-clockwise from it on, face by face. The middle of face `k` is
/// corner `k` of the part.
struct Net {
    points: Vec<Vector3<f64>>,
    /// Where each face ends.
    ends: [usize; 4],
}

/// A vertex amid four quads, `[i][j]` with `i` along `u`.
type Quads = [[Vector3<f64>; 3]; 3];

/// A part of the surface, with what refinement made of it where places of it were asked for.
pub(crate) struct DualPart {
    /// What lies around the vertex amid the part after each step; before that the corner at which it lies in the part before.
    steps: Vec<(usize, Net)>,
}

impl DualPart {
    /// The part at the start of `half`, whose vertex has faces all around; `refined` is where one step puts each corner.
    pub(crate) fn at_corner(mesh: &Connectivity, refined: &[Vector3<f64>], half: u32) -> Self {
        Self { steps: vec![(0, around(mesh, refined, half))] }
    }

    /// The point at a place of the part.
    pub(crate) fn at(&mut self, mut place: FacePoint) -> LimitPoint {
        let mut step = 0;
        while step < DEEPEST {
            let net = &self.steps[step].1;
            if let Some(quads) = net.quads() {
                return place.point(biquadratic(&quads, place.at));
            }
            if place.is_corner(QUAD).is_some() {
                break;
            }
            step += 1;
            let corner = place.halve_quad();
            if self.steps.get(step).is_none_or(|(last, _)| *last != corner) {
                let child = net.child(corner);
                self.steps.truncate(step);
                self.steps.push((corner, child));
            }
        }
        middle(self.steps[step].1.face(place.nearest_corner(QUAD)))
    }
}

/// Where one step puts each corner.
pub(crate) fn refined(mesh: &Connectivity, control: &[Point3<f64>]) -> Vec<Vector3<f64>> {
    let inside = Inside::new(mesh, control);
    let halves = (0..mesh.corners().len() as u32).into_par_iter().with_min_len(4096);
    halves.map(|half| inside.at(half)).collect()
}

fn around(mesh: &Connectivity, refined: &[Vector3<f64>], half: u32) -> Net {
    let at = |half: u32| refined[half as usize];
    let (next, before) = (mesh.next(half), mesh.previous(half));
    let (right, left) = (mesh.twin(half), mesh.twin(before));
    let walk = |to: fn(&Connectivity, u32) -> u32| {
        let others =
            std::iter::successors(Some(to(mesh, half)), move |&other| Some(to(mesh, other)));
        let others = others.take_while(move |&other| other != half && other != NONE);
        std::iter::once(half).chain(others).map(at)
    };
    Net::new(
        walk(|mesh, half| mesh.twin(mesh.previous(half))),
        [half, mesh.next(right), right, next].map(at),
        walk(|mesh, half| mesh.next(half)),
        [half, before, mesh.next(left), left].map(at),
    )
}

impl Net {
    /// That of four faces, of which two at least are quads.
    fn new(
        lower: impl Iterator<Item = Vector3<f64>>,
        right: [Vector3<f64>; 4],
        upper: impl Iterator<Item = Vector3<f64>>,
        left: [Vector3<f64>; 4],
    ) -> Self {
        let mut points = Vec::with_capacity(16);
        points.extend(lower);
        let first = points.len();
        points.extend(right);
        points.extend(upper);
        let third = points.len();
        points.extend(left);
        Self { points, ends: [first, first + 4, third, third + 4] }
    }

    fn face(&self, k: usize) -> &[Vector3<f64>] {
        &self.points[if k == 0 { 0 } else { self.ends[k - 1] }..self.ends[k]]
    }

    fn quads(&self) -> Option<Quads> {
        (self.ends == [4, 8, 12, 16]).then(|| {
            let [lower, right, upper, left] = [0, 1, 2, 3].map(|k| self.face(k));
            [
                [lower[2], lower[1], left[2]],
                [lower[3], lower[0], upper[3]],
                [right[2], upper[1], upper[2]],
            ]
        })
    }

    /// What lies around the new vertex in face `k`; its part is the quarter at corner `k`.
    fn child(&self, k: usize) -> Self {
        let [own, after, across, before] =
            [0, 1, 2, 3].map(|j| FinerFace::new(self.face((k + j) % 4)));
        let vertex = own.at(0);
        Self::new(
            (0..own.old.len()).map(|j| own.at(j)),
            [vertex, own.at(own.old.len() - 1), after.at(1), after.at(0)],
            [vertex, after.at(0), across.at(0), before.at(0)].into_iter(),
            [vertex, before.at(0), before.at(before.old.len() - 1), own.at(1)],
        )
    }
}

/// The new vertices in a face.
struct FinerFace<'a> {
    old: &'a [Vector3<f64>],
    turns: Cow<'static, [[f64; 2]]>,
    /// The parts of the old corners that the new ones have in common: 3/4 of the centroid, and the sums with cosines and sines.
    common: [Vector3<f64>; 3],
}

impl<'a> FinerFace<'a> {
    fn new(old: &'a [Vector3<f64>]) -> Self {
        let turns = turns(old.len());
        let [center, a, b] = moments(old, &turns);
        Self { old, turns, common: [center * 0.75, a, b] }
    }

    /// The new vertex at a corner.
    fn at(&self, k: usize) -> Vector3<f64> {
        let ([center, a, b], [cosine, sine]) = (self.common, self.turns[k]);
        self.old[k] * 0.25 + center + (a * cosine + b * sine) * (0.5 / self.old.len() as f64)
    }
}

/// The centroid of a face, and the sums of its corners with cosines and sines.
fn moments(face: &[Vector3<f64>], turns: &[[f64; 2]]) -> [Vector3<f64>; 3] {
    let mut sums = [Vector3::zeros(); 3];
    for (point, [cosine, sine]) in face.iter().zip(turns) {
        sums[0] += point;
        sums[1] += point * *cosine;
        sums[2] += point * *sine;
    }
    sums[0] /= face.len() as f64;
    sums
}

/// The limit in the middle of a face.
fn middle(face: &[Vector3<f64>]) -> LimitPoint {
    let [center, a, b] = moments(face, &turns(face.len()));
    LimitPoint { point: center.into(), first: [a, b], second: None }
}

/// Values, first and second derivatives of the three quadratic B-splines over a unit interval.
fn quadratic(t: f64) -> [[f64; 3]; 3] {
    let r = 1.0 - t;
    [[r * r / 2.0, 0.5 + t * r, t * t / 2.0], [-r, r - t, t], [1.0, -2.0, 1.0]]
}

fn biquadratic(net: &Quads, [u, v]: [f64; 2]) -> Jet {
    tensor(|[i, j]| net[i][j], &quadratic(u), &quadratic(v))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::limit::dual_limit::DualLimit;
    use crate::shapes::{cube, noisy, prism, sphere, torus};
    use crate::{Boundary, Plan, Scheme, Subdivision};

    fn at_corner(
        mesh: &Connectivity,
        refined: &[Vector3<f64>],
        half: u32,
        [u, v]: [f64; 2],
    ) -> LimitPoint {
        DualPart::at_corner(mesh, refined, half).at(FacePoint::new(u, v))
    }

    #[test]
    fn limit_points_of_finer_meshes_lie_where_their_parameters_are() {
        for mesh in [cube(), prism(5), sphere(0), noisy(&torus(6, 5, false), 0.1)] {
            let (connectivity, starts) =
                Connectivity::new(mesh.faces(), mesh.positions().len()).unwrap();
            let corners = refined(&connectivity, mesh.positions());
            let (boundary, creases, corner_rule) = Default::default();
            let how = Subdivision {
                scheme: Scheme::DooSabin,
                levels: 1,
                limit: true,
                boundary,
                creases,
                corners: corner_rule,
            };
            let once = Plan::new(&mesh, how).unwrap().apply(&mesh).unwrap();
            let own = DualLimit::new(connectivity, starts, Boundary::default());
            let limits = own.positions(&own.all()).apply(mesh.positions());
            let connectivity = &own.mesh;
            for half in 0..connectivity.corners().len() as u32 {
                let at = |u, v| at_corner(connectivity, &corners, half, [u, v]);
                let vertex = connectivity.corners()[half as usize] as usize;
                assert!((at(0.0, 0.0).point - limits[vertex]).norm() <= 1e-14);
                // The limit of the refined vertex is the middle of the part.
                let middle = once.positions()[half as usize];
                assert!((at(0.5, 0.5).point - middle).norm() <= 1e-14);
                // Neighbors share their sides.
                let twin = connectivity.next(connectivity.twin(half));
                let across = at_corner(connectivity, &corners, twin, [0.0, 0.3]);
                assert!((at(0.3, 0.0).point - across.point).norm() <= 1e-12);
            }
        }
    }

    #[test]
    fn derivatives_are_those_of_small_differences() {
        let mesh = noisy(&prism(5), 0.1);
        let (connectivity, _) = Connectivity::new(mesh.faces(), mesh.positions().len()).unwrap();
        let corners = refined(&connectivity, mesh.positions());
        let h = 1e-5;
        for half in 0..connectivity.corners().len() as u32 {
            for [u, v] in [[0.3, 0.2], [0.1, 0.77], [0.9, 0.6], [0.03, 0.02]] {
                let at = |u, v| at_corner(&connectivity, &corners, half, [u, v]);
                let [right, left, up, down] =
                    [at(u + h, v), at(u - h, v), at(u, v + h), at(u, v - h)];
                let own = at(u, v);
                fn by(a: LimitPoint, b: LimitPoint, h: f64) -> Vector3<f64> {
                    (a.point - b.point) / (2.0 * h)
                }
                assert!((own.first[0] - by(right, left, h)).norm() <= 1e-8);
                assert!((own.first[1] - by(up, down, h)).norm() <= 1e-8);
                let by =
                    |a: LimitPoint, b: LimitPoint, k: usize| (a.first[k] - b.first[k]) / (2.0 * h);
                let second = own.second.unwrap();
                assert!((second[0] - by(right, left, 0)).norm() <= 1e-7);
                assert!((second[1] - by(right, left, 1)).norm() <= 1e-7);
                assert!((second[2] - by(up, down, 1)).norm() <= 1e-7);
            }
        }
    }
}
