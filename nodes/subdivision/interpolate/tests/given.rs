//! Nearest feet and normal directions on meshes that are hard for them: thin parts, tips, few vertices.

#![allow(clippy::print_stdout, reason = "says what is not there to be tested")]

use std::path::{Path, PathBuf};

use maquette_node::Reading;
use maquette_value::{Faces, TriangleTree};

use super::*;
use crate::solve::extent::diagonal;

/// The meshes of the shared data; none where it is not beside the project.
fn shared() -> Vec<(String, Mesh)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/meshes");
    fn inside(
        path: &Path,
    ) -> std::iter::Flatten<std::iter::Flatten<std::result::IntoIter<std::fs::ReadDir>>> {
        std::fs::read_dir(path).into_iter().flatten().flatten()
    }
    let files = inside(&folder).flat_map(|entry| inside(&entry.path()).map(|file| file.path()));
    let mut files = Vec::from_iter(files);
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
    maquette_format::read(&Reading::alone(&path.to_string_lossy(), &std::fs::read(path).unwrap()))
        .unwrap()
}

/// A file of the doll of the example graphs.
fn example(name: &str) -> Mesh {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../graphs/doll");
    read(&folder.join(name))
}

/// A torus of quads with some long thin spikes.
fn spiky() -> Mesh {
    let mesh = torus(12, 8, false);
    let mut places = mesh.positions().to_vec();
    for k in [5, 40, 77] {
        places[k] = (places[k].coords * 1.8).into();
    }
    mesh.with_positions(places).unwrap()
}

/// A box that is as thin as paper.
fn plate() -> Mesh {
    let mesh = refined(&cube(), Scheme::CatmullClark, 2, false);
    let flat = mesh.positions().iter().map(|p| Point3::new(p.x, p.y, 0.02 * p.z));
    mesh.with_positions(flat.collect()).unwrap()
}

fn prepared(mesh: &Mesh, scheme: Scheme) -> Mesh {
    let mesh = if scheme == Scheme::Loop { triangulated(mesh) } else { mesh.clone() };
    Mesh::new(mesh.positions().clone(), mesh.faces().clone()).unwrap()
}

/// How far the control points are from their vertices at most, over the diagonal.
fn moved(mesh: &Mesh, control: &Mesh) -> f64 {
    let pairs = mesh.positions().iter().zip(control.positions().iter());
    pairs.map(|(a, b)| (a - b).norm()).fold(0.0, f64::max) / diagonal(mesh.positions())
}

/// Interpolates with these feet, and measures what comes out.
fn check(name: &str, mesh: &Mesh, scheme: Scheme, foot: Foot, direction: Direction) {
    let mesh = prepared(mesh, scheme);
    let how = Interpolation { foot, direction, solver: Solver::Plain, ..Interpolation::default() };
    let options = InterpolateOptions { how, ..InterpolateOptions::default() };
    let found = interpolate(&mesh, scheme, &options, &[], &Progress::none());
    let found = found.unwrap_or_else(|error| panic!("{name} {scheme:?} {foot:?}: {error}"));
    let steps = found.trace.steps();
    let missed = steps[steps.len() - 1].max / diagonal(mesh.positions());
    let moved = moved(&mesh, &found.shape);
    let said = format!("{name} {scheme:?} {foot:?} {direction:?}: {missed:e} {moved}");
    assert!(found.settled && missed <= 1e-6 && moved <= 1.0, "{said}");
    // The chords of a fine mesh are as near as it is fine.
    if mesh.positions().len() < 300 {
        let fine = refined(&found.shape, scheme, 5, true);
        let hits = TriangleTree::new(&fine).nearest_to_all(mesh.positions());
        let worst = hits.iter().map(|hit| hit.unwrap().distance_sq.sqrt()).fold(0.0, f64::max);
        assert!(worst <= 5e-4 * diagonal(mesh.positions()), "{said} {worst}");
    }
}

