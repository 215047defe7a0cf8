//! Tests of the evaluation of limit surfaces.

use nalgebra::Vector3;

use super::super::*;
use super::scheme_options;
use super::shapes::*;
use crate::surface::face_point::FacePoint;
use crate::surface::limit_point::LimitPoint;
use crate::surface::limit_surface::LimitSurface;
use crate::{Boundary, Scheme};

fn surface(mesh: &Mesh, scheme: Scheme) -> LimitSurface {
    LimitSurface::new(mesh, scheme_options(scheme, 0, true, Boundary::EdgeAndCorner)).unwrap()
}

fn families(scheme: Scheme) -> Vec<Mesh> {
    let triangles =
        [tetrahedron(), icosahedron(), bipyramid(5), rosette(7, 3), fan(5, 3), fan(1, 3)];
    let polygons =
        [cube_faces(), trapezohedron(5), prism(5), sheet(3, 3, false), patchwork(), fan(1, 4)];
    let all = if scheme == Scheme::Loop { triangles } else { polygons };
    all.into_iter()
        .map(scattered_polygons)
        .flat_map(|mesh| {
            let edges = mesh.edges().vertices;
            let creases: Vec<_> =
                edges.into_iter().step_by(3).zip([10.0, 1.5, 10.0, 0.5]).collect();
            [mesh.clone(), mesh.with_creases(creases).unwrap()]
        })
        .collect()
}

/// Returns positions in the faces of the control mesh, each with the vertex of the refined mesh at this position.
fn positions(mesh: &Mesh, scheme: Scheme) -> Vec<(usize, [f64; 2], u32)> {
    let how = scheme_options(scheme, 1, false, Boundary::EdgeAndCorner);
    let refined = subdivide(mesh, how).unwrap();
    let mut positions = Vec::new();
    for (face, corners) in mesh.faces().iter().enumerate() {
        let first = mesh.faces().first_corner(face);
        let at: &[(usize, usize, [f64; 2])] = match (scheme, corners.len()) {
            (Scheme::Loop, _) => &[
                (0, 0, [0., 0.]),
                (0, 1, [0.5, 0.]),
                (0, 2, [0., 0.5]),
                (1, 0, [1., 0.]),
                (1, 1, [0.5, 0.5]),
            ],
            (_, 4) => &[
                (0, 0, [0., 0.]),
                (0, 1, [0.5, 0.]),
                (0, 2, [0.5, 0.5]),
                (2, 0, [1., 1.]),
                (3, 1, [0., 0.5]),
            ],
            _ => &[(0, 0, [0., 0.]), (2, 0, [2., 0.]), (1, 3, [1., 1.])],
        };
        for &(part, corner, position) in at {
            let finer = if scheme == Scheme::Loop { 4 * face + part } else { first + part };
            positions.push((face, position, refined.faces().face(finer)[corner]));
        }
    }
    positions
}

#[test]
fn at_vertices_and_middles_the_surface_is_where_the_masks_say() {
    for scheme in [Scheme::CatmullClark, Scheme::Loop] {
        for mesh in families(scheme) {
            if mesh.creases().any(|(_, sharpness)| sharpness < 10.0) {
                continue;
            }
            let surface = surface(&mesh, scheme);
            let how = scheme_options(scheme, 1, true, Boundary::EdgeAndCorner);
            let limit = subdivide(&mesh, how).unwrap();
            for (face, [u, v], vertex) in positions(&mesh, scheme) {
                let point = surface.evaluate(face, u, v).point;
                let error = (point - limit.positions()[vertex as usize]).norm();
                assert!(error < 1e-13, "{scheme:?} {face} {u} {v} {error} {:?}", mesh.faces());
            }
        }
    }
}

#[test]
fn a_regular_patch_is_a_b_spline_with_its_derivatives() {
    // The limit surface keeps x and y. If the heights of the control mesh are a quadratic polynomial of x and y, then the limit surface has
    // the heights of the same polynomial plus a constant.
    let mesh = lattice(5, |x, y| 0.5 * x * x - x * y + 0.25 * y * y + x);
    let surface = surface(&mesh, Scheme::CatmullClark);
    for k in 0..50 {
        let [u, v] = [f64::from(k % 7) / 6.0, f64::from(k % 5) / 4.0];
        // Face 12 is the square with its lowest corner at (2, 2), with its corners counter-clockwise as seen from above.
        let point = surface.evaluate(12, u, v);
        let [x, y] = [2.0 + u, 2.0 + v];
        let height = 0.5 * x * x - x * y + 0.25 * y * y + x + (1.0 + 0.5) / 6.0;
        assert!((point.point.coords - Vector3::new(x, y, height)).norm() < 1e-13);
        assert!((point.first[0] - Vector3::new(1.0, 0.0, x - y + 1.0)).norm() < 1e-13);
        assert!((point.first[1] - Vector3::new(0.0, 1.0, 0.5 * y - x)).norm() < 1e-13);
        let second = point.second.unwrap();
        for (second, expected) in second.into_iter().zip([1.0, -1.0, 0.5]) {
            assert!((second - Vector3::new(0.0, 0.0, expected)).norm() < 1e-12, "{second}");
        }
    }
}

