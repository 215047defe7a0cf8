//! Meshes with holes for which the original surface is known.

use std::path::{Path, PathBuf};

use maquette::rng;
use maquette::value::{Faces, Mesh};
use maquette_nodes::mesh::read_mesh;
use nalgebra::{Point3, Vector3};

#[path = "../../nodes/fill/shapes/nut.rs"]
mod nut;

/// A mesh with holes, and the original mesh without holes.
pub(crate) struct Case {
    pub(crate) name: String,
    pub(crate) holed: Mesh,
    /// The original mesh. It begins with the vertices of `holed`; the removed vertices follow.
    pub(crate) truth: Mesh,
    /// The mean length of the edges of `holed` before noise was added.
    pub(crate) edge: f64,
}

/// Returns all cases. Prints the names of missing data files.
pub(crate) fn cases() -> Vec<Case> {
    let folder = std::env::var_os("FILL_DATA").map(PathBuf::from);
    let folder =
        folder.unwrap_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data"));
    let mut cases = vec![bumpy_sphere(45), broken_nut(5), broken_nut(8)];
    cases.extend([wool(), terrain(), fur()]);
    for (name, file) in [
        ("holes/smooth_blob", "obj"),
        ("holes/smooth_spot", "obj"),
        ("holes/sharp_nut", "obj"),
        ("holes/rugged_mountain", "ply"),
        ("doll/holes", "ply"),
    ] {
        fn read(what: &str, folder: &Path, name: &str, file: &str) -> Option<Mesh> {
            let bytes = std::fs::read(folder.join(name).join(format!("{what}.{file}"))).ok()?;
            read_mesh(&bytes, file).ok()
        }
        if let (Some(holed), Some(truth)) =
            (read("holed", &folder, name, file), read("truth", &folder, name, file))
        {
            let edge = mean_edge(&holed);
            cases.push(Case { name: name.to_owned(), holed, truth, edge });
        } else {
            println!("skipped: {name} is not in {}", folder.display());
        }
    }
    for (file, seed, rings) in CUT {
        fn read(folder: &Path, file: &str) -> Option<Mesh> {
            let bytes = std::fs::read(folder.join(file)).ok()?;
            read_mesh(&bytes, file.rsplit('.').next()?).ok()
        }
        match read(&folder, file) {
            Some(mesh) => cases.push(cut(file, &mesh, seed, rings)),
            None => println!("skipped: {file} is not in {}", folder.display()),
        }
    }
    cases
}

/// Holes to be cut out of complete meshes: the file, the vertex in the middle of the hole, and its radius in rings of vertices. The holes
/// were chosen before any results were known.
const CUT: [(&str, u32, usize); 6] = [
    ("meshes/spot/spot_triangulated.obj", 1000, 8),
    ("meshes/penguin/penguin.obj", 1500, 9),
    ("meshes/koala/koala.ply", 10_000, 14),
    ("meshes/koala/koala.ply", 30_000, 14),
    ("doll/doll.ply", 5_000, 12),
    ("meshes/koala/koala_low_resolution.obj", 2_000, 9),
];

fn cut(file: &str, mesh: &Mesh, seed: u32, rings: usize) -> Case {
    let faces = mesh.faces().as_triangles().expect("triangles").to_vec();
    let mut gone = vec![false; mesh.positions().len()];
    gone[seed as usize] = true;
    for _ in 0..rings {
        let near = faces.iter().filter(|face| face.iter().any(|&vertex| gone[vertex as usize]));
        let near: Vec<u32> = near.flatten().copied().collect();
        near.into_iter().for_each(|vertex| gone[vertex as usize] = true);
    }
    let points = mesh.positions().to_vec();
    let (holed, truth) = remove_vertices(points, &faces, &gone);
    let edge = mean_edge(&holed);
    let name = file.rsplit('/').next().unwrap_or(file).split('.').next().unwrap_or(file);
    Case { name: format!("cut {name} {seed}"), holed, truth, edge }
}

