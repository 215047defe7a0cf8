//! Measures the time and memory to find the control mesh of a subdivision surface that passes through given vertices. Uses two threads, and
//! includes all preparation. The meshes are those of the benchmarks of other programs (peers) if they exist, otherwise similar tori. `cargo
//! bench -p maquette-tests --bench interpolate -- WORD` runs the rows whose names contain the word. Each row of the table shows its target
//! in milliseconds (`bar`).

#![allow(clippy::print_stdout, reason = "the table goes to whoever measures")]

use std::cell::RefCell;
use std::hint::black_box;
use std::path::Path;
use std::time::Instant;

use maquette::Progress;
use maquette::format::camera;
use maquette::value::{Mesh, TriangleTree};
use maquette_nodes::mesh::read_mesh;
use maquette_nodes::range::{read_capture, triangulate};
use maquette_nodes::subdivision::{
    Foot, InterpolateOptions, Plan, Scheme, Solver, Subdivision, crease, fit_subdivision,
    interpolate, simplify, subdivide,
};

#[path = "shared/peers.rs"]
mod peers;

fn main() {
    // Keep freed memory, as an evaluator does.
    maquette::memory::keep_freed();
    let words: Vec<_> = std::env::args().skip(1).filter(|word| !word.starts_with('-')).collect();
    let table = Table { words };
    println!("{:44} {:>9} {:>9} {:>7} {:>9}", "milliseconds", "median", "least", "bar", "peak MB");
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().expect("two threads");
    pool.install(|| {
        interpolate_files(&table);
        sizes(&table);
        interpolate_published(&table);
        fit(&table);
        edit(&table);
    });
}

/// Interpolates the vertices of the peers' meshes, to a millionth of the diagonal.
fn interpolate_files(table: &Table) {
    for (scheme, name, sides, bar) in [
        (Scheme::Loop, "int_tri", 3, Some(5.0)),
        (Scheme::CatmullClark, "int_quad", 4, Some(8.0)),
        (Scheme::DooSabin, "int_quad", 4, None),
    ] {
        let mesh = peers::load(name, sides).unwrap_or_else(|| torus(sides, 20_000));
        let name = format!("{scheme:?}, {} vertices", mesh.positions().len());
        table.row(&name, bar, 31, || interpolate_mesh(&mesh, scheme));
    }
}

/// Interpolates the vertices of tori, each with ten times as many vertices as the previous one.
fn sizes(table: &Table) {
    for (scheme, sides) in [(Scheme::Loop, 3), (Scheme::CatmullClark, 4), (Scheme::DooSabin, 4)] {
        for (count, runs) in [(2_000, 31), (20_000, 31), (200_000, 11), (2_000_000, 3)] {
            let name = format!("size: {scheme:?}, torus of {count} vertices");
            if table.has(&name) {
                let mesh = torus(sides, count);
                table.row(&name, None, runs, || interpolate_mesh(&mesh, scheme));
            }
        }
    }
}

fn interpolate_mesh(mesh: &Mesh, scheme: Scheme) -> Mesh {
    let found = interpolate(mesh, scheme, &InterpolateOptions::default(), &[], &Progress::silent());
    let found = found.expect("a surface");
    assert!(found.settled, "the surface passes through the vertices");
    found.shape
}

/// Interpolates the vertices of the doll in the example graphs, to 1e-5 of the diagonal, by the published iteration with nearest points.
fn interpolate_published(table: &Table) {
    let mesh = read_mesh(&example("coarse.obj"), "obj").expect("a mesh");
    for (scheme, bar) in
        [(Scheme::Loop, Some(300.0)), (Scheme::CatmullClark, None), (Scheme::DooSabin, None)]
    {
        let mut options = InterpolateOptions::default();
        (options.how.foot, options.how.solver) = (Foot::Closest, Solver::Plain);
        options.how.tolerance = 1e-5;
        let name = format!("nearest feet: {scheme:?}, {} vertices", mesh.positions().len());
        table.row(&name, bar, 5, || {
            let found = interpolate(&mesh, scheme, &options, &[], &Progress::silent());
            let found = found.expect("a surface");
            assert!(found.settled, "the surface passes through the vertices");
            found.shape
        });
    }
}

/// Reads a file of the doll in the example graphs.
fn example(name: &str) -> Vec<u8> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../graphs/doll");
    std::fs::read(folder.join(name)).expect("a file of the example graphs")
}

