use maquette_node::Progress;
use maquette_value::{Faces, TriangleTree};
use nalgebra::{Point3, Vector3};

use super::super::shapes::{sphere, torus};
use super::super::simplify::simplify;
use super::concave_corners::cut_concave_corners;
use super::feet::LEVELS;
use super::folds::folds;
use super::net::{Move, Net, SHARP};
use super::*;
use crate::limit::composed::ComposedLimit;
use crate::refine::connectivity::Connectivity;
use crate::refine::half_edges::NONE;
use crate::sharp_edges::crease;

fn fit_mesh(mesh: &Mesh, points: &[Point3<f64>]) -> FittedSubdivision {
    fit_subdivision(mesh, points, 1e-3, 12, &Progress::silent()).unwrap()
}

#[test]
fn a_simplified_sphere_becomes_round_again() {
    let dense = sphere(4);
    let coarse = simplify(&dense, 256, &Progress::silent()).unwrap();
    let found = fit_mesh(&coarse, dense.positions());
    let surface =
        ComposedLimit::new(&found.mesh, 3).unwrap().surface(found.mesh.positions()).unwrap();
    let off = surface.positions().iter().map(|point| (point.coords.norm() - 1.0).abs());
    let off = off.fold(0.0, f64::max);
    assert!(off < 5e-3, "{off}");
    assert_eq!(found.left_out, 0);
    let steps = found.trace.steps();
    assert!(steps[steps.len() - 1].rms < steps[0].rms / 5.0, "{:?}", found.trace);
}

#[test]
fn points_of_a_subdivision_surface_give_its_control_mesh_back() {
    let control = sphere(1);
    let pulled =
        control.positions().iter().map(|p| Point3::new(p.x * 1.3, p.y, p.z + p.x * p.x * 0.2));
    let control = control.with_positions(pulled.collect()).unwrap();
    let surface = ComposedLimit::new(&control, 2).unwrap();
    let points = surface.surface(control.positions()).unwrap().positions().to_vec();
    let nudged = control.positions().iter().enumerate().map(|(k, p)| {
        let k = k as f64;
        p + Vector3::new(libm::sin(k), libm::sin(2.0 * k), libm::sin(3.0 * k)) * 0.01
    });
    let start = control.with_positions(nudged.collect()).unwrap();
    let found = fit_subdivision(&start, &points, 0.0, 100, &Progress::silent()).unwrap();
    let last = found.trace.steps().last().unwrap();
    assert!(last.rms < 2e-4, "{last:?}");
}

#[test]
fn distant_points_are_ignored_and_no_near_points_are_an_error() {
    let coarse = sphere(1);
    let mut points = sphere(3).positions().to_vec();
    points.push(Point3::new(30.0, 0.0, 0.0));
    assert_eq!(fit_mesh(&coarse, &points).left_out, 1);
    let far = fit_subdivision(&coarse, &points[points.len() - 1..], 1e-3, 6, &Progress::silent());
    let apart = far.unwrap_err().to_string();
    assert!(apart.starts_with("none of the 1 points is within "), "{apart}");
}

/// Creates a cube with edges of length 2. Each side of the cube is divided into `n` by `n` squares of two triangles.
fn divided_cube(n: usize) -> Mesh {
    fn coordinate(k: usize, n: usize) -> f64 {
        2.0 * k as f64 / n as f64 - 1.0
    }
    let mut points: Vec<Point3<f64>> = Vec::new();
    let mut faces = Vec::new();
    for (axis, side) in [0, 1, 2].into_iter().flat_map(|axis| [(axis, -1.0), (axis, 1.0)]) {
        let mut vertex = |i: usize, j: usize| {
            let mut point = Point3::origin();
            (point[axis], point[(axis + 1) % 3], point[(axis + 2) % 3]) =
                (side, coordinate(i, n), coordinate(j, n));
            let known = points.iter().position(|other| (other - point).norm() < 1e-9);
            known.unwrap_or_else(|| {
                points.push(point);
                points.len() - 1
            }) as u32
        };
        for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
            let mut square =
                [vertex(i, j), vertex(i + 1, j), vertex(i + 1, j + 1), vertex(i, j + 1)];
            if side < 0.0 {
                square.reverse();
            }
            let [a, b, c, d] = square;
            faces.extend([[a, b, c], [a, c, d]]);
        }
    }
    Mesh::new(points, Faces::triangles(faces)).unwrap()
}