/// A sphere with curly ridges. The removed part was chosen to be as rough as its surroundings.
fn wool() -> Case {
    let (directions, faces) = geodesic(45);
    let points: Vec<Point3<f64>> = directions
        .iter()
        .map(|v| {
            let x =
                v.x + 0.11 * libm::sin(6.0 * v.y + 1.0) + 0.07 * libm::sin(11.0 * v.z - 4.0 * v.y);
            let y =
                v.y + 0.11 * libm::sin(7.0 * v.z + 2.0) + 0.07 * libm::sin(10.0 * v.x + 3.0 * v.z);
            let z =
                v.z + 0.11 * libm::sin(5.0 * v.x - 1.0) + 0.07 * libm::sin(12.0 * v.y - 5.0 * v.x);
            let wave = libm::sin(13.0 * x + 9.0 * y)
                + libm::sin(15.0 * y - 8.0 * z + 1.0)
                + libm::sin(14.0 * z + 10.0 * x - 2.0);
            (v * (1.0 + 0.06 * libm::cos(2.0 * wave))).into()
        })
        .collect();
    let mesh = Mesh::new(points, Faces::triangles(faces)).expect("a sphere");
    cut("wool", &mesh, 14_300, 10)
}

/// A square terrain of fractal noise. The height of each wave is its wavelength to the power of 1.5, times a constant.
fn terrain() -> Case {
    let side = 120_u32;
    let tau = std::f64::consts::TAU;
    let waves: Vec<[f64; 4]> = (0..160)
        .map(|k| {
            let [long, turn, phase] = [0, 1, 2].map(|part| noise(3 * k + part + 77));
            // The wavelength, from 60 edges down to 3.
            let length = 60.0 * libm::pow(0.05, long);
            let (sine, cosine) = libm::sincos(tau * turn);
            let height = 0.003 * libm::pow(length, 1.5);
            [cosine * tau / length, sine * tau / length, tau * phase, height]
        })
        .collect();
    let corners =
        (0..side - 1).flat_map(|row| (0..side - 1).map(move |column| row * side + column));
    let faces = corners.flat_map(|k| [[k, k + 1, k + side + 1], [k, k + side + 1, k + side]]);
    let points: Vec<_> = (0..side * side)
        .map(|k: u32| {
            let (x, y) = (f64::from(k % side), f64::from(k / side));
            let high =
                waves.iter().map(|[u, v, phase, high]| high * libm::sin(u * x + v * y + phase));
            Point3::new(x, y, high.sum())
        })
        .collect();
    let mesh = Mesh::new(points, Faces::triangles(faces.collect())).expect("a square");
    cut("terrain", &mesh, side * 55 + 62, 11)
}

/// An egg with hair-like grooves along it, about five edges apart.
fn fur() -> Case {
    let (directions, faces) = geodesic(40);
    let points: Vec<Point3<f64>> = directions
        .iter()
        .map(|v| {
            let across = 46.0 * v.x
                + 2.5 * libm::sin(3.0 * v.y + 1.0)
                + 1.5 * libm::sin(7.0 * v.y - 2.0 * v.z)
                + 0.8 * libm::sin(17.0 * v.z + 5.0 * v.x);
            let high = 0.012 * (1.0 + 0.4 * libm::sin(9.0 * v.y + 4.0 * v.x)) * libm::sin(across);
            let egg = Vector3::new(v.x, 1.5 * v.y, v.z);
            Point3::from(egg * (1.0 + high))
        })
        .collect();
    let mesh = Mesh::new(points, Faces::triangles(faces)).expect("an egg");
    let seed = (0..directions.len() as u32)
        .max_by_key(|&vertex| {
            let toward = directions[vertex as usize].dot(&Vector3::new(0.1, 0.2, 1.0));
            (toward * 1e9) as i64
        })
        .expect("vertices");
    cut("fur", &mesh, seed, 10)
}

fn mean_edge(mesh: &Mesh) -> f64 {
    let edges = mesh.edges().vertices;
    fn place(vertex: u32, mesh: &Mesh) -> Point3<f64> {
        mesh.positions()[vertex as usize]
    }
    let sum: f64 = edges.iter().map(|&[a, b]| (place(a, mesh) - place(b, mesh)).norm()).sum();
    sum / edges.len() as f64
}

