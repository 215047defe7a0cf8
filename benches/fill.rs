//! Measures the filling of holes: the time, the distance from the original surface, and if the result is a manifold surface without
//! self-intersections.
//!
//! Prints a table of all methods on all cases, each without and with noise. The cases are the meshes in the data folder (`FILL_DATA`, by
//! default `../shared/data`), and a bumpy sphere with a hole of 948 vertices (item 7 of the benchmarks of other programs, the peers).
//!
//! - `fill WORD ...` prints the rows whose case or method contains one of the words.
//! - `fill rims` prints the times for holes with many edges.
//! - `fill sizes` prints the times of thin plates over one hole in ever finer meshes.
//! - `fill rough WORD ...` compares the roughness of filled parts with that of the original and of the neighborhood. It prints the rows
//!   that contain all of the words.
//!
//! Two other programs fill the same holes if they are available. `CGAL_FILL` is the path of the program that is built from
//! `benches/peers/cgal_fill.cpp`, and `MESHLIB_PYTHON` is the path of a Python with MeshLib. `benches/peers/peers.py holes` builds both and
//! sets the variables.
//!
//! Times are the minimum of several runs of the public function, on values in memory. Distances are divided by the mean length of edges.
//! Two kinds are measured: the distances of points all over the filled part from the original surface (root mean square and maximum), and
//! the distances of the removed vertices from the filled mesh.
//!
//! There is no performance target: the results are compared with those of the peers.

#![allow(clippy::print_stdout, reason = "whoever measures must know what was measured")]

use std::ffi::OsString;
use std::fmt::Write as _;
use std::path::Path;
use std::process::Command;
use std::time::Instant;

use cases::{Case, bumpy_sphere, cases, with_noise};
use judge::{characters, judge};
use maquette::value::{Faces, Mesh};
use maquette::{Error, Progress};
use maquette_nodes::fill::{
    ExemplarOptions, FillMethod, FilledMesh, HoleChoice, Start, Update, fill_holes,
};
use maquette_nodes::mesh::read_mesh;
use nalgebra::Point3;

#[path = "fill/cases.rs"]
mod cases;
#[path = "fill/judge.rs"]
mod judge;

/// The standard deviations of the noise, as fractions of the mean length of edges.
const NOISE: [f64; 2] = [0.05, 0.2];

fn main() {
    // Keep freed memory and use two threads, as an evaluator does.
    maquette::memory::keep_freed();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().expect("two threads");
    pool.install(measure);
}

fn measure() {
    let words: Vec<String> =
        std::env::args().skip(1).filter(|word| !word.starts_with('-')).collect();
    if words.iter().any(|word| word == "rims") {
        return large_rims();
    }
    if words.iter().any(|word| word == "sizes") {
        return sizes();
    }
    if words.iter().any(|word| word == "rough") {
        return roughness(&words);
    }
    fn is_wanted(text: &str, words: &[String]) -> bool {
        words.is_empty() || words.iter().any(|word| text.contains(&word[..]))
    }
    let peers = peers();
    let clean = cases();
    println!(
        "{:36} {:18} {:>9} {:>7} {:>7} {:>7} {:>8} {:>6} {:>5} {:>5} {:>8} {:>5}  warnings",
        "case",
        "method",
        "ms",
        "rms",
        "max",
        "back",
        "back max",
        "open",
        "added",
        "tight",
        "manifold",
        "cross"
    );
    let noisy: Vec<Case> = NOISE
        .iter()
        .flat_map(|&share| clean.iter().map(move |case| with_noise(case, share)))
        .collect();
    for case in clean.iter().chain(&noisy) {
        for (name, method) in methods() {
            if is_wanted(&format!("{} {name}", case.name), &words) {
                report(case, name, &method);
            }
        }
        for (name, command) in &peers {
            if is_wanted(&format!("{} {name}", case.name), &words) {
                fill_by(case, name, command);
            }
        }
    }
    if is_wanted("model classes", &words) {
        model_classes(&clean);
    }
}

/// Returns the names and command lines of the other programs that are available.
fn peers() -> Vec<(&'static str, Vec<OsString>)> {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../benches/peers/meshlib_fill.py");
    let mut peers = Vec::new();
    match std::env::var_os("CGAL_FILL") {
        Some(program) => {
            peers.push(("cgal 1", vec![program.clone(), "1".into()]));
            peers.push(("cgal 2", vec![program, "2".into()]));
        }
        None => println!("skipped: the rows of CGAL, for which CGAL_FILL names no program"),
    }
    match std::env::var_os("MESHLIB_PYTHON") {
        Some(python) => peers.push(("meshlib", vec![python, script.into()])),
        None => println!("skipped: the rows of MeshLib, for which MESHLIB_PYTHON names no Python"),
    }
    peers
}

