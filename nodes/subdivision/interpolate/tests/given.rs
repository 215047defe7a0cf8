//! Tests of `foot: Closest` and `direction: Normal` on difficult meshes: thin parts, spikes, few vertices.

#![allow(clippy::print_stdout, reason = "says what is not there to be tested")]

use std::path::{Path, PathBuf};

use maquette_node::InputFile;
use maquette_value::{Faces, TriangleTree};

use super::*;
use crate::solve::extent::diagonal;

/// The meshes of the shared data folder; empty if the folder does not exist.
fn shared_meshes() -> Vec<(String, Mesh)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/meshes");
    fn collect_meshes(
        path: &Path,
    ) -> std::iter::Flatten<std::iter::Flatten<std::result::IntoIter<std::fs::ReadDir>>> {
        std::fs::read_dir(path).into_iter().flatten().flatten()
    }
    let files = collect_meshes(&folder)
        .flat_map(|entry| collect_meshes(&entry.path()).map(|file| file.path()));
    let mut files: Vec<_> = files.collect();
    files.sort();
    files
        .into_iter()
        .filter_map(|path: PathBuf| {
            path.extension()?.to_str().filter(|format| ["obj", "ply"].contains(format))?;
            let name = path.file_stem()?.to_str()?.to_owned();
            let mesh = read(&path);
            Some((name, mesh)).filter(|(_, mesh)| !mesh.faces().is_empty())
        })
        .collect()
}

fn read(path: &Path) -> Mesh {
    maquette_format::read(&InputFile::standalone(
        &path.to_string_lossy(),
        &std::fs::read(path).unwrap(),
    ))
    .unwrap()
}

/// Reads a mesh file of the example graph `doll`.
fn example(name: &str) -> Mesh {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../graphs/doll");
    read(&folder.join(name))
}

/// A torus of quads with some long thin spikes.
fn spiky() -> Mesh {
    let mesh = torus(12, 8, false);
    let mut positions = mesh.positions().to_vec();
    for k in [5, 40, 77] {
        positions[k] = (positions[k].coords * 1.8).into();
    }
    mesh.with_positions(positions).unwrap()
}

/// Creates a very thin box.
fn plate() -> Mesh {
    let mesh = refine_mesh(&cube(), Scheme::CatmullClark, 2, false);
    let flat = mesh.positions().iter().map(|p| Point3::new(p.x, p.y, 0.02 * p.z));
    mesh.with_positions(flat.collect()).unwrap()
}

fn prepare(mesh: &Mesh, scheme: Scheme) -> Mesh {
    let mesh = if scheme == Scheme::Loop { triangulate_fans(mesh) } else { mesh.clone() };
    Mesh::new(mesh.positions().clone(), mesh.faces().clone()).unwrap()
}

/// The largest distance of a control point from the given vertex with the same index, relative to the diagonal of the bounding box.
fn max_displacement(mesh: &Mesh, control: &Mesh) -> f64 {
    let pairs = mesh.positions().iter().zip(control.positions().iter());
    pairs.map(|(a, b)| (a - b).norm()).fold(0.0, f64::max) / diagonal(mesh.positions())
}

/// Interpolates a mesh with the given options, and checks the distances.
fn check(name: &str, mesh: &Mesh, scheme: Scheme, foot: Foot, direction: Direction) {
    let mesh = prepare(mesh, scheme);
    let how = Interpolation { foot, direction, solver: Solver::Plain, ..Interpolation::default() };
    let options = InterpolateOptions { how, ..InterpolateOptions::default() };
    let found = interpolate(&mesh, scheme, &options, &[], &Progress::silent());
    let found = found.unwrap_or_else(|error| panic!("{name} {scheme:?} {foot:?}: {error}"));
    let steps = found.trace.steps();
    let missed = steps[steps.len() - 1].max / diagonal(mesh.positions());
    let moved = max_displacement(&mesh, &found.shape);
    let said = format!("{name} {scheme:?} {foot:?} {direction:?}: {missed:e} {moved}");
    assert!(found.settled && missed <= 1e-6 && moved <= 1.0, "{said}");
    // The expected distances are those of the vertices from a fine mesh; their accuracy depends on the edge length of the fine mesh.
    if mesh.positions().len() < 300 {
        let fine = refine_mesh(&found.shape, scheme, 5, true);
        let hits = TriangleTree::new(&fine).nearest_to_all(mesh.positions());
        let worst = hits.iter().map(|hit| hit.unwrap().distance_sq.sqrt()).fold(0.0, f64::max);
        assert!(worst <= 5e-4 * diagonal(mesh.positions()), "{said} {worst}");
    }
}

