use nalgebra::{DMatrix, Matrix3, SymmetricEigen, Vector3};

use super::super::shapes::{
    add_bumps, add_noise, cube, octahedron, prism, sphere, tetrahedron, torus,
};
use super::super::subdivide::subdivide;
use super::*;
use crate::refine::without_border::select_faces;
use crate::solve::interpolation::{Norm, Solver};

mod alternating;
mod fins;
mod given;
mod published;

const SCHEMES: [Scheme; 3] = [Scheme::Loop, Scheme::CatmullClark, Scheme::DooSabin];

fn refine_mesh(mesh: &Mesh, scheme: Scheme, levels: u32, limit: bool) -> Mesh {
    let (boundary, creases, corners) = Default::default();
    subdivide(mesh, Subdivision { scheme, levels, limit, boundary, creases, corners }).unwrap()
}

fn limits(mesh: &Mesh, scheme: Scheme) -> LimitPositions {
    let (levels, limit) = (0, false);
    let (boundary, creases, corners) = Default::default();
    let how = Subdivision { scheme, levels, limit, boundary, creases, corners };
    LimitPositions::new(&Topology::from_mesh(mesh, how)).unwrap()
}

fn options(solver: Solver, tolerance: f64) -> InterpolateOptions {
    let how = Interpolation { solver, tolerance, iterations: 1000, ..Interpolation::default() };
    InterpolateOptions { how, ..InterpolateOptions::default() }
}

fn interpolate_mesh(
    mesh: &Mesh,
    scheme: Scheme,
    options: &InterpolateOptions,
) -> InterpolationResult<Mesh> {
    interpolate(mesh, scheme, options, &[], &Progress::silent()).unwrap()
}

/// The largest distance between a given vertex and the limit point of the control point with the same index.
fn farthest(mesh: &Mesh, control: &Mesh, scheme: Scheme) -> f64 {
    let surface = limits(control, scheme).positions.apply(control.positions());
    let pairs = mesh.positions().iter().zip(&surface);
    pairs.map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
}

/// Returns the numbers of iterations after which the largest distance is at most 1e-3, 1e-6 and 1e-10 times the initial distance.
fn counts(mesh: &Mesh, scheme: Scheme, solver: Solver) -> [u64; 3] {
    let trace = interpolate_mesh(mesh, scheme, &options(solver, 1e-13)).trace;
    let first = trace.steps()[0].max;
    [1e-3, 1e-6, 1e-10].map(|share| {
        let step = trace.steps().iter().find(|step| step.max <= share * first);
        step.unwrap_or_else(|| panic!("{share}: {trace:?}")).iteration
    })
}

#[test]
fn solvers_need_the_reference_numbers_of_iterations() {
    let cube = refine_mesh(&cube(), Scheme::CatmullClark, 4, false);
    let cases = [
        (
            "Loop, sphere",
            Scheme::Loop,
            add_noise(&add_bumps(&sphere(4)), 0.01),
            [20, 43, 74],
            [7, 13, 22],
        ),
        (
            "Loop, torus",
            Scheme::Loop,
            add_noise(&torus(60, 30, true), 0.01),
            [20, 42, 73],
            [7, 13, 21],
        ),
        (
            "Catmull-Clark, torus",
            Scheme::CatmullClark,
            add_noise(&torus(60, 30, false), 0.01),
            [42, 96, 173],
            [11, 20, 33],
        ),
        (
            "Catmull-Clark, cube",
            Scheme::CatmullClark,
            add_noise(&cube, 0.01),
            [51, 110, 189],
            [11, 21, 34],
        ),
        (
            "Doo-Sabin, torus",
            Scheme::DooSabin,
            add_noise(&torus(60, 30, false), 0.01),
            [19, 41, 72],
            [7, 13, 21],
        ),
        ("smooth torus", Scheme::CatmullClark, torus(60, 30, false), [2, 3, 5], [2, 2, 2]),
    ];
    for (name, scheme, mesh, plain, pcg) in cases {
        // The test meshes have other noise than those of the reference. The `Plain` counts depend on slowly converging components of the
        // noise, so they may differ by 6 %.
        for (solver, expected, allowed) in [(Solver::Plain, plain, 3), (Solver::Pcg, pcg, 2)] {
            let counts = counts(&mesh, scheme, solver);
            for (count, expected) in counts.into_iter().zip(expected) {
                let allowed = (expected * 6 / 100).max(allowed);
                assert!(
                    count.abs_diff(expected) <= allowed,
                    "{name} {solver:?} {counts:?}, reference {expected}"
                );
            }
        }
    }
}

