//! How long does it take to fill a hole, and how far is what fills it from what was there?
//!
//! Prints a table of all methods on all cases: those of the data's folder (`FILL_DATA`, by default `../shared/data`), and a bumpy sphere with
//! a hole of 948 vertices, the one of the peers' item 7; each also with noise. `fill WORD ...` prints the rows whose case or method has one of
//! the words, `fill rims` the times of large rims, `fill sizes` those of thin plates over one hole in ever finer data. `CGAL_FILL` may name
//! the program made of `benches/peers/cgal_fill.cpp`, which then fills the same holes.
//!
//! Times are of the public function, on values, the least of several runs. Distances are divided by the mean edge: of points all over the
//! filled part to the truth (root of the mean square, and largest), and of the lost vertices to the filled mesh.

#![allow(clippy::print_stdout, reason = "whoever measures must know what was measured")]

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use maquette::Progress;
use maquette::value::{Faces, Mesh, TriangleTree};
use maquette_nodes::fill::{
    ExemplarOptions, FillMethod, FillOptions, HoleChoice, Start, Update, fill_holes,
};
use maquette_nodes::mesh::read_mesh;
use nalgebra::{Point3, Vector3};

fn main() {
    // As wherever there is an evaluator.
    maquette::memory::keep_freed();
    let words: Vec<String> =
        std::env::args().skip(1).filter(|word| !word.starts_with('-')).collect();
    if words.iter().any(|word| word == "rims") {
        return large_rims();
    }
    if words.iter().any(|word| word == "sizes") {
        return sizes();
    }
    let wanted = |text: &str| words.is_empty() || words.iter().any(|word| text.contains(&word[..]));
    println!(
        "{:28} {:18} {:>9} {:>7} {:>7} {:>7} {:>7} {:>6} {:>5}  doubts",
        "case", "method", "ms", "rms", "max", "back", "back max", "open", "added"
    );
    for case in cases() {
        for (name, method) in methods() {
            if wanted(&format!("{} {name}", case.name)) {
                let options = FillOptions { holes: HoleChoice::All, method };
                report(&case, name, &options);
            }
        }
        if let Some(program) =
            std::env::var_os("CGAL_FILL").filter(|_| wanted(&format!("{} cgal", case.name)))
        {
            cgal(&case, Path::new(&program));
        }
    }
}

fn methods() -> Vec<(&'static str, FillMethod)> {
    let published = ExemplarOptions {
        start: Start::Centroid,
        update: Update::Published,
        patience: 1,
        ..ExemplarOptions::default()
    };
    vec![
        ("flat", FillMethod::Flat),
        ("membrane", FillMethod::Membrane),
        ("thin plate", FillMethod::ThinPlate),
        ("crease-aware", FillMethod::CreaseAware),
        ("exemplar", FillMethod::default()),
        ("published", FillMethod::Exemplar(published)),
    ]
}

struct Case {
    name: String,
    holed: Mesh,
    truth: Mesh,
    edge: f64,
}

fn cases() -> Vec<Case> {
    let folder = std::env::var_os("FILL_DATA").map(PathBuf::from);
    let folder =
        folder.unwrap_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data"));
    let mut cases = vec![bumpy_sphere(45)];
    for (name, file) in [
        ("holes/smooth_blob", "obj"),
        ("holes/smooth_spot", "obj"),
        ("holes/sharp_nut", "obj"),
        ("holes/rugged_mountain", "ply"),
        ("doll/holes", "ply"),
    ] {
        let read = |what: &str| {
            let bytes = std::fs::read(folder.join(name).join(format!("{what}.{file}"))).ok()?;
            read_mesh(&bytes, file).ok()
        };
        if let (Some(holed), Some(truth)) = (read("holed"), read("truth")) {
            let edge = mean_edge(&holed);
            cases.push(Case { name: name.to_owned(), holed, truth, edge });
        } else {
            println!("{name} is not in {}", folder.display());
        }
    }
    for (file, seed, rings) in CUT {
        let read = || {
            let bytes = std::fs::read(folder.join(file)).ok()?;
            read_mesh(&bytes, file.rsplit('.').next()?).ok()
        };
        match read() {
            Some(mesh) => cases.push(cut(file, &mesh, seed, rings)),
            None => println!("{file} is not in {}", folder.display()),
        }
    }
    let noisy: Vec<Case> = cases.iter().map(with_noise).collect();
    cases.into_iter().chain(noisy).collect()
}