/// Returns a pseudorandom number from 0 to 1.
fn noise(seed: u64) -> f64 {
    rng::even(rng::mix(seed.wrapping_mul(rng::STEP)))
}

/// Moves the vertices of a case along their normals by random distances. These are normally distributed, with a standard deviation of
/// `share` times the mean length of edges.
pub(crate) fn with_noise(case: &Case, share: f64) -> Case {
    fn gauss(k: u64) -> f64 {
        (0..12).map(|i| noise(12 * k + i)).sum::<f64>() - 6.0
    }
    let normals = case.holed.vertex_normals();
    let points = case.holed.positions().iter().zip(normals).zip(1u64..);
    let moved = points.map(|((point, normal), k)| point + normal * (share * case.edge * gauss(k)));
    let holed = case.holed.with_positions(moved.collect()).expect("finite places");
    let name = format!("{} {}% noise", case.name, 100.0 * share);
    Case { name, holed, truth: case.truth.clone(), edge: case.edge }
}

/// The sphere of item 7 of the peers' benchmarks: a geodesic sphere with bumps and a hole. With a frequency of 45, it has 20 252 vertices,
/// of which 948 are missing.
pub(crate) fn bumpy_sphere(frequency: u32) -> Case {
    let (directions, faces) = geodesic(frequency);
    let axis = Vector3::new(0.48, 0.6, 0.64);
    let across = axis.cross(&Vector3::x()).normalize();
    let other = axis.cross(&across);
    let gone: Vec<bool> = directions
        .iter()
        .map(|v| {
            let angle = libm::atan2(v.dot(&other), v.dot(&across));
            let polar = libm::acos(v.dot(&axis).clamp(-1.0, 1.0));
            polar < 0.445 + 0.03 * libm::sin(5.0 * angle) + 0.015 * libm::cos(11.0 * angle)
        })
        .collect();
    let points = directions.iter().map(|&v| (v * bump(v)).into()).collect();
    let (holed, truth) = remove_vertices(points, &faces, &gone);
    let edge = mean_edge(&holed);
    Case { name: "bumpy sphere".to_owned(), holed, truth, edge }
}

fn broken_nut(sides: u32) -> Case {
    let (points, faces) = nut::nut(sides);
    let gone: Vec<bool> = points.iter().map(|point| nut::is_lost(point, sides)).collect();
    let (holed, truth) = remove_vertices(points, &faces, &gone);
    let edge = mean_edge(&holed);
    Case { name: format!("nut of {sides} sides"), holed, truth, edge }
}

/// Removes the vertices for which `gone` is true. Returns the remaining mesh, and the complete mesh with the removed vertices at the end.
fn remove_vertices(points: Vec<Point3<f64>>, faces: &[[u32; 3]], gone: &[bool]) -> (Mesh, Mesh) {
    let mut kept: Vec<[u32; 3]> = faces
        .iter()
        .filter(|face| face.iter().all(|&vertex| !gone[vertex as usize]))
        .copied()
        .collect();
    loop {
        // Also remove the faces at a vertex with more than two border edges, because the surface would be pinched there.
        let border =
            Mesh::new(vec![Point3::origin(); points.len()], Faces::triangles(kept.clone()));
        let edges = border.expect("faces of a surface").edges();
        let mut ends = vec![0; points.len()];
        for (pair, _) in edges.vertices.iter().zip(&edges.faces).filter(|(_, faces)| **faces == 1) {
            pair.iter().for_each(|&end| ends[end as usize] += 1);
        }
        let before = kept.len();
        kept.retain(|face| face.iter().all(|&vertex| ends[vertex as usize] <= 2));
        if kept.len() == before {
            // Also remove fragments without an inner vertex, because they would be loose pieces in the hole.
            let mut is_held: Vec<bool> = ends.iter().map(|&ways| ways == 0).collect();
            fn holds(held: &[bool], face: &[u32; 3]) -> bool {
                face.iter().any(|&v| held[v as usize])
            }
            loop {
                let before = is_held.iter().filter(|&&held| held).count();
                for face in kept.iter() {
                    if holds(&is_held, face) {
                        face.iter().for_each(|&vertex| is_held[vertex as usize] = true);
                    }
                }
                if is_held.iter().filter(|&&held| held).count() == before {
                    break;
                }
            }
            kept.retain(|face| holds(&is_held, face));
            break;
        }
    }
    let mut used = vec![false; points.len()];
    kept.as_flattened().iter().for_each(|&vertex| used[vertex as usize] = true);
    let (data, lost): (Vec<usize>, Vec<usize>) =
        (0..points.len()).partition(|&vertex| used[vertex]);
    let order: Vec<usize> = data.iter().chain(&lost).copied().collect();
    let mut numbers = vec![0u32; order.len()];
    (0..).zip(&order).for_each(|(number, &vertex)| numbers[vertex] = number);
    fn renumber(faces: &[[u32; 3]], numbers: &[u32]) -> Faces {
        Faces::triangles(
            faces.iter().map(|face| face.map(|vertex| numbers[vertex as usize])).collect(),
        )
    }
    let points: Vec<Point3<f64>> = order.iter().map(|&k| points[k]).collect();
    let holed =
        Mesh::new(points[..data.len()].to_vec(), renumber(&kept, &numbers)).expect("a surface");
    let truth = Mesh::new(points, renumber(faces, &numbers)).expect("a surface");
    (holed, truth)
}