#[test]
fn every_solver_interpolates_closed_open_and_creased_meshes() {
    let mut open = torus(12, 8, false);
    let some: Vec<_> = (0..open.faces().len() as u32).filter(|face| face % 12 > 2).collect();
    open = select_faces(&open, &some).unwrap();
    let creased = add_noise(&torus(12, 8, false), 0.05);
    let ring = (0..12).map(|k| ([k, (k + 1) % 12], 10.0));
    let spoke = (0..4).map(|k| ([k * 12, (k + 1) * 12], 10.0));
    let creased = creased.with_creases(ring.chain(spoke)).unwrap();
    for scheme in SCHEMES {
        for mesh in [add_noise(&torus(12, 8, false), 0.05), open.clone(), creased.clone()] {
            let mesh = match scheme {
                Scheme::Loop => triangulate_fans(&mesh),
                _ => mesh,
            };
            for solver in [Solver::Pcg, Solver::Plain, Solver::Direct] {
                let found = interpolate_mesh(&mesh, scheme, &options(solver, 1e-11));
                let off = farthest(&mesh, &found.shape, scheme);
                assert!(
                    found.settled && off <= 1e-9,
                    "{scheme:?} {solver:?} {off} {} {:?}",
                    mesh.creases().len(),
                    found.trace
                );
            }
        }
    }
}

/// The smallest eigenvalue of the matrix of limit masks.
fn smallest(mesh: &Mesh, scheme: Scheme) -> f64 {
    let limit = limits(mesh, scheme);
    let matrix = limit_matrix(&limit, mesh.faces(), &[]);
    let scale = matrix.scale.unwrap();
    let mut dense = DMatrix::zeros(scale.len(), scale.len());
    for row in 0..scale.len() {
        let (indices, weights) = limit.positions.row(row);
        for (&column, weight) in indices.iter().zip(weights) {
            dense[(row, column as usize)] = weight * (scale[row] / scale[column as usize]).sqrt();
        }
    }
    let skew = (&dense - dense.transpose()).amax();
    assert!(skew <= 1e-14, "the scale makes the masks symmetric: {skew}");
    SymmetricEigen::new(dense).eigenvalues.min()
}

#[test]
fn the_limit_masks_have_their_known_smallest_eigenvalues() {
    fn check(name: &str, mesh: Mesh, scheme: Scheme, expected: f64, precision: f64) {
        let found = smallest(&mesh, scheme);
        assert!((found - expected).abs() <= precision, "{name}: {found} {expected}");
    }
    check("tetrahedron", tetrahedron(), Scheme::Loop, 0.2, 1e-10);
    check("octahedron", octahedron(), Scheme::Loop, 0.154_545_454_5, 1e-9);
    check("icosahedron", sphere(0), Scheme::Loop, 0.235_034_336_8, 1e-9);
    check("sphere 2", sphere(2), Scheme::Loop, 0.251_756_7, 1e-7);
    check("torus", torus(24, 12, true), Scheme::Loop, 0.25, 1e-10);
    check("cube", cube(), Scheme::CatmullClark, 0.0, 1e-12);
    for (steps, expected) in [(1, 0.077_918_5), (2, 0.100_984_0)] {
        let cube = refine_mesh(&cube(), Scheme::CatmullClark, steps, false);
        check("refined cube", cube, Scheme::CatmullClark, expected, 1e-7);
    }
    check("tetrahedron", tetrahedron(), Scheme::CatmullClark, 2.0 / 9.0, 1e-10);
    check("octahedron", octahedron(), Scheme::CatmullClark, 2.0 / 9.0, 1e-10);
    check("icosahedron", sphere(0), Scheme::CatmullClark, 0.324_633_7, 1e-7);
    check("torus", torus(24, 12, false), Scheme::CatmullClark, 1.0 / 9.0, 1e-10);
    check("hexagonal prism", prism(6), Scheme::CatmullClark, 0.0, 1e-12);
    check("pentagonal prism", prism(5), Scheme::CatmullClark, 0.031_830_5, 1e-7);
    check("cube", cube(), Scheme::DooSabin, 0.25, 1e-10);
    check("tetrahedron", tetrahedron(), Scheme::DooSabin, 5.0 / 9.0, 1e-10);
    check("octahedron", octahedron(), Scheme::DooSabin, 0.5, 1e-10);
}