fn fit_from(start: &Mesh, scan: &Mesh, passes: u32) -> FittedSubdivision {
    let prices = Prices { passes, ..Prices::default() };
    fit_by_moves(start, scan, 1e-3, 6, prices, &Progress::silent()).unwrap()
}

/// Returns the maximum distance of a control mesh's limit surface from a scan.
fn farthest(control: &Mesh, scan: &Mesh) -> f64 {
    let fine = ComposedLimit::new(control, 4).unwrap().surface(control.positions()).unwrap();
    let positions = TriangleTree::new(scan).nearest_to_all(fine.positions()).into_iter().flatten();
    libm::sqrt(positions.map(|position| position.distance_sq).fold(0.0, f64::max))
}

fn rms(fitted: &FittedSubdivision) -> f64 {
    fitted.trace.steps().last().unwrap().rms
}

#[test]
fn energy_finds_the_edges_of_a_cube() {
    let scan = divided_cube(12);
    let start = divided_cube(3);
    let smooth = fit_mesh(&start, scan.positions());
    let found = fit_from(&start, &scan, 4);
    assert!(rms(&found) < rms(&smooth) / 20.0, "{} {}", rms(&found), rms(&smooth));
    let beyond = farthest(&found.mesh, &scan);
    assert!(beyond < 0.02, "{beyond}");
    // The end of a sharp edge is on an edge of the cube if two of its coordinates are about 1 in absolute value.
    fn on_edge(vertex: u32, found_mesh: &Mesh) -> bool {
        let position = found_mesh.positions()[vertex as usize];
        position.iter().filter(|x| 0.9 < x.abs()).count() >= 2
    }
    let along = found
        .mesh
        .creases()
        .filter(|([a, b], _)| on_edge(*a, &found.mesh) && on_edge(*b, &found.mesh))
        .count();
    assert_eq!(along, found.mesh.creases().len());
    assert!(12 <= along, "{along}");
}

#[test]
fn creases_of_a_sphere_are_removed() {
    let dense = sphere(4);
    let coarse = simplify(&dense, 256, &Progress::silent()).unwrap();
    let creased = crease(&coarse, 15.0, 10.0);
    let found = fit_from(&creased, &dense, 2);
    let [before, after] = [&creased, &found.mesh].map(|mesh| mesh.creases().len());
    assert!(20 < before && 2 * after < before, "{before} {after}");
    assert!(rms(&found) < rms(&fit_mesh(&creased, dense.positions())));
}

/// Creates the corner of a pit in a flat face. Two vertical walls go down from the positive x and y axes. The flat face covers the other
/// three quarters of the plane and is divided by one smooth edge.
fn corner_of_a_pit() -> Mesh {
    let [out, deep] = [8.0, 4.0];
    let positions =
        [[0.0, 0.0, 0.0], [deep, 0.0, 0.0], [0.0, 0.0, -deep], [0.0, deep, 0.0], [-out, -out, 0.0]];
    let faces = [[0, 3, 4], [0, 4, 1], [0, 1, 2], [0, 2, 3]];
    let mesh = Mesh::new(positions.map(Point3::from).to_vec(), Faces::triangles(faces.to_vec()));
    mesh.unwrap().with_creases([1, 2, 3].map(|end| ([0, end], SHARP))).unwrap()
}

#[test]
fn a_flat_face_around_the_corner_of_a_pit_does_not_extend_into_the_pit() {
    let start = corner_of_a_pit();
    fn reach(mesh: &Mesh) -> f64 {
        let fine = ComposedLimit::new(mesh, 5).unwrap().surface(mesh.positions()).unwrap();
        let flat = fine.positions().iter().filter(|p| p.z.abs() < 1e-9);
        flat.map(|p| p.x.min(p.y)).fold(0.0, f64::max)
    }
    let (cut, has_cut) = cut_concave_corners(&start).unwrap();
    assert!(has_cut && 0.03 < reach(&start), "{}", reach(&start));
    assert!(reach(&cut) < 1e-9, "{}", reach(&cut));
    assert_eq!(cut.creases().count(), 4);
    assert!(!cut_concave_corners(&cut).unwrap().1);
}

