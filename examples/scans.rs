//! Makes a project with many scans for `maquette batch`: the doll's two captures, each as seen by several noisy scanners, and your own
//! captures. A capture is a folder with `range.pcd`, `color.png` (or `colour.png`) and optionally `camera.json`.
//!
//! `cargo run --release --example scans -- FOLDER [CAPTURE..]`
#![allow(clippy::print_stdout, reason = "this program talks to its user")]

use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};

use maquette::format::pcd;
use maquette::rng::Random;
use maquette::value::RangeImage;
use maquette::{Options, Run, Session, Settings};

/// Number of simulated scanners for each capture of the doll.
const SCANNERS: u64 = 5;

/// Standard deviation of the scanners' noise along a line of sight, in mm.
const NOISE: f64 = 0.4;

const SWEEP: &str = r#"// Which bumps are noise? Each scan, cleaned with four depths.
Sweep(
    graph: "cleanup.ron",
    over: Product([Files("scans/*", name: "scan"), Values("noise", [0, 1, mm(3), 8])]),
    set: { "jump": 8.0 },
    out: "{scan}/{noise}",
    picture: ("model.glb", camera: (20, 10)),
)
"#;

fn main() -> Result<(), Box<dyn Error>> {
    let mut words = std::env::args_os().skip(1).map(PathBuf::from);
    let folder = words.next().ok_or("write the folder of the new project behind `--`")?;
    let graphs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../graphs");
    fs::create_dir_all(&folder)?;
    fs::write(folder.join("maquette.toml"), "")?;
    fs::write(folder.join("cleanup.sweep.ron"), SWEEP)?;
    fs::copy(graphs.join("cleanup.ron"), folder.join("cleanup.ron"))?;
    let (doll, left) = (graphs.join("doll"), graphs.join("doll/left"));
    for (name, capture, range) in [("front", &doll, "range.pcd"), ("left", &left, "depth.png")] {
        let seen = range_of(&capture.join(range))?;
        for seed in 1..=SCANNERS {
            let scan = scan_folder(&folder, &format!("doll-{name}-{seed}"), capture)?;
            fs::write(scan.join("range.pcd"), pcd::encode(&noisy(&seen, seed)?)?)?;
        }
    }
    for capture in words {
        let name = capture.file_name().ok_or("a capture is a folder")?.to_string_lossy();
        let scan = scan_folder(&folder, &name, &capture)?;
        fs::write(scan.join("range.pcd"), fs::read(capture.join("range.pcd"))?)?;
    }
    println!("maquette batch {}", folder.join("cleanup.sweep.ron").display());
    Ok(())
}

/// Makes a folder for a scan, with the picture and the camera of a capture, and returns its path.
fn scan_folder(folder: &Path, name: &str, capture: &Path) -> Result<PathBuf, Box<dyn Error>> {
    let scan = folder.join("scans").join(name);
    fs::create_dir_all(&scan)?;
    let picture = ["color.png", "colour.png"].map(|name| capture.join(name));
    let picture = picture.iter().find(|path| path.is_file()).ok_or("a capture has a color.png")?;
    fs::write(scan.join("color.png"), fs::read(picture)?)?;
    if let Ok(camera) = fs::read_to_string(capture.join("camera.json")) {
        fs::write(scan.join("camera.json"), camera.replace("colour.png", "color.png"))?;
    }
    Ok(scan)
}

fn range_of(file: &Path) -> Result<RangeImage, Box<dyn Error>> {
    let mut session = Session::new(maquette_nodes::PACKS, &Settings::in_memory())?;
    let name = file.file_name().unwrap_or_default().to_string_lossy();
    let graph = file.with_file_name("scans.ron");
    let text = format!(
        "Graph(format: 1, nodes: {{ \"scan\": ReadRange(path: \"{name}\") }}, outputs: {{ \"range.pcd\": \"scan\" }})"
    );
    let checked = session.load(&graph, &Options::default().with_text(&graph, text));
    let graph = checked.graph.ok_or_else(|| checked.diagnostics[0].to_text(false))?;
    let done =
        session.run(&graph, &Run::default()).map_err(|problems| problems[0].to_text(false))?;
    Ok(done.get::<RangeImage>("scan")?.clone())
}

/// Returns the range image with random noise along each line of sight.
fn noisy(range: &RangeImage, seed: u64) -> Result<RangeImage, Box<dyn Error>> {
    let mut random = Random(seed);
    // The sum of twelve uniform numbers from 0 to 1 is nearly normal, with a standard deviation of 1.
    fn normal(random: &mut Random) -> f64 {
        (0..12).map(|_| random.even()).sum::<f64>() - 6.0
    }
    let points = range.points().iter().map(|point| {
        let distance = point.coords.norm();
        let factor =
            if distance > 0.0 { 1.0 + NOISE * normal(&mut random) / distance } else { 1.0 };
        (point.coords * factor).into()
    });
    Ok(range.with_points(points.collect())?)
}