#[test]
fn nearest_feet_and_normal_directions_reach_the_vertices() {
    let meshes = [
        ("spiky", spiky()),
        ("noisy", noisy(&torus(12, 8, false), 0.1)),
        ("refined cube", noisy(&refined(&cube(), Scheme::CatmullClark, 1, false), 0.1)),
        ("sphere", bumpy(&sphere(1))),
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
    // What is thin is no other sheet's. A cube's smallest eigenvalue is too small for Catmull and Clark.
    for scheme in [Scheme::Loop, Scheme::DooSabin] {
        check("plate", &plate(), scheme, Foot::Closest, Direction::Residual);
    }
}

#[test]
fn nearest_feet_reach_the_vertices_of_the_shared_meshes() {
    let meshes = shared();
    if meshes.is_empty() {
        println!("SKIPPED: ../shared/data/meshes is not beside the project");
    }
    for (name, mesh) in meshes {
        // The large ones are for the optimized program.
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
fn what_no_control_points_reach_is_an_error_and_no_monster() {
    // A pattern that alternates around a prism is smoothed away but for a thirtieth: it takes control points far off.
    let mesh = prism(5);
    let shifted = mesh.positions().iter().zip([1.0, -1.0].into_iter().cycle());
    let shifted = shifted.map(|(p, sign)| p + Vector3::new(0.0, 0.0, 0.5 * sign));
    let alternating = mesh.with_positions(shifted.collect()).unwrap();
    let mut places = cube().positions().to_vec();
    places[3].x += 0.1;
    let moved_cube = cube().with_positions(places).unwrap();
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
                match interpolate(&mesh, Scheme::CatmullClark, &options, &[], &Progress::none()) {
                    // Where there is a solution, its control points are far away, but its surface is not.
                    Ok(found) => {
                        let surface = refined(&found.shape, Scheme::CatmullClark, 4, true);
                        let (low, high) = mesh.bounds().unwrap();
                        let off = surface.positions().iter().map(|p| p - p.sup(&low).inf(&high));
                        let off = off.map(|off| off.norm()).fold(0.0, f64::max);
                        assert!(off <= (high - low).norm(), "{foot:?} {direction:?} {off}");
                    }
                    Err(
                        InterpolateError::Diverged(_) | InterpolateError::NotInterpolable { .. },
                    ) => {
                        refused += 1;
                    }
                    Err(error) => panic!("{error}"),
                }
            }
        }
    }
    assert!(refused > 0);
}

#[test]
fn a_shrunk_part_does_not_find_another_sheet() {
    // Two plates face each other, nearer than a step of the iteration shrinks their corners.
    let mesh = refined(&cube(), Scheme::CatmullClark, 1, false);
    let thin = |z: f64| mesh.positions().iter().map(move |p| Point3::new(p.x, p.y, 0.01 * p.z + z));
    let places: Vec<_> = thin(0.0).chain(thin(0.03)).collect();
    let count = mesh.positions().len() as u32;
    let corners = mesh.faces().corners().iter().copied();
    let corners = corners.clone().chain(corners.map(|corner| corner + count));
    let both = Mesh::new(places, Faces::uniform(4, corners.collect::<Vec<_>>()).unwrap()).unwrap();
    check("two plates", &both, Scheme::DooSabin, Foot::Closest, Direction::Residual);
    let how = Interpolation { foot: Foot::Closest, solver: Solver::Plain, ..Default::default() };
    let options = InterpolateOptions { how, ..InterpolateOptions::default() };
    let alone = mesh.with_positions(thin(0.0).collect()).unwrap();
    let [both, alone] = [both, alone].map(|mesh| found(&mesh, Scheme::DooSabin, &options).shape);
    for (a, b) in alone.positions().iter().zip(both.positions().iter()) {
        assert!((a - b).norm() <= 1e-4, "the other plate has no say: {a} {b}");
    }
}