/// Holes cut out of whole meshes, for which nothing was chosen by what comes out: around a vertex, so many rings of vertices.
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
    let (holed, truth) = without(points, &faces, &gone);
    let edge = mean_edge(&holed);
    let name = file.rsplit('/').next().unwrap_or(file).split('.').next().unwrap_or(file);
    Case { name: format!("cut {name} {seed}"), holed, truth, edge }
}

fn mean_edge(mesh: &Mesh) -> f64 {
    let edges = mesh.edges().vertices;
    let place = |vertex: u32| mesh.positions()[vertex as usize];
    let sum: f64 = edges.iter().map(|&[a, b]| (place(a) - place(b)).norm()).sum();
    sum / edges.len() as f64
}

/// A number between 0 and 1 that looks random.
fn noise(seed: u64) -> f64 {
    let mut x = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15);
    x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((x ^ (x >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}

/// The data moved along its normals, 5 % of the mean edge (one sigma).
fn with_noise(case: &Case) -> Case {
    let gauss = |k: u64| (0..12).map(|i| noise(12 * k + i)).sum::<f64>() - 6.0;
    let normals = case.holed.vertex_normals();
    let points = case.holed.positions().iter().zip(normals).zip(1u64..);
    let moved = points.map(|((point, normal), k)| point + normal * (0.05 * case.edge * gauss(k)));
    let holed = case.holed.with_positions(moved.collect()).expect("finite places");
    Case { name: format!("{} noisy", case.name), holed, truth: case.truth.clone(), edge: case.edge }
}

const RUNS: usize = 5;

fn report(case: &Case, name: &str, options: &FillOptions) {
    let mut least = f64::INFINITY;
    let mut runs = 0;
    let begin = Instant::now();
    let filled = loop {
        let start = Instant::now();
        let filled = fill_holes(&case.holed, options, &Progress::none());
        least = least.min(start.elapsed().as_secs_f64());
        runs += 1;
        if runs == RUNS || begin.elapsed().as_secs_f64() > 5.0 {
            break filled;
        }
    };
    match filled {
        Err(error) => println!("{:28} {name:18} {error}", case.name),
        Ok(filled) => {
            let row = judge(case, name, 1e3 * least, &filled.mesh);
            println!("{row}  {}", filled.doubts.join("; "));
        }
    }
    if let Some(folder) = std::env::var_os("FILL_OUT") {
        let filled = fill_holes(&case.holed, options, &Progress::none());
        if let Ok(filled) = filled {
            let file = format!("{}-{name}.obj", case.name).replace(['/', ' '], "_");
            std::fs::write(Path::new(&folder).join(file), obj(&filled.mesh)).expect("a folder");
        }
    }
}

fn obj(mesh: &Mesh) -> String {
    let mut text = String::new();
    for p in mesh.positions().iter() {
        let _ = writeln!(text, "v {:e} {:e} {:e}", p.x, p.y, p.z);
    }
    for face in mesh.faces().iter() {
        let corners = face.iter().map(|vertex| format!(" {}", vertex + 1));
        let _ = writeln!(text, "f{}", corners.collect::<String>());
    }
    text
}

fn judge(case: &Case, name: &str, milliseconds: f64, filled: &Mesh) -> String {
    let data = case.holed.positions().len();
    let there = TriangleTree::new(&case.truth);
    let (samples, weights) = samples(filled, case.holed.faces().len());
    let distances: Vec<f64> = there
        .nearest_to_all(&samples)
        .into_iter()
        .flatten()
        .map(|place| place.distance_sq)
        .collect();
    let sum: f64 = distances.iter().zip(&weights).map(|(d, w)| d * w).sum();
    let rms = (sum / weights.iter().sum::<f64>()).sqrt() / case.edge;
    let most = |squares: &[f64]| squares.iter().copied().fold(0.0, f64::max).sqrt() / case.edge;
    let back: Vec<f64> = TriangleTree::new(filled)
        .nearest_to_all(&case.truth.positions()[data..])
        .into_iter()
        .flatten()
        .map(|place| place.distance_sq)
        .collect();
    let back_rms = (back.iter().sum::<f64>() / back.len() as f64).sqrt() / case.edge;
    let edges = filled.edges();
    let open = edges.faces.iter().filter(|&&faces| faces == 1).count();
    let bad = edges.faces.iter().filter(|&&faces| faces > 2).count() + edges.misoriented;
    let mut row = format!(
        "{:28} {name:18} {milliseconds:9.2} {rms:7.4} {:7.3} {back_rms:7.4} {:7.3} {open:6} {:5}",
        case.name,
        most(&distances),
        most(&back),
        filled.positions().len() - data
    );
    if bad > 0 {
        let _ = write!(row, "  {bad} BAD EDGES");
    }
    row
}

/// Points all over the faces behind the first `kept`, with the areas that they stand for.
fn samples(mesh: &Mesh, kept: usize) -> (Vec<Point3<f64>>, Vec<f64>) {
    let (mut points, mut weights) = (Vec::new(), Vec::new());
    for face in mesh.faces().iter().skip(kept) {
        let [a, b, c] = [0, 1, 2].map(|k| mesh.positions()[face[k] as usize].coords);
        let area = mesh.area_vector(face).norm();
        for [u, v, w] in [
            [1.0, 1.0, 1.0],
            [4.0, 1.0, 1.0],
            [1.0, 4.0, 1.0],
            [1.0, 1.0, 4.0],
            [2.0, 2.0, 0.5],
            [0.5, 2.0, 2.0],
            [2.0, 0.5, 2.0],
        ] {
            points.push(Point3::from((a * u + b * v + c * w) / (u + v + w)));
            weights.push(area);
        }
    }
    (points, weights)
}

/// The holed mesh filled by another program.
fn cgal(case: &Case, program: &Path) {
    let folder = std::env::temp_dir();
    let (input, output) = (folder.join("cgal_fill_in.txt"), folder.join("cgal_fill_out.txt"));
    let mesh = &case.holed;
    let mut text = format!("{} {}\n", mesh.positions().len(), mesh.faces().len());
    mesh.positions().iter().for_each(|p| {
        let _ = writeln!(text, "{:e} {:e} {:e}", p.x, p.y, p.z);
    });
    mesh.faces().iter().for_each(|f| {
        let _ = writeln!(text, "{} {} {}", f[0], f[1], f[2]);
    });
    std::fs::write(&input, text).expect("a folder for temporary files");
    let skipped = u8::from(case.name.contains("mountain")).to_string();
    for continuity in ["1", "2"] {
        let run = Command::new(program)
            .args([input.as_os_str(), output.as_os_str()])
            .args([continuity, &skipped])
            .output()
            .expect("the program of CGAL_FILL runs");
        let milliseconds: f64 =
            String::from_utf8_lossy(&run.stdout).trim().parse().unwrap_or(f64::NAN);
        let Ok(bytes) = std::fs::read(&output) else { continue };
        let filled = read_mesh(&bytes, "obj").expect("an OBJ file");
        println!("{}", judge(case, &format!("cgal {continuity}"), milliseconds, &filled));
    }
}

/// How long a rim of very many edges takes without refinement is what CGAL's manual tells; here the whole of `Flat`.
fn large_rims() {
    for count in [565u32, 774, 967, 2000, 7657] {
        let mesh = band(count);
        let options = FillOptions { holes: HoleChoice::Loops(vec![1]), method: FillMethod::Flat };
        let start = Instant::now();
        let filled = fill_holes(&mesh, &options, &Progress::none()).expect("a band has holes");
        let seconds = start.elapsed().as_secs_f64();
        let added = filled.mesh.positions().len() - mesh.positions().len();
        println!(
            "rim of {count:5} edges: {seconds:7.3} s, {added} vertices added; {}",
            filled.doubts.join("; ")
        );
    }
}

/// How the cost of a thin plate grows with the number of vertices that it gets.
fn sizes() {
    for frequency in [23, 45, 90, 180] {
        let case = bumpy_sphere(frequency);
        let options = FillOptions { holes: HoleChoice::All, method: FillMethod::ThinPlate };
        let mut least = f64::INFINITY;
        let mut added = 0;
        for _ in 0..RUNS {
            let start = Instant::now();
            let filled = fill_holes(&case.holed, &options, &Progress::none()).expect("a sphere");
            least = least.min(start.elapsed().as_secs_f64());
            added = filled.mesh.positions().len() - case.holed.positions().len();
        }
        println!(
            "{:6} vertices of data, {added:6} added: {:8.2} ms, {:6.2} us for each added one",
            case.holed.positions().len(),
            1e3 * least,
            1e6 * least / added as f64
        );
    }
}

/// A band along a wavy closed curve, whose inner border has so many edges.
fn band(count: u32) -> Mesh {
    let at = |k: u32, out: f64| {
        let angle = std::f64::consts::TAU * f64::from(k) / f64::from(count);
        let radius = (1.0 + 0.2 * libm::sin(5.0 * angle) + 0.1 * libm::cos(11.0 * angle)) * out;
        let height = 0.2 * libm::sin(3.0 * angle) + 0.1 * libm::cos(7.0 * angle);
        Point3::new(radius * libm::cos(angle), radius * libm::sin(angle), height)
    };
    let points: Vec<_> =
        (0..count).map(|k| at(k, 1.02)).chain((0..count).map(|k| at(k, 1.0))).collect();
    let faces = (0..count).flat_map(|k| {
        let next = (k + 1) % count;
        [[k, next, count + k], [next, count + next, count + k]]
    });
    Mesh::new(points, Faces::triangles(faces.collect())).expect("a band")
}

/// The sphere of the peers' item 7: a geodesic one with bumps, and a hole; at a frequency of 45 of 20 252 vertices, of which 948 are missing.
fn bumpy_sphere(frequency: u32) -> Case {
    let (directions, faces) = geodesic(frequency);
    let axis = Vector3::new(0.48, 0.6, 0.64);
    let across = axis.cross(&Vector3::x()).normalize();
    let other = axis.cross(&across);
    let is_gone = |v: &Vector3<f64>| {
        let angle = libm::atan2(v.dot(&other), v.dot(&across));
        let polar = libm::acos(v.dot(&axis).clamp(-1.0, 1.0));
        polar < 0.445 + 0.03 * libm::sin(5.0 * angle) + 0.015 * libm::cos(11.0 * angle)
    };
    let gone: Vec<bool> = directions.iter().map(is_gone).collect();
    let points = directions.iter().map(|&v| (v * bump(v)).into()).collect();
    let (holed, truth) = without(points, &faces, &gone);
    let edge = mean_edge(&holed);
    Case { name: "bumpy sphere".to_owned(), holed, truth, edge }
}

/// A mesh without some vertices, and the whole one with these at the end.
fn without(points: Vec<Point3<f64>>, faces: &[[u32; 3]], gone: &[bool]) -> (Mesh, Mesh) {
    let keeps = |face: &&[u32; 3]| face.iter().all(|&vertex| !gone[vertex as usize]);
    let mut kept: Vec<[u32; 3]> = faces.iter().filter(keeps).copied().collect();
    loop {
        // A vertex with two ways along the border is a bow tie.
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
            // Nor may a loose crumb be left in the hole, all of whose vertices are at the border.
            let mut is_held: Vec<bool> = ends.iter().map(|&ways| ways == 0).collect();
            let holds = |held: &[bool], face: &[u32; 3]| face.iter().any(|&v| held[v as usize]);
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
    let renumber = |faces: &[[u32; 3]]| {
        Faces::triangles(
            faces.iter().map(|face| face.map(|vertex| numbers[vertex as usize])).collect(),
        )
    };
    let points: Vec<Point3<f64>> = order.iter().map(|&k| points[k]).collect();
    let holed = Mesh::new(points[..data.len()].to_vec(), renumber(&kept)).expect("a surface");
    let truth = Mesh::new(points, renumber(faces)).expect("a surface");
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

/// An icosahedron, each face cut into `frequency` squared triangles, on the unit sphere.
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