/// The models in the paper of Kawai, Sato and Yokoya (2008). Each has its name, the number of vertices and of missing vertices, the
/// published time in seconds, and the case in this bench that is similar in kind and size.
const MODELS: [(&str, [u32; 2], f64, &str); 3] = [
    ("A, smooth", [5122, 1094], 1304.0, "holes/smooth_blob"),
    ("B, sharp", [3329, 1432], 186.0, "holes/sharp_nut"),
    ("C, relief", [18610, 667], 4070.0, "holes/rugged_mountain"),
];

/// Prints the times of the default method beside the times that Kawai, Sato and Yokoya report for similar cases (2008, table 1). They
/// report no distances.
fn model_classes(cases: &[Case]) {
    println!(
        "\npublished model, data/missing, seconds on a Xeon of 3.0 GHz; ours of that size, seconds"
    );
    for (model, [data, missing], published, name) in MODELS {
        let Some(case) = cases.iter().find(|case| case.name == name) else { continue };
        let start = Instant::now();
        let filled = fill_all(&case.holed, &FillMethod::default()).expect("a surface");
        let seconds = start.elapsed().as_secs_f64();
        let verdict = judge(case, &filled.mesh);
        let count = case.holed.positions().len();
        println!(
            "{model:10} {data:5}/{missing:4} {published:7.0}; {name:21} {count:5}/{:4} {seconds:6.2}, rms {:.3}, max {:.3}",
            case.truth.positions().len() - count,
            verdict.rms,
            verdict.most
        );
    }
}