#[test]
fn corners_without_folds_are_not_divided() {
    let cube = crease(&divided_cube(2), 50.0, SHARP);
    assert_eq!(cut_concave_corners(&cube).unwrap(), (cube, false));
}

#[test]
fn moves_need_a_scan_with_faces() {
    let points = Mesh::new(sphere(2).positions().clone(), Faces::triangles(Vec::new())).unwrap();
    let found = fit_by_moves(&sphere(0), &points, 1e-3, 6, Prices::default(), &Progress::silent());
    assert_eq!(found.unwrap_err().to_string(), NO_SURFACE);
}

#[test]
fn moves_do_not_depend_on_the_number_of_threads() {
    let scan = divided_cube(8);
    let start = divided_cube(4);
    fn with_threads(threads: usize, start: &Mesh, scan: &Mesh) -> FittedSubdivision {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| fit_from(start, scan, 1))
    }
    assert_eq!(with_threads(1, &start, &scan), with_threads(3, &start, &scan));
}

/// Returns the Euler characteristic, and true if the mesh has a border.
fn kind(mesh: &Mesh) -> (i32, bool) {
    let surface = Connectivity::new(mesh.faces(), mesh.positions().len()).expect("a surface").0;
    let border = surface.halves.iter().any(|halves| halves[1] == NONE);
    let parts = mesh.positions().len() + mesh.faces().len();
    (parts as i32 - surface.halves.len() as i32, border)
}

#[test]
fn moves_preserve_the_topology() {
    let open = divided_cube(3);
    let faces = open.faces().as_triangles().unwrap()[18..].to_vec();
    let net = Net::new(&open);
    let (open, _) = net.part(faces.into_iter(), |v| net.positions[v as usize]).unwrap();
    for start in [torus(6, 5, true), sphere(1), divided_cube(2), open] {
        let start = crease(&start, 50.0, 10.0);
        let mut net = Net::new(&start);
        let mut random = 1_u64;
        for _ in 0..2000 {
            random = random.wrapping_mul(0xd134_2543_de82_ef95).wrapping_add(1);
            let edges = net.edges(0..net.faces.len() as u32);
            let edge = edges[(random >> 33) as usize % edges.len()];
            let made = Move::ALL[(random >> 20) as usize % 4];
            let is_large = edges.len() > 400 && made == Move::Split;
            if let Some(change) = net.change(made, edge).filter(|_| !is_large) {
                let new = net.positions.len() as u32;
                net.apply(&change, new);
                assert_eq!(kind(&net.mesh().unwrap().0), kind(&start), "{made:?} at {edge:?}");
            }
        }
    }
}

