//! Evaluation of the limit surface of the Doo-Sabin scheme at any parameter, not only at vertices.
//!
//! After one step four faces meet at each vertex. The centers of these faces are limit points, and the surface between the four centers is
//! a patch. Each corner of the control mesh thus has a patch, called a part, from the limit of the control point at `(0, 0)` to the center
//! of the face at `(1, 1)`. If the four faces are quads, the part is a biquadratic B-spline; otherwise the faces are refined until the
//! evaluated position is in a part between four quads.

use std::borrow::Cow;

use maquette_value::parallel::*;
use nalgebra::{Point3, Vector3};

use super::face_point::{FacePoint, QUAD};
use super::limit_point::LimitPoint;
use super::patches::{Jet, tensor};
use crate::masks::roots_of_unity::roots_of_unity;
use crate::refine::connectivity::Connectivity;
use crate::refine::doo_sabin::FaceVertices;
use crate::refine::half_edges::{HalfEdges, NONE};

/// The maximum number of refinement steps. After so many halvings, floating-point numbers cannot distinguish positions near a corner.
const MAX_DEPTH: usize = 40;

/// The neighborhood of a vertex with four faces: the corners of the faces, counter-clockwise from the vertex on, face by face. The centers
/// of the faces are the corners of a part of the limit surface.
struct Net {
    points: Vec<Vector3<f64>>,
    /// For each of the four faces, the end of its corners in `points` (the index after its last corner).
    ends: [usize; 4],
}

/// The 3 by 3 control points around a vertex with four quads, `[i][j]` with `i` along `u`.
type Quads = [[Vector3<f64>; 3]; 3];

/// A part of the surface, with a cache of the refined neighborhoods for the evaluated positions.
pub(crate) struct DualPart {
    /// The neighborhood after each refinement step, together with the corner of the previous part at which the new part is.
    steps: Vec<(usize, Net)>,
}

impl DualPart {
    /// Creates the part of the limit surface at the corner where `half` starts. The vertex of this corner must not be on the border.
    /// `refined` has the new vertex of each corner after one step.
    pub(crate) fn at_corner(mesh: &Connectivity, refined: &[Vector3<f64>], half: u32) -> Self {
        Self { steps: vec![(0, collect_net(mesh, refined, half))] }
    }

    /// Evaluates this part of the limit surface at a position.
    pub(crate) fn evaluate(&mut self, mut position: FacePoint) -> LimitPoint {
        let mut step = 0;
        while step < MAX_DEPTH {
            let net = &self.steps[step].1;
            if let Some(quads) = net.quads() {
                return position.point(biquadratic(&quads, position.at));
            }
            if position.is_corner(QUAD).is_some() {
                break;
            }
            step += 1;
            let corner = position.halve_quad();
            if self.steps.get(step).is_none_or(|(last, _)| *last != corner) {
                let child = net.child(corner);
                self.steps.truncate(step);
                self.steps.push((corner, child));
            }
        }
        middle(self.steps[step].1.face(position.nearest_corner(QUAD)))
    }
}

/// Computes the new vertex of each face corner after one step.
pub(crate) fn refine_corners(mesh: &Connectivity, control: &[Point3<f64>]) -> Vec<Vector3<f64>> {
    let inside = FaceVertices::new(mesh, control);
    let halves = (0..mesh.corners().len() as u32).into_par_iter().with_min_len(4096);
    halves.map(|half| inside.vertex_at(half)).collect()
}

fn collect_net(mesh: &Connectivity, refined: &[Vector3<f64>], half: u32) -> Net {
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
    /// Creates the neighborhood of a vertex with four faces, at least two of which are quads.
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

    /// Computes the neighborhood of the new vertex in face `k`. The part at this vertex is the quarter at corner `k` of the old part.
    fn child(&self, k: usize) -> Self {
        let [own, after, across, before] =
            [0, 1, 2, 3].map(|j| RefinedFace::new(self.face((k + j) % 4)));
        let vertex = own.corner_vertex(0);
        Self::new(
            (0..own.old.len()).map(|j| own.corner_vertex(j)),
            [
                vertex,
                own.corner_vertex(own.old.len() - 1),
                after.corner_vertex(1),
                after.corner_vertex(0),
            ],
            [vertex, after.corner_vertex(0), across.corner_vertex(0), before.corner_vertex(0)]
                .into_iter(),
            [
                vertex,
                before.corner_vertex(0),
                before.corner_vertex(before.old.len() - 1),
                own.corner_vertex(1),
            ],
        )
    }
}