/// Fits a subdivision surface to the doll's scan, with a twentieth of its triangles, and prints the distances between the two.
fn fit(table: &Table) {
    let name = "fit of the doll's scan";
    if !table.has(name) {
        return;
    }
    let [color, range, camera] = ["color.png", "range.pcd", "camera.json"].map(example);
    let camera = camera::read(&camera).expect("a camera");
    let (unit, axes) = Default::default();
    let (_, range) =
        read_capture(&color, &range, "pcd", Some(&camera), unit, axes).expect("a capture");
    let scan = triangulate(&range, 6.0, 85.0, 20).expect("a grid with a camera");
    let creased = crease(&scan, 40.0, 10.0);
    let points = scan.positions();
    let target = scan.faces().len() / 20;
    let simplified = || simplify(&creased, target, &Progress::silent()).expect("a mesh");
    table.row("fit of the doll's scan: simplification", None, 3, simplified);
    let coarse = simplified();
    let fitted = || fit_subdivision(&coarse, points, 1e-3, 6, &Progress::silent());
    table.row(name, None, 3, fitted);
    let control = fitted().expect("points near the mesh").mesh;
    let (boundary, creases, corners) = Default::default();
    let scheme = Scheme::Loop;
    let how = Subdivision { scheme, levels: 3, limit: true, boundary, creases, corners };
    let surface = subdivide(&control, how).expect("a surface");
    println!("  {} triangles for {}", control.faces().len(), scan.faces().len());
    for (what, mesh, points) in
        [("scan to surface", &surface, points), ("surface to scan", &scan, surface.positions())]
    {
        let hits = TriangleTree::new(mesh).nearest_to_all(points).into_iter().flatten();
        let mut distances: Vec<_> = hits.map(|hit| hit.distance_sq.sqrt()).collect();
        distances.sort_by(f64::total_cmp);
        let [half, most, nearly, all] = [0.5, 0.95, 0.99, 1.0]
            .map(|share: f64| distances[((distances.len() - 1) as f64 * share) as usize]);
        println!(
            "  {what}: 50 % within {half:.3} mm, 95 % {most:.3}, 99 % {nearly:.3}, all {all:.3}"
        );
    }
}

/// Moves ten control points of a mesh of about 6 000 faces, and updates the surface after four steps.
fn edit(table: &Table) {
    for (scheme, sides) in [(Scheme::CatmullClark, 4), (Scheme::Loop, 3)] {
        let mesh = torus(sides, if sides == 4 { 6_000 } else { 2_900 });
        let (boundary, creases, corners) = Default::default();
        let how = Subdivision { scheme, levels: 4, limit: false, boundary, creases, corners };
        let plan = Plan::new(&mesh, how).expect("a surface");
        let live = RefCell::new(plan.moving_vertices(&mesh).expect("the plan's mesh"));
        let changed: Vec<_> = (100..110).map(|k| (k, mesh.positions()[k as usize])).collect();
        let name = format!("edit: {scheme:?}, 10 control points, 4 steps");
        table.row(&name, None, 31, || live.borrow_mut().update(&changed));
        let name = format!("edit: {scheme:?}, all of them");
        table.row(&name, None, 31, || plan.apply(&mesh));
    }
}

/// A table that prints only the rows whose names contain one of the words.
struct Table {
    words: Vec<String>,
}

impl Table {
    fn has(&self, name: &str) -> bool {
        self.words.is_empty() || self.words.iter().any(|word| name.contains(&**word))
    }

    /// Prints a row. Runs the work once to measure its peak memory, and then `runs` times to measure its time.
    fn row<T>(&self, name: &str, bar: Option<f64>, runs: usize, run: impl Fn() -> T) {
        if !self.has(name) {
            return;
        }
        let before = memory("VmRSS");
        // On Linux, reset the peak memory of this process.
        let _ = std::fs::write("/proc/self/clear_refs", "5");
        drop(black_box(run()));
        let peak = memory("VmHWM") - before;
        let mut times: Vec<_> = (0..runs)
            .map(|_| {
                let start = Instant::now();
                let result = black_box(run());
                let time = 1e3 * start.elapsed().as_secs_f64();
                drop(result);
                time
            })
            .collect();
        times.sort_by(f64::total_cmp);
        let bar = bar.map_or(String::new(), |bar| bar.to_string());
        let (median, least) = (times[runs / 2], times[0]);
        println!("{name:44} {median:9.2} {least:9.2} {bar:>7} {peak:9.0}");
    }
}

/// Returns the memory figure with this name in `/proc/self/status`, in MB. Returns 0 if the system does not report it.
fn memory(name: &str) -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(':'));
    let kilobytes = line.and_then(|line| line.trim().split(' ').next()?.parse::<f64>().ok());
    kilobytes.unwrap_or(0.0) / 1024.0
}

/// Creates a bumpy torus of about `count` vertices, whose faces have `sides` sides.
fn torus(sides: usize, count: u32) -> Mesh {
    let rows = (f64::from(count) / 2.0).sqrt() as u32;
    peers::torus(sides, [rows, count / rows], 0.01)
}