#[test]
fn closest_feet_and_normal_directions_interpolate_the_vertices() {
    let meshes = [
        ("spiky", spiky()),
        ("noisy", add_noise(&torus(12, 8, false), 0.1)),
        ("refined cube", add_noise(&refine_mesh(&cube(), Scheme::CatmullClark, 1, false), 0.1)),
        ("sphere", add_bumps(&sphere(1))),
        ("doll", example("coarse.obj")),
        ("jug", example("mug.obj")),
    ];
    for (name, mesh) in meshes {
        for scheme in SCHEMES {
            for (foot, direction) in [
                (Foot::Closest, Direction::Residual),
                (Foot::Closest, Direction::Normal),
                (Foot::Vertex, Direction::Normal),
            ] {
                check(name, &mesh, scheme, foot, direction);
            }
        }
    }
    // In a thin part, the nearest surface point must not be searched on the opposite sheet. Catmull-Clark is not tested, because the
    // smallest eigenvalue of a cube is too small.
    for scheme in [Scheme::Loop, Scheme::DooSabin] {
        check("plate", &plate(), scheme, Foot::Closest, Direction::Residual);
    }
}

#[test]
fn closest_feet_interpolate_the_shared_meshes() {
    let meshes = shared_meshes();
    if meshes.is_empty() {
        println!("SKIPPED: ../shared/data/meshes is not beside the project");
    }
    for (name, mesh) in meshes {
        // In an unoptimized build large meshes would be too slow.
        if mesh.edges().faces.iter().any(|&count| count != 2) || mesh.positions().len() > 5000 {
            println!("SKIPPED: {name}, which is open or large");
            continue;
        }
        for scheme in SCHEMES {
            check(&name, &mesh, scheme, Foot::Closest, Direction::Residual);
        }
        if mesh.positions().len() < 1000 {
            for scheme in SCHEMES {
                check(&name, &mesh, scheme, Foot::Closest, Direction::Normal);
                check(&name, &mesh, scheme, Foot::Vertex, Direction::Normal);
            }
        }
    }
}

#[test]
fn an_unsolvable_problem_is_an_error_without_extreme_control_points() {
    // Around a prism, the limit surface shows only a thirtieth of an alternating pattern of control points, so the control points must be
    // far away.
    let mesh = prism(5);
    let shifted = mesh.positions().iter().zip([1.0, -1.0].into_iter().cycle());
    let shifted = shifted.map(|(p, sign)| p + Vector3::new(0.0, 0.0, 0.5 * sign));
    let alternating = mesh.with_positions(shifted.collect()).unwrap();
    let mut positions = cube().positions().to_vec();
    positions[3].x += 0.1;
    let moved_cube = cube().with_positions(positions).unwrap();
    let mut refused = 0;
    for mesh in [alternating, moved_cube] {
        for (foot, direction) in [
            (Foot::Closest, Direction::Residual),
            (Foot::Closest, Direction::Normal),
            (Foot::Vertex, Direction::Normal),
        ] {
            for iterations in [3, 10, 30, 1000] {
                let solver = Solver::Plain;
                let how =
                    Interpolation { foot, direction, solver, iterations, ..Default::default() };
                let options = InterpolateOptions { how, ..InterpolateOptions::default() };
                match interpolate(&mesh, Scheme::CatmullClark, &options, &[], &Progress::silent()) {
                    // If there is a solution, its control points are far from the given vertices, but its limit surface is near them.
                    Ok(found) => {
                        let surface = refine_mesh(&found.shape, Scheme::CatmullClark, 4, true);
                        let (low, high) = mesh.bounds().unwrap();
                        let off = surface.positions().iter().map(|p| p - p.sup(&low).inf(&high));
                        let off = off.map(|off| off.norm()).fold(0.0, f64::max);
                        assert!(off <= (high - low).norm(), "{foot:?} {direction:?} {off}");
                    }
                    Err(error) => {
                        let error = error.to_string();
                        let is_refused = error.starts_with("the iteration diverged: a")
                            || error.starts_with("no control mesh of this connectivity");
                        assert!(is_refused, "{error}");
                        refused += 1;
                    }
                }
            }
        }
    }
    assert!(refused > 0);
}

#[test]
fn feet_do_not_switch_to_another_sheet() {
    // Two thin flat boxes, one above the other. In one iteration their vertices move farther than the distance between the boxes, so that
    // the nearest point could be on the wrong box.
    let mesh = refine_mesh(&cube(), Scheme::CatmullClark, 1, false);
    let thin = |z: f64| mesh.positions().iter().map(move |p| Point3::new(p.x, p.y, 0.01 * p.z + z));
    let positions: Vec<_> = thin(0.0).chain(thin(0.03)).collect();
    let count = mesh.positions().len() as u32;
    let corners = mesh.faces().corners().iter().copied();
    let corners = corners.clone().chain(corners.map(|corner| corner + count));
    let both =
        Mesh::new(positions, Faces::uniform(4, corners.collect::<Vec<_>>()).unwrap()).unwrap();
    check("two plates", &both, Scheme::DooSabin, Foot::Closest, Direction::Residual);
    let how = Interpolation { foot: Foot::Closest, solver: Solver::Plain, ..Default::default() };
    let options = InterpolateOptions { how, ..InterpolateOptions::default() };
    let alone = mesh.with_positions(thin(0.0).collect()).unwrap();
    let [both, alone] =
        [both, alone].map(|mesh| interpolate_mesh(&mesh, Scheme::DooSabin, &options).shape);
    for (a, b) in alone.positions().iter().zip(both.positions().iter()) {
        assert!((a - b).norm() <= 1e-4, "the other plate has no say: {a} {b}");
    }
}
