//! The limit surface of Doo's and Sabin's scheme at any place, not only at vertices.
//!
//! After one step four faces meet at each vertex. Between their middles, which are limit points that no step moves, the surface has a
//! patch: a part of a corner of the control mesh, which runs from the control point's limit at `(0, 0)` to the middle of the face at
//! `(1, 1)`. Where the four faces are quads it is a biquadratic B-spline; else it is refined, with nothing but these faces, until the
//! place is in such a patch.

use maquette::parallel::*;
use nalgebra::{Point3, Vector3};

use super::face_point::{FacePoint, QUAD};
use super::limit_point::LimitPoint;
use super::patches::Jet;
use crate::masks::turns::turn;
use crate::refine::connectivity::{Connectivity, NONE};
use crate::refine::doo_sabin::Inside;

/// So many steps bring a place as near to a corner as its coordinates can tell.
const DEEPEST: usize = 40;

/// What lies around a vertex amid four faces: their corners counter-clockwise from it on. The middle of face `k` is corner `k` of the
/// part.
type Net = [Vec<Vector3<f64>>; 4];

/// A vertex amid four quads, `[i][j]` with `i` along `u`.
type Quads = [[Vector3<f64>; 3]; 3];

/// The point of a part at the start of `half`, whose vertex has faces all around; `refined` is where one step puts each corner.
pub(crate) fn at_corner(
    mesh: &Connectivity,
    refined: &[Vector3<f64>],
    half: u32,
    at: [f64; 2],
) -> LimitPoint {
    let mut place = FacePoint::new(at[0], at[1]);
    let mut net = around(mesh, refined, half);
    for _ in 0..DEEPEST {
        if let Some(quads) = quads(&net) {
            return place.point(biquadratic(&quads, place.at));
        }
        if place.is_corner(QUAD).is_some() {
            break;
        }
        let corner = place.halve_quad();
        net = child(&net, corner);
    }
    middle(&net[place.nearest_corner(QUAD)])
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
    let walk = |to: &dyn Fn(u32) -> u32| {
        let others = std::iter::successors(Some(to(half)), |&other| Some(to(other)));
        let others = others.take_while(|&other| other != half && other != NONE);
        std::iter::once(half).chain(others).map(at).collect()
    };
    [
        walk(&|half| mesh.twin(mesh.previous(half))),
        [half, mesh.next(right), right, next].map(at).to_vec(),
        walk(&|half| mesh.next(half)),
        [half, before, mesh.next(left), left].map(at).to_vec(),
    ]
}

/// What lies around the new vertex in face `k`; its part is the quarter at corner `k`.
fn child(net: &Net, k: usize) -> Net {
    let fine = [0, 1, 2, 3].map(|j| finer_face(&net[(k + j) % 4]));
    let [own, after, across, before] = &fine;
    let last = |face: &[Vector3<f64>]| face[face.len() - 1];
    [
        own.clone(),
        vec![own[0], last(own), after[1], after[0]],
        vec![own[0], after[0], across[0], before[0]],
        vec![own[0], before[0], last(before), own[1]],
    ]
}

/// The new vertices in a face.
fn finer_face(face: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    let [center, a, b] = moments(face);
    let m = face.len();
    let new = |(k, own): (usize, &Vector3<f64>)| {
        let [cosine, sine] = turn(k, m);
        own * 0.25 + center * 0.75 + (a * cosine + b * sine) * (0.5 / m as f64)
    };
    face.iter().enumerate().map(new).collect()
}

/// The centroid of a face, and the sums of its corners with cosines and sines.
fn moments(face: &[Vector3<f64>]) -> [Vector3<f64>; 3] {
    let (mut sums, m) = ([Vector3::zeros(); 3], face.len());
    for (j, point) in face.iter().enumerate() {
        let [cosine, sine] = turn(j, m);
        sums[0] += point;
        sums[1] += point * cosine;
        sums[2] += point * sine;
    }
    sums[0] /= m as f64;
    sums
}

/// The limit in the middle of a face.
fn middle(face: &[Vector3<f64>]) -> LimitPoint {
    let [center, a, b] = moments(face);
    LimitPoint { point: center.into(), first: [a, b], second: None }
}

fn quads(net: &Net) -> Option<Quads> {
    let [lower, right, upper, left] = net;
    let is_regular = net.iter().all(|face| face.len() == 4);
    is_regular.then(|| {
        [
            [lower[2], lower[1], left[2]],
            [lower[3], lower[0], upper[3]],
            [right[2], upper[1], upper[2]],
        ]
    })
}

/// Values, first and second derivatives of the three quadratic B-splines over a unit interval.
fn quadratic(t: f64) -> [[f64; 3]; 3] {
    let r = 1.0 - t;
    [[r * r / 2.0, 0.5 + t * r, t * t / 2.0], [-r, r - t, t], [1.0, -2.0, 1.0]]
}

fn biquadratic(net: &Quads, [u, v]: [f64; 2]) -> Jet {
    let (along_u, along_v) = (quadratic(u), quadratic(v));
    [[0, 0], [1, 0], [0, 1], [2, 0], [1, 1], [0, 2]].map(|[k, l]| {
        let mut sum = Vector3::zeros();
        for (row, weight) in net.iter().zip(along_u[k]) {
            for (point, other) in row.iter().zip(along_v[l]) {
                sum += point * (weight * other);
            }
        }
        sum
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::limit::dual_limit::DualLimit;
    use crate::shapes::{cube, noisy, prism, sphere, torus};
    use crate::{Boundary, Plan, Scheme, Subdivision};

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
                let by = |a: LimitPoint, b: LimitPoint| (a.point - b.point) / (2.0 * h);
                assert!((own.first[0] - by(right, left)).norm() <= 1e-8);
                assert!((own.first[1] - by(up, down)).norm() <= 1e-8);
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