#[test]
fn a_cube_is_interpolated_but_not_a_cube_with_one_vertex_moved() {
    let plain = options(Solver::Plain, 1e-12);
    let trace = interpolate_mesh(&cube(), Scheme::CatmullClark, &plain).trace;
    let last = trace.steps().last().unwrap().iteration;
    assert!(last.abs_diff(40) <= 6, "{last}");
    let mut positions = cube().positions().to_vec();
    positions[3].x += 0.1;
    let moved = cube().with_positions(positions).unwrap();
    for solver in [Solver::Pcg, Solver::Plain, Solver::Direct] {
        let refused = interpolate(
            &moved,
            Scheme::CatmullClark,
            &options(solver, 1e-9),
            &[],
            &Progress::silent(),
        );
        let refused = refused.unwrap_err().to_string();
        let expected = "no control mesh of this connectivity has a surface through all vertices: a distance of 1.250e-2 mm remains";
        assert!(refused.starts_with(expected), "{solver:?} {refused}");
        let near =
            InterpolateOptions { on_singular: OnSingular::LeastSquares, ..options(solver, 1e-9) };
        let near = interpolate_mesh(&moved, Scheme::CatmullClark, &near);
        assert!(!near.settled);
        let distance = farthest(&moved, &near.shape, Scheme::CatmullClark);
        assert!((distance - 0.0125).abs() <= 1e-6, "{solver:?} {distance}");
        let surface =
            limits(&near.shape, Scheme::CatmullClark).positions.apply(near.shape.positions());
        for (surface, vertex) in surface.iter().zip(moved.positions().iter()) {
            let off = surface - vertex;
            assert!((off.x.abs() - 0.0125).abs() <= 1e-6, "{solver:?} {off}");
        }
    }
    let once =
        InterpolateOptions { on_singular: OnSingular::RefineOnce, ..options(Solver::Pcg, 1e-12) };
    let once = interpolate_mesh(&moved, Scheme::CatmullClark, &once);
    assert!(once.settled && once.shape.positions().len() == 26);
    let surface = limits(&once.shape, Scheme::CatmullClark).positions.apply(once.shape.positions());
    for (surface, vertex) in surface.iter().zip(moved.positions().iter()) {
        assert!((surface - vertex).norm() <= 1e-10);
    }
}

#[test]
fn the_plain_iteration_shrinks_by_the_smallest_eigenvalue_in_every_step() {
    let mesh = add_noise(&add_bumps(&sphere(2)), 0.02);
    let limit = limits(&mesh, Scheme::Loop);
    let scale = limit_matrix(&limit, mesh.faces(), &[]).scale.unwrap();
    let length = |iterations: u32| {
        let how = Interpolation {
            iterations,
            tolerance: 1e-14,
            solver: Solver::Plain,
            ..Interpolation::default()
        };
        let options = InterpolateOptions { how, ..InterpolateOptions::default() };
        let control = interpolate_mesh(&mesh, Scheme::Loop, &options).shape;
        let surface = limit.positions.apply(control.positions());
        let missed = mesh.positions().iter().zip(&surface).zip(&scale);
        missed.map(|((a, b), scale)| scale * (a - b).norm_squared()).sum::<f64>().sqrt()
    };
    let lengths: Vec<_> = (0..12).map(length).collect();
    for pair in lengths.windows(2) {
        assert!(pair[1] / pair[0] <= 1.0 - 0.251_756_7 + 1e-6, "{lengths:?}");
    }
}

