//! Measures the time that a batch adds to the time of its tasks, and the peak memory of the program. Batches of up to a thousand tasks run
//! the example graph `doll.ron`; batches of up to ten thousand tasks run a small graph. Each batch runs three times: without cached
//! results, again right away, and again without changes. The second run reads the outputs to check them, because they are too new to be
//! trusted by their modification times.
//!
//! `cargo bench -p maquette-program --bench batch`

#![allow(clippy::print_stdout, reason = "the table goes to whoever measures")]

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

const GRAPHS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../graphs");

const SMALL: &str = r#"Graph(
    format: 1,
    params: { "far": Number(default: 0.0, unit: "mm", doc: "") },
    nodes: {
        "mesh": ReadMesh(path: "small.obj"),
        "moved": Transform(mesh: "mesh", translate: (Param("far"), 0, 0)),
    },
    outputs: { "moved.ply": "moved" },
)
"#;

fn main() {
    let folder = tempfile::tempdir().expect("a folder");
    let project = folder.path();
    fs::write(project.join("maquette.toml"), "").expect("a file");
    fs::copy(Path::new(GRAPHS).join("doll.ron"), project.join("doll.ron")).expect("a file");
    fs::create_dir(project.join("doll")).expect("a folder");
    for name in ["color.png", "range.pcd", "camera.json"] {
        let from = Path::new(GRAPHS).join("doll").join(name);
        fs::copy(from, project.join("doll").join(name)).expect("a file");
    }
    fs::write(project.join("small.ron"), SMALL).expect("a file");
    let cube = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";
    fs::write(project.join("small.obj"), cube).expect("a file");
    for (graph, name, count, step) in [
        ("doll", "growth", 100, 0.3),
        ("doll", "growth", 1_000, 0.03),
        ("small", "far", 100, 1.0),
        ("small", "far", 1_000, 1.0),
        ("small", "far", 10_000, 1.0),
    ] {
        let values = (0..count).map(|nth| format!("{:.2}", f64::from(nth) * step));
        let values = Vec::from_iter(values).join(", ");
        let levels = if graph == "doll" { "set: { \"levels\": 0 }, " } else { "" };
        let text = format!(
            "Sweep(graph: \"{graph}.ron\", over: Values(\"{name}\", [{values}]), {levels}picture: (size: (160, 120)))"
        );
        fs::write(project.join("many.ron"), text).expect("a file");
        let out = format!("{graph}-{count}");
        for when in ["nothing is known", "first run after", "nothing has changed"] {
            let (seconds, memory) = run(project, &out);
            println!(
                "{count:>6} tasks of {graph:<5}, {when:<19}: {seconds:7.2} s, {:6.2} ms a task, {memory:4} MB at most",
                seconds * 1e3 / f64::from(count)
            );
        }
    }
}

/// Runs a batch, and returns its time in seconds and its peak memory in MB.
fn run(project: &Path, out: &str) -> (f64, u64) {
    let start = Instant::now();
    let mut child = Command::new(env!("CARGO_BIN_EXE_maquette"))
        .args(["batch", "many.ron", "--out", out])
        .env("MAQUETTE_CACHE", project.join("cache"))
        .current_dir(project)
        .stdout(Stdio::null())
        .spawn()
        .expect("the program starts");
    let status = format!("/proc/{}/status", child.id());
    let mut memory = 0;
    loop {
        if let Some(ended) = child.try_wait().expect("it is ours") {
            assert!(ended.success());
            return (start.elapsed().as_secs_f64(), memory / 1000);
        }
        let told = fs::read_to_string(&status).unwrap_or_default();
        let peak = told.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        let peak = peak.and_then(|it| it.trim().trim_end_matches("kB").trim().parse().ok());
        memory = peak.unwrap_or(memory);
        std::thread::sleep(Duration::from_millis(5));
    }
}