fn methods() -> Vec<(&'static str, FillMethod)> {
    let published = ExemplarOptions {
        start: Start::Centroid,
        update: Update::Published,
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

const RUNS: usize = 5;

fn fill_all(mesh: &Mesh, method: &FillMethod) -> Result<FilledMesh, Error> {
    fill_holes(mesh, &HoleChoice::All, method, &Progress::silent())
}

fn report(case: &Case, name: &str, method: &FillMethod) {
    let mut least = f64::INFINITY;
    let mut runs = 0;
    let begin = Instant::now();
    let filled = loop {
        let start = Instant::now();
        let filled = fill_all(&case.holed, method);
        least = least.min(start.elapsed().as_secs_f64());
        runs += 1;
        if runs == RUNS || begin.elapsed().as_secs_f64() > 5.0 {
            break filled;
        }
    };
    match filled {
        Err(error) => println!("{:36} {name:18} {error}", case.name),
        Ok(filled) => {
            let row = row(case, name, 1e3 * least, &filled.mesh);
            println!("{row}  {}", filled.warnings.join("; "));
        }
    }
    if let Some(folder) = std::env::var_os("FILL_OUT") {
        let filled = fill_all(&case.holed, method);
        if let Ok(filled) = filled {
            let file = format!("{}-{name}.obj", case.name).replace(['/', ' '], "_");
            std::fs::write(Path::new(&folder).join(file), obj(&filled.mesh)).expect("a folder");
        }
    }
}

fn row(case: &Case, name: &str, milliseconds: f64, filled: &Mesh) -> String {
    let verdict = judge(case, filled);
    fn yes(is: bool) -> &'static str {
        if is { "yes" } else { "NO" }
    }
    format!(
        "{:36} {name:18} {milliseconds:9.2} {:7.4} {:7.3} {:7.4} {:8.3} {:6} {:5} {:>5} {:>8} {:5}",
        case.name,
        verdict.rms,
        verdict.most,
        verdict.back_rms,
        verdict.back_most,
        verdict.open,
        verdict.added,
        yes(verdict.is_tight),
        yes(verdict.is_manifold),
        verdict.crossings
    )
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

/// Fills the mesh with another program. The command `COMMAND IN OUT SKIP` writes the file OUT, and prints its time in milliseconds.
fn fill_by(case: &Case, name: &str, command: &[OsString]) {
    let folder = std::env::temp_dir();
    fn temporary_file(what: &str, folder: &Path) -> std::path::PathBuf {
        folder.join(format!("fill_{}_{what}", std::process::id()))
    }
    let (input, output) = (temporary_file("in.txt", &folder), temporary_file("out.obj", &folder));
    let mesh = &case.holed;
    let mut text = format!("{} {}\n", mesh.positions().len(), mesh.faces().len());
    mesh.positions().iter().for_each(|p| {
        let _ = writeln!(text, "{:e} {:e} {:e}", p.x, p.y, p.z);
    });
    mesh.faces().iter().for_each(|f| {
        let _ = writeln!(text, "{} {} {}", f[0], f[1], f[2]);
    });
    std::fs::write(&input, text).expect("a folder for temporary files");
    // Tell the other program to skip the outer border if the original mesh has one, because that border is not a hole.
    let skipped = u8::from(case.truth.edges().faces.contains(&1)).to_string();
    let run = Command::new(&command[0])
        .args(&command[1..])
        .args([input.as_os_str(), output.as_os_str(), skipped.as_ref()])
        .output();
    let milliseconds = run.as_ref().ok().and_then(|run| {
        let text = String::from_utf8_lossy(&run.stdout);
        text.trim().parse::<f64>().ok()
    });
    match (milliseconds, std::fs::read(&output)) {
        (Some(milliseconds), Ok(bytes)) => {
            let filled = read_mesh(&bytes, "obj").expect("an OBJ file");
            println!("{}", row(case, name, milliseconds, &filled));
        }
        _ => println!("{:36} {name:18} skipped: {} gives nothing", case.name, command[0].display()),
    }
    let _ = (std::fs::remove_file(&input), std::fs::remove_file(&output));
}

/// Prints the times of the method `Flat` for holes with many edges. CGAL's manual reports such times, without refinement.
fn large_rims() {
    for count in [565u32, 774, 967, 2000, 7657] {
        let mesh = band(count);
        let rim = HoleChoice::Loops(vec![1]);
        let start = Instant::now();
        let filled = fill_holes(&mesh, &rim, &FillMethod::Flat, &Progress::silent());
        let filled = filled.expect("a band has holes");
        let seconds = start.elapsed().as_secs_f64();
        let added = filled.mesh.positions().len() - mesh.positions().len();
        println!(
            "rim of {count:5} edges: {seconds:7.3} s, {added} vertices added; {}",
            filled.warnings.join("; ")
        );
    }
}

/// Prints how the time of a thin plate grows with the number of added vertices.
fn sizes() {
    for frequency in [23, 45, 90, 180] {
        let case = bumpy_sphere(frequency);
        let mut least = f64::INFINITY;
        let mut added = 0;
        for _ in 0..RUNS {
            let start = Instant::now();
            let filled = fill_all(&case.holed, &FillMethod::ThinPlate).expect("a sphere");
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

/// Prints the roughness of filled parts, relative to that of the original and of the neighborhood.
fn roughness(words: &[String]) {
    let words: Vec<&String> = words.iter().filter(|word| *word != "rough").collect();
    println!(
        "{:28} {:13} {:24} {:>9}  bends at 10, 25, 50, 75 and 90 of a hundred",
        "case", "method", "share of", "roughness"
    );
    for case in cases() {
        for (name, method) in methods() {
            let text = format!("{} {name}", case.name);
            if !words.iter().all(|word| text.contains(&word[..])) {
                continue;
            }
            let filled = fill_all(&case.holed, &method).expect("a surface");
            let all = characters(&case, &filled.mesh);
            let what = ["truth", "neighborhood", "truth by neighborhood"];
            for (what, character) in what.into_iter().zip(all) {
                let bends: String =
                    character.bends.iter().map(|share| format!(" {share:5.2}")).collect();
                println!(
                    "{:28} {name:13} {what:24} {:9.2} {bends}",
                    case.name, character.roughness
                );
            }
        }
    }
}

/// Returns a band of faces along a wavy closed curve. Its inner border has `count` edges.
fn band(count: u32) -> Mesh {
    fn border_point(k: u32, out: f64, count: u32) -> Point3<f64> {
        let angle = std::f64::consts::TAU * f64::from(k) / f64::from(count);
        let radius = (1.0 + 0.2 * libm::sin(5.0 * angle) + 0.1 * libm::cos(11.0 * angle)) * out;
        let height = 0.2 * libm::sin(3.0 * angle) + 0.1 * libm::cos(7.0 * angle);
        Point3::new(radius * libm::cos(angle), radius * libm::sin(angle), height)
    }
    let points: Vec<_> = (0..count)
        .map(|k| border_point(k, 1.02, count))
        .chain((0..count).map(|k| border_point(k, 1.0, count)))
        .collect();
    let faces = (0..count).flat_map(|k| {
        let next = (k + 1) % count;
        [[k, next, count + k], [next, count + next, count + k]]
    });
    Mesh::new(points, Faces::triangles(faces.collect())).expect("a band")
}