#[test]
fn the_published_iteration_reduces_the_distance_and_starts_at_the_vertices() {
    for mesh in [
        add_bumps(&sphere(2)),
        add_noise(&add_bumps(&sphere(2)), 0.02),
        torus(24, 12, true),
        add_noise(&torus(24, 12, true), 0.02),
    ] {
        fn closest(iterations: u32, norm: Norm, mesh: &Mesh) -> InterpolationResult<Mesh> {
            let (foot, solver, tolerance) = (Foot::Closest, Solver::Plain, 1e-5);
            let how = Interpolation {
                foot,
                solver,
                tolerance,
                norm,
                iterations,
                ..Interpolation::default()
            };
            interpolate_mesh(
                mesh,
                Scheme::Loop,
                &InterpolateOptions { how, ..InterpolateOptions::default() },
            )
        }
        assert_eq!(closest(0, Norm::Max, &mesh).shape.positions(), mesh.positions());
        let allowed = 1e-5 * crate::solve::extent::diagonal(mesh.positions());
        for norm in [Norm::Max, Norm::Mean] {
            let found = closest(60, norm, &mesh);
            let steps: Vec<_> = found
                .trace
                .steps()
                .iter()
                .map(|step| match norm {
                    Norm::Max => step.max,
                    Norm::Mean => step.rms,
                })
                .collect();
            assert!(found.settled && steps[steps.len() - 1] <= allowed, "{steps:?}");
            assert!(steps[..steps.len() - 1].iter().all(|step| *step > allowed));
            assert!(steps.windows(4).all(|window| window[3] <= window[0]), "{steps:?}");
        }
        let (vertex, near) = (options(Solver::Plain, 1e-5), closest(60, Norm::Max, &mesh));
        let vertex = interpolate_mesh(&mesh, Scheme::Loop, &vertex).trace.steps().len();
        let near = near.trace.steps().len();
        assert!(near <= vertex + 1, "{near} iterations, with the vertices' own feet {vertex}");
    }
}

#[test]
fn an_affine_map_before_is_the_same_map_after() {
    let map = Matrix3::new(2.0, 0.3, -0.1, 0.0, 0.7, 0.4, 0.5, 0.0, 1.5);
    let shift = Vector3::new(3.0, -20.0, 1.0);
    fn map_positions(mesh: &Mesh, map: &Matrix3<f64>, shift: Vector3<f64>) -> Mesh {
        let positions = mesh.positions().iter().map(|p| Point3::from(*map * p.coords + shift));
        mesh.with_positions(positions.collect()).unwrap()
    }
    for (scheme, mesh) in
        SCHEMES.into_iter().zip([sphere(2), torus(12, 8, false), torus(12, 8, false)])
    {
        let mesh = add_noise(&mesh, 0.05);
        let options = options(Solver::Pcg, 1e-13);
        let after = map_positions(&interpolate_mesh(&mesh, scheme, &options).shape, &map, shift);
        let before = interpolate_mesh(&map_positions(&mesh, &map, shift), scheme, &options).shape;
        let pairs = before.positions().iter().zip(after.positions().iter());
        assert!(pairs.map(|(a, b)| (a - b).norm()).fold(0.0, f64::max) <= 1e-9, "{scheme:?}");
    }
}