/// Computes the new vertices inside one face.
struct RefinedFace<'a> {
    old: &'a [Vector3<f64>],
    turns: Cow<'static, [[f64; 2]]>,
    /// The terms that all new vertices of the face share: 3/4 of the centroid, and the sums of the corners times cosines and of the corners
    /// times sines.
    common: [Vector3<f64>; 3],
}

impl<'a> RefinedFace<'a> {
    fn new(old: &'a [Vector3<f64>]) -> Self {
        let turns = roots_of_unity(old.len());
        let [center, a, b] = moments(old, &turns);
        Self { old, turns, common: [center * 0.75, a, b] }
    }

    /// Returns the new vertex at corner `k`.
    fn corner_vertex(&self, k: usize) -> Vector3<f64> {
        let ([center, a, b], [cosine, sine]) = (self.common, self.turns[k]);
        self.old[k] * 0.25 + center + (a * cosine + b * sine) * (0.5 / self.old.len() as f64)
    }
}

/// Returns the centroid of a face, the sum of its corners times cosines, and the sum of its corners times sines.
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

/// Evaluates the limit surface at the center of a face.
fn middle(face: &[Vector3<f64>]) -> LimitPoint {
    let [center, a, b] = moments(face, &roots_of_unity(face.len()));
    LimitPoint { point: center.into(), first: [a, b], second: None }
}

/// The values, first and second derivatives of the three quadratic B-splines over a unit interval.
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
    use crate::shapes::{add_noise, cube, prism, sphere, torus};
    use crate::{Boundary, Plan, Scheme, Subdivision};

    fn at_corner(
        mesh: &Connectivity,
        refined: &[Vector3<f64>],
        half: u32,
        [u, v]: [f64; 2],
    ) -> LimitPoint {
        DualPart::at_corner(mesh, refined, half).evaluate(FacePoint::new(u, v))
    }

    #[test]
    fn limit_points_of_finer_meshes_are_at_their_parameters() {
        for mesh in [cube(), prism(5), sphere(0), add_noise(&torus(6, 5, false), 0.1)] {
            let (connectivity, starts) =
                Connectivity::new(mesh.faces(), mesh.positions().len()).unwrap();
            let corners = refine_corners(&connectivity, mesh.positions());
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
            let limits = own.positions(&own.vertices()).apply(mesh.positions());
            let connectivity = &own.mesh;
            for half in 0..connectivity.corners().len() as u32 {
                let at = |u, v| at_corner(connectivity, &corners, half, [u, v]);
                let vertex = connectivity.corners()[half as usize] as usize;
                assert!((at(0.0, 0.0).point - limits[vertex]).norm() <= 1e-14);
                // The limit of the refined vertex is at the center of the part.
                let middle = once.positions()[half as usize];
                assert!((at(0.5, 0.5).point - middle).norm() <= 1e-14);
                // Neighboring parts have the same points on their common side.
                let twin = connectivity.next(connectivity.twin(half));
                let across = at_corner(connectivity, &corners, twin, [0.0, 0.3]);
                assert!((at(0.3, 0.0).point - across.point).norm() <= 1e-12);
            }
        }
    }

    #[test]
    fn derivatives_equal_difference_quotients() {
        let mesh = add_noise(&prism(5), 0.1);
        let (connectivity, _) = Connectivity::new(mesh.faces(), mesh.positions().len()).unwrap();
        let corners = refine_corners(&connectivity, mesh.positions());
        let h = 1e-5;
        for half in 0..connectivity.corners().len() as u32 {
            for [u, v] in [[0.3, 0.2], [0.1, 0.77], [0.9, 0.6], [0.03, 0.02]] {
                let at = |u, v| at_corner(&connectivity, &corners, half, [u, v]);
                let [right, left, up, down] =
                    [at(u + h, v), at(u - h, v), at(u, v + h), at(u, v - h)];
                let own = at(u, v);
                fn difference_quotient(a: LimitPoint, b: LimitPoint, h: f64) -> Vector3<f64> {
                    (a.point - b.point) / (2.0 * h)
                }
                assert!((own.first[0] - difference_quotient(right, left, h)).norm() <= 1e-8);
                assert!((own.first[1] - difference_quotient(up, down, h)).norm() <= 1e-8);
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