/// A plate or nut with `corners` corners, with a hole if `hole` is greater than 0, cut into small triangles. All edges of the coarse mesh
/// are sharp, so that it is refined linearly.
fn flat_thing(corners: u32, hole: f64, thickness: f64, levels: u32) -> Mesh {
    fn angle(k: u32, corners: u32) -> f64 {
        std::f64::consts::TAU * f64::from(k) / f64::from(corners)
    }
    let ring = |radius: f64, height: f64| {
        (0..corners).map(move |k| {
            Point3::new(
                radius * libm::cos(angle(k, corners)),
                radius * libm::sin(angle(k, corners)),
                height,
            )
        })
    };
    let mut points: Vec<_> = ring(10.0, 0.0).chain(ring(10.0, thickness)).collect();
    let mut quads = Vec::new();
    fn next(k: u32, corners: u32) -> u32 {
        (k + 1) % corners
    }
    quads.extend(
        (0..corners).map(|k| [k, next(k, corners), corners + next(k, corners), corners + k]),
    );
    let mut faces: Vec<[u32; 3]> = Vec::new();
    if hole > 0.0 {
        points.extend(ring(hole, 0.0).chain(ring(hole, thickness)));
        let [low, high] = [2 * corners, 3 * corners];
        quads.extend(
            (0..corners)
                .map(|k| [low + next(k, corners), low + k, high + k, high + next(k, corners)]),
        );
        quads.extend((0..corners).map(|k| [next(k, corners), k, low + k, low + next(k, corners)]));
        quads.extend(
            (0..corners).map(|k| {
                [corners + k, corners + next(k, corners), high + next(k, corners), high + k]
            }),
        );
    } else {
        points.extend([Point3::origin(), Point3::new(0.0, 0.0, thickness)]);
        faces.extend((0..corners).map(|k| [2 * corners, next(k, corners), k]));
        faces.extend(
            (0..corners).map(|k| [2 * corners + 1, corners + k, corners + next(k, corners)]),
        );
    }
    faces.extend(quads.into_iter().flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]));
    let mesh = Mesh::new(points, Faces::triangles(faces)).unwrap();
    let sharp: Vec<_> = mesh.edges().vertices.iter().map(|ends| (*ends, 20.0)).collect();
    let options = crate::Subdivision {
        scheme: crate::Scheme::Loop,
        levels,
        limit: false,
        boundary: crate::Boundary::EdgeAndCorner,
        creases: crate::Creases::OpenSubdiv,
        corners: crate::Corners::Linear,
    };
    let fine = crate::subdivide(&mesh.with_creases(sharp).unwrap(), options).unwrap();
    fine.with_creases(Vec::new()).unwrap()
}

/// `Simplify` leaves long thin triangles on flat faces, whose control points no distance determines. The surface does not run through
/// itself, and has no more folds than that of the start.
fn check_flat_things(members: std::ops::Range<u32>) {
    let mut crossings = Vec::new();
    for member in members {
        let corners = 4 + member % 7;
        let hole = [0.0, 3.0, 6.0][(member / 2) as usize % 3];
        let thickness = [1.5, 3.0, 8.0][member as usize % 3];
        let dense = flat_thing(corners, hole, thickness, 3);
        let coarse =
            simplify(&dense, 60 + 20 * (member as usize % 8), &Progress::silent()).unwrap();
        let found =
            fit_subdivision(&coarse, dense.positions(), 1e-3, 6, &Progress::silent()).unwrap();
        let limit = ComposedLimit::new(&found.mesh, LEVELS).unwrap();
        let surface = limit.surface(found.mesh.positions()).unwrap();
        let before = limit.surface(coarse.positions()).unwrap();
        let [before, after] = [&before, &surface].map(|it| folds(it, LEVELS).len());
        let pairs = surface.crossings(|| Ok::<_, std::convert::Infallible>(())).unwrap();
        if !pairs.is_empty() || before < after {
            crossings.push((member, coarse.faces().len(), pairs.len(), before, after));
        }
    }
    assert_eq!(crossings, []);
}

#[test]
fn simplified_flat_things_do_not_crumple() {
    check_flat_things(0..12);
}

#[test]
fn smooth_things_are_met_without_folds() {
    for seed in 0..4 {
        let mut random = maquette_value::rng::Random(seed);
        let waves: Vec<Vector3<f64>> =
            (0..4).map(|_| Vector3::from_fn(|_, _| 8.0 * random.even() - 4.0)).collect();
        let ball = sphere(4);
        let bumpy = ball.positions().iter().map(|at| {
            let height: f64 = waves.iter().map(|wave| libm::sin(wave.dot(&at.coords))).sum();
            at * (1.0 + 0.08 * height)
        });
        let dense = ball.with_positions(bumpy.collect()).unwrap();
        let coarse = simplify(&dense, 256, &Progress::silent()).unwrap();
        let found = fit_subdivision(&coarse, dense.positions(), 1e-3, 6, &Progress::silent());
        let found = found.unwrap();
        let last = *found.trace.steps().last().unwrap();
        assert!(found.folds.is_empty(), "{seed}: {:?}", found.folds);
        assert!(last.max < 0.015 && last.rms < 0.003, "{seed}: {last:?}");
    }
}