#[test]
fn derivatives_equal_difference_quotients_and_neighboring_faces_match() {
    const STEP: f64 = 1e-5;
    for scheme in [Scheme::CatmullClark, Scheme::Loop] {
        for mesh in families(scheme) {
            let surface = surface(&mesh, scheme);
            for face in 0..mesh.faces().len() {
                for [u, v] in [[0.3, 0.4], [0.07, 0.61], [0.45, 0.02], [0.6, 0.3]] {
                    let at = |u: f64, v: f64| surface.evaluate(face, u, v);
                    let here = at(u, v);
                    let [right, left, up, down] =
                        [at(u + STEP, v), at(u - STEP, v), at(u, v + STEP), at(u, v - STEP)];
                    fn slope(a: &LimitPoint, b: &LimitPoint) -> Vector3<f64> {
                        (a.point - b.point) / (2.0 * STEP)
                    }
                    let error = (slope(&right, &left) - here.first[0]).norm();
                    assert!(error < 1e-6, "{scheme:?} {face} {u} {v} {error}");
                    assert!((slope(&up, &down) - here.first[1]).norm() < 1e-6);
                    fn bend(a: &LimitPoint, b: &LimitPoint, k: usize) -> Vector3<f64> {
                        (a.first[k] - b.first[k]) / (2.0 * STEP)
                    }
                    let [uu, uv, vv] = here.second.unwrap();
                    let scale = 1.0 + uu.norm().max(vv.norm()).max(uv.norm());
                    assert!((bend(&right, &left, 0) - uu).norm() < 1e-3 * scale);
                    assert!((bend(&up, &down, 0) - uv).norm() < 1e-3 * scale);
                    assert!((bend(&up, &down, 1) - vv).norm() < 1e-3 * scale);
                }
            }
        }
    }
}

#[test]
fn fixed_neighborhoods_and_pieces_give_equal_points() {
    let triangles = [rosette(3, 3), rosette(5, 3), rosette(6, 3), rosette(9, 3), icosahedron()];
    let polygons = [rosette(3, 4), rosette(4, 4), rosette(7, 4), prism(5), trapezohedron(7)];
    for (scheme, meshes) in [(Scheme::Loop, triangles), (Scheme::CatmullClark, polygons)] {
        for mesh in meshes.into_iter().map(scattered_polygons) {
            let surface = surface(&mesh, scheme);
            let parts = match scheme {
                Scheme::Loop => 4 * mesh.faces().len(),
                _ => mesh.faces().corners().len(),
            };
            for part in 0..parts as u32 {
                for [u, v] in
                    [[0.3, 0.45], [0.01, 0.02], [0.001, 0.3], [0.7, 0.2], [0.1, 0.85], [0.5, 0.49]]
                {
                    let [fast, slow] =
                        [LimitSurface::evaluate_part, LimitSurface::evaluate_by_pieces]
                            .map(|at| at(&surface, part, FacePoint::new(u, v)));
                    assert!((fast.point - slow.point).norm() < 1e-14, "{scheme:?} {part} {u} {v}");
                    for k in 0..2 {
                        let error = (fast.first[k] - slow.first[k]).norm();
                        assert!(error < 1e-12, "{scheme:?} {part} {u} {v} {error}");
                    }
                    for (fast, slow) in fast.second.unwrap().into_iter().zip(slow.second.unwrap()) {
                        assert!(
                            (fast - slow).norm() < 1e-11 * (1.0 + slow.norm()),
                            "{fast} {slow}"
                        );
                    }
                }
            }
        }
    }
}

#[test]
fn a_surface_moves_with_its_control_points() {
    let mesh = scattered_polygons(cube_faces());
    let doubled = mesh.positions().iter().map(|point| (point.coords * 2.0).into());
    let moved = mesh.with_positions(doubled.collect()).unwrap();
    let surface = surface(&mesh, Scheme::CatmullClark);
    let [other, new] = [
        surface.with_control_points(moved.positions()).unwrap(),
        self::surface(&moved, Scheme::CatmullClark),
    ];
    assert_ne!(surface.evaluate(2, 0.3, 0.7), new.evaluate(2, 0.3, 0.7));
    assert_eq!(other.evaluate(2, 0.3, 0.7), new.evaluate(2, 0.3, 0.7));
    let error = surface.with_control_points(&[]).err().unwrap();
    assert_eq!(error.to_string(), "the plan was made for a mesh with another topology");
}

#[test]
fn a_limit_surface_of_doo_and_sabin_is_an_error() {
    let error =
        LimitSurface::new(&cube(), scheme_options(Scheme::DooSabin, 0, true, Boundary::EdgeOnly));
    let no_patches = "the surface of Doo and Sabin has patches over vertices, not over faces";
    assert_eq!(error.err().unwrap().to_string(), no_patches);
}