fn bump(v: Vector3<f64>) -> f64 {
    let (x, y, z) = (v.x, v.y, v.z);
    let low = 0.08 * libm::sin(3.1 * x + 0.4) * libm::cos(2.7 * y - 0.3)
        + 0.05 * libm::sin(4.3 * z + 1.7 * x);
    let fine =
        libm::sin(27.0 * x + 3.0 * y) * libm::sin(25.0 * y + 1.0) * libm::sin(26.0 * z + 2.0);
    1.0 + low + 0.008 * fine
}

/// Creates a geodesic sphere: an icosahedron whose faces are each divided into `frequency` squared triangles, projected onto the unit
/// sphere.
fn geodesic(frequency: u32) -> (Vec<Vector3<f64>>, Vec<[u32; 3]>) {
    let g = (1.0 + 5f64.sqrt()) / 2.0;
    let corners = [
        [-1.0, g, 0.0],
        [1.0, g, 0.0],
        [-1.0, -g, 0.0],
        [1.0, -g, 0.0],
        [0.0, -1.0, g],
        [0.0, 1.0, g],
        [0.0, -1.0, -g],
        [0.0, 1.0, -g],
        [g, 0.0, -1.0],
        [g, 0.0, 1.0],
        [-g, 0.0, -1.0],
        [-g, 0.0, 1.0],
    ];
    const SIDES: [[usize; 3]; 20] = [
        [0, 11, 5],
        [0, 5, 1],
        [0, 1, 7],
        [0, 7, 10],
        [0, 10, 11],
        [1, 5, 9],
        [5, 11, 4],
        [11, 10, 2],
        [10, 7, 6],
        [7, 1, 8],
        [3, 9, 4],
        [3, 4, 2],
        [3, 2, 6],
        [3, 6, 8],
        [3, 8, 9],
        [4, 9, 5],
        [2, 4, 11],
        [6, 2, 10],
        [8, 6, 7],
        [9, 8, 1],
    ];
    let mut numbers = std::collections::BTreeMap::new();
    let (mut points, mut faces) = (Vec::new(), Vec::new());
    for side in SIDES {
        let [a, b, c] = side.map(|k| Vector3::from(corners[k]));
        let mut number = |i: u32, j: u32| {
            let shares = [frequency - i - j, i, j].map(|k| f64::from(k) / f64::from(frequency));
            let point = a * shares[0] + b * shares[1] + c * shares[2];
            let key: [i64; 3] = point.map(|x| (x * 1e6).round() as i64).into();
            *numbers.entry(key).or_insert_with(|| {
                points.push(point.normalize());
                points.len() as u32 - 1
            })
        };
        for i in 0..frequency {
            for j in 0..frequency - i {
                faces.push([number(i, j), number(i + 1, j), number(i, j + 1)]);
                if i + j + 1 < frequency {
                    faces.push([number(i + 1, j), number(i + 1, j + 1), number(i, j + 1)]);
                }
            }
        }
    }
    (points, faces)
}