#[test]
fn fixed_control_points_stay_and_the_others_still_interpolate() {
    let mesh = add_noise(&add_bumps(&sphere(2)), 0.02);
    let fixed: Vec<_> = (0..mesh.positions().len()).map(|vertex| vertex % 5 == 0).collect();
    for solver in [Solver::Pcg, Solver::Plain, Solver::Direct] {
        let options = options(solver, 1e-11);
        let control = interpolate(&mesh, Scheme::Loop, &options, &fixed, &Progress::silent());
        let control = control.unwrap().shape;
        let surface = limits(&mesh, Scheme::Loop).positions.apply(control.positions());
        for vertex in 0..fixed.len() {
            let point = mesh.positions()[vertex];
            if fixed[vertex] {
                assert_eq!(control.positions()[vertex], point);
            } else {
                assert!((surface[vertex] - point).norm() <= 1e-9, "{solver:?}");
            }
        }
    }
}

#[test]
fn limits_of_a_known_control_mesh_give_it_back() {
    let meshes = [
        add_noise(&sphere(2), 0.05),
        add_noise(&torus(12, 8, false), 0.05),
        add_noise(&cube(), 0.2),
    ];
    for (scheme, mesh) in SCHEMES.into_iter().zip(meshes) {
        let surface = limits(&mesh, scheme).positions.apply(mesh.positions());
        let given = mesh.with_positions(surface).unwrap();
        let control = interpolate_mesh(&given, scheme, &options(Solver::Pcg, 1e-12)).shape;
        let pairs = control.positions().iter().zip(mesh.positions().iter());
        assert!(pairs.map(|(a, b)| (a - b).norm()).fold(0.0, f64::max) <= 1e-8, "{scheme:?}");
    }
}

#[test]
fn the_bytes_do_not_depend_on_the_number_of_threads() {
    let mesh = add_noise(&add_bumps(&sphere(4)), 0.01);
    fn run(threads: usize, mesh: &Mesh) -> Mesh {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| interpolate_mesh(mesh, Scheme::Loop, &options(Solver::Pcg, 1e-9)).shape)
    }
    let first = run(1, &mesh);
    for threads in [2, 8] {
        assert_eq!(run(threads, &mesh).positions(), first.positions());
    }
}

#[test]
fn invalid_input_is_an_error() {
    fn interpolate_error(scheme: Scheme, options: &InterpolateOptions) -> String {
        interpolate(&cube(), scheme, options, &[], &Progress::silent()).unwrap_err().to_string()
    }
    let none = InterpolateOptions { boundary: Boundary::None, ..InterpolateOptions::default() };
    let no_border = "with `boundary: None` the surface ends before the border and cannot pass through the vertices there";
    assert_eq!(interpolate_error(Scheme::DooSabin, &none), no_border);
    let how = Interpolation { foot: Foot::Closest, ..Interpolation::default() };
    let closest = InterpolateOptions { how, ..InterpolateOptions::default() };
    let not_linear = interpolate_error(Scheme::DooSabin, &closest);
    assert!(not_linear.starts_with("solver Pcg solves only linear equations"), "{not_linear}");
    let loops = interpolate_error(Scheme::Loop, &InterpolateOptions::default());
    assert_eq!(
        loops,
        "face 0 has 4 corners, but Loop's scheme needs triangles; use `CatmullClark`, or `Remesh` to make triangles"
    );
}

/// Divides each polygon into a fan of triangles.
fn triangulate_fans(mesh: &Mesh) -> Mesh {
    let fans = mesh
        .faces()
        .iter()
        .flat_map(|face| (1..face.len() - 1).map(|k| [face[0], face[k], face[k + 1]]));
    let faces = maquette_value::Faces::triangles(fans.collect());
    Mesh::new(mesh.positions().clone(), faces).unwrap().with_creases(mesh.creases()).unwrap()
}

#[test]
fn a_direct_solution_that_needs_too_much_memory_is_an_error() {
    // In a prism over a polygon of 1500 corners, each limit point depends on all corners of both polygons.
    let mesh = prism(1500);
    let error = interpolate(
        &mesh,
        Scheme::DooSabin,
        &options(Solver::Direct, 1e-6),
        &[],
        &Progress::silent(),
    );
    let error = error.unwrap_err().to_string();
    assert!(
        error.starts_with("solving for the control points by factors would need about"),
        "{error}"
    );
    assert!(error.contains("take `solver: Pcg`"), "{error}");
}
