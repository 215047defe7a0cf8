//! Predictions before a run: `run -n` and `check --preflight` read no large file, and their predictions agree with the run.

use std::fs::File;
use std::io::{Seek, SeekFrom, Write};
use std::path::Path;

use serde_json::Value as Json;

use crate::output::stderr_of;
use crate::project::{GRAPHS, LIFTED, Project};

/// A LAS file with three points of 30 bytes, in the folder of test data.
const SURVEY: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/data/formats/bytes.las");

/// The number of points of the large file.
const POINTS: u64 = 100_000_000;

const CLOUD: &str = r#"Graph(
    format: 1,
    nodes: {
        "points": ReadPoints(path: "a.las"),
        "moved": Transform(mesh: "points", translate: (1, 0, 0)),
    },
    outputs: { "out.ply": "moved" },
)
"#;

/// Makes a project whose graph reads a LAS file with a header for 100 million points, 3 GB, of which the disk has only the header.
fn project_with_large_file() -> Project {
    let project = Project::with_files(&[("doll.ron", CLOUD), ("maquette.toml", "")]);
    let survey = std::fs::read(SURVEY).unwrap();
    let start = u32::from_le_bytes(survey[96..100].try_into().unwrap());
    let mut file = File::create(project.folder().join("a.las")).unwrap();
    file.write_all(&survey[..start as usize]).unwrap();
    file.seek(SeekFrom::Start(107)).unwrap();
    file.write_all(&(POINTS as u32).to_le_bytes()).unwrap();
    file.set_len(u64::from(start) + 30 * POINTS).unwrap();
    project
}

/// Runs a command. Returns its exit code, its stdout, its stderr and the number of bytes that it has read, which is 0 on other systems than
/// Linux.
fn run(project: &Project, words: &[&str]) -> (Option<i32>, String, String, u64) {
    let mut command = project.command(words);
    command.stdout(std::process::Stdio::piped()).stderr(std::process::Stdio::piped());
    let child = command.spawn().unwrap();
    let read = bytes_read_by(child.id());
    let output = child.wait_with_output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    (output.status.code(), text, stderr_of(&output), read)
}

/// Waits until a process is over, and returns the number of bytes that it has read.
#[cfg(target_os = "linux")]
fn bytes_read_by(process: u32) -> u64 {
    loop {
        let state = std::fs::read_to_string(format!("/proc/{process}/stat")).unwrap();
        // The state follows the name in parentheses. `Z` is a process that is over and not yet waited for.
        if state.rsplit(") ").next().unwrap().starts_with('Z') {
            let counts = std::fs::read_to_string(format!("/proc/{process}/io")).unwrap();
            let read = counts.lines().find_map(|line| line.strip_prefix("rchar: ")).unwrap();
            return read.parse().unwrap();
        }
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
}

#[cfg(not(target_os = "linux"))]
fn bytes_read_by(_: u32) -> u64 {
    0
}

/// The number of bytes that a prediction may read: graphs, headers and records, but not the large file.
const MAX_READ: u64 = 8 << 20;

fn json(text: &str) -> Json {
    serde_json::from_str(text).unwrap_or_else(|error| panic!("{error}: {text}"))
}

#[test]
fn a_forecast_does_not_read_a_large_file() {
    let project = project_with_large_file();
    let (code, text, _, read) = run(&project, &["run", "doll.ron", "-n"]);
    assert_eq!(code, Some(0));
    assert_eq!(
        text,
        "runs      points  not computed before\nruns      moved   not computed before\n"
    );
    assert!(read < MAX_READ, "{read} bytes were read");
    let (_, _, _, read) = run(&project, &["why", "doll.ron", "moved"]);
    assert!(read < MAX_READ, "{read} bytes were read");
}

#[test]
fn a_preflight_reads_the_header_of_a_large_file_only() {
    let project = project_with_large_file();
    let words = ["check", "--preflight", "doll.ron", "--json", "--max-memory", "100GB"];
    let (code, text, error, read) = run(&project, &words);
    assert_eq!((code, &error[..]), (Some(0), ""), "{text}");
    assert!(read < MAX_READ, "{read} bytes were read");
    let document = json(&text);
    let nodes = &document["preflight"][0]["nodes"];
    let points = &nodes[0];
    assert_eq!(points["points"], POINTS as f64);
    assert_eq!(points["size_is"], "exact");
    assert_eq!(points["seconds"], Json::Null, "no such node has run");
    assert!(points["memory"].as_f64().unwrap() > 5.4e9, "the file and its points: {points}");
    assert_eq!(
        (&nodes[1]["points"], &nodes[1]["size_is"]),
        (&(POINTS as f64).into(), &"predicted".into())
    );
    let peak = document["preflight"][0]["peak"].as_f64().unwrap();
    assert!(peak >= points["memory"].as_f64().unwrap(), "{text}");
}

#[test]
fn a_size_that_does_not_fit_is_refused_with_the_size_that_does() {
    let project = project_with_large_file();
    let words = ["check", "--preflight", "doll.ron", "--max-memory", "1GB"];
    let (code, text, error, _) = run(&project, &words);
    assert_eq!(code, Some(1), "{text}");
    assert!(error.contains("`points` cannot be computed: it would need 11 GB"), "{error}");
    assert!(
        error.contains(
            "crop or thin the points before they are read, give it at most 9 200 000 points"
        ),
        "{error}"
    );
    assert!(text.contains("points  ReadPoints  runs   100 000 000 points  exact"), "{text}");
    assert!(text.contains("checked 1 graph: 2 errors"), "{text}");
}

#[test]
fn a_run_that_needs_too_much_memory_says_which_input_fits() {
    let fine = LIFTED.replace(
        r#"Transform(mesh: "mesh", translate: (0, Param("lift"), 0))"#,
        r#"Subdivide(mesh: "mesh", scheme: Loop, levels: 10)"#,
    );
    let fine = fine.replace(
        r#"params: { "lift": Number(default: 5.0, min: 0.0, max: 40.0, doc: "Lift.") },"#,
        "",
    );
    let project = Project::with_tetrahedron(&fine);
    let refused = "choose fewer `levels`, give it at most ";
    let (code, _, error, _) = run(&project, &["run", "doll.ron", "--max-memory", "200MB"]);
    assert_eq!(code, Some(1));
    assert!(error.contains(refused), "{error}");
    let (code, _, error, _) =
        run(&project, &["check", "--preflight", "doll.ron", "--max-memory", "200MB"]);
    assert_eq!(code, Some(1));
    assert!(error.contains(refused), "{error}");
}

/// Compares the predicted memory of results with that of a run. Guesses are not compared.
fn check(name: &str) {
    let project = Project::with_files(&[]);
    let graph = Path::new(GRAPHS).join("nodes").join(format!("{name}.ron"));
    let graph = graph.to_str().unwrap();
    let (code, text, error, _) = run(&project, &["check", "--preflight", graph, "--json"]);
    assert_eq!(code, Some(0), "{error}");
    let predicted = json(&text)["preflight"][0]["nodes"].clone();
    let (code, text, error, _) = run(&project, &["run", graph, "--json", "--out", "out"]);
    assert_eq!(code, Some(0), "{error}");
    let run_nodes = json(&text)["nodes"].clone();
    let mut compared = 0;
    for node in predicted.as_array().unwrap().iter().filter(|node| node["size_is"] != "a guess") {
        let Some(told) = node["bytes"].as_f64() else { continue };
        let found = run_nodes.as_array().unwrap().iter().find(|it| it["name"] == node["name"]);
        let found = found.unwrap()["bytes"].as_f64().unwrap();
        assert!(told <= 2.0 * found && found <= 2.0 * told, "{name}: {node}, found {found}");
        compared += 1;
    }
    assert!(compared > 0, "{name}: {predicted}");
    // Everything is cached now. What the cache knows is exact.
    let (_, text, _, _) = run(&project, &["check", "--preflight", graph, "--json"]);
    for node in json(&text)["preflight"][0]["nodes"].as_array().unwrap() {
        let found = run_nodes.as_array().unwrap().iter().find(|it| it["name"] == node["name"]);
        if node["state"] == "cached" {
            assert_eq!(node["bytes"].as_f64(), found.unwrap()["bytes"].as_f64(), "{name}: {node}");
        }
    }
}

#[test]
fn predicted_sizes_of_read_files_agree_with_the_run() {
    ["ReadPoints", "ReadCapture", "ReadImage", "ReadRange"].into_iter().for_each(check);
}

#[test]
fn predicted_sizes_of_pictures_and_grids_agree_with_the_run() {
    ["Threshold", "CombineMasks", "KeepCells", "Denoise"].into_iter().for_each(check);
}

#[test]
fn predicted_sizes_of_surfaces_agree_with_the_run() {
    ["Primitive", "GaussianSurface", "Tessellate"].into_iter().for_each(check);
}

#[test]
fn times_are_predicted_from_earlier_runs() {
    let fine = r#"Graph(
    format: 1,
    params: { "levels": Integer(default: 5, min: 0, max: 8, doc: "Levels.") },
    nodes: {
        "ball": Primitive(shape: Sphere(radius: 10.0, sides: 64)),
        "fine": Subdivide(mesh: "ball", scheme: CatmullClark, levels: Param("levels")),
    },
    outputs: { "out.ply": "fine" },
)
"#;
    let project = Project::with_files(&[("doll.ron", fine), ("maquette.toml", "")]);
    fn seconds(project: &Project) -> Option<f64> {
        let words = ["check", "--preflight", "doll.ron", "--json", "--set", "levels=4"];
        let (_, text, error, _) = run(project, &words);
        assert_eq!(error, "");
        let node = json(&text)["preflight"][0]["nodes"][1].clone();
        assert_eq!((&node["faces"], &node["state"]), (&393_216.0.into(), &"runs".into()));
        node["seconds"].as_f64()
    }
    assert_eq!(seconds(&project), None);
    let (code, _, error, _) = run(&project, &["run", "doll.ron"]);
    assert_eq!(code, Some(0), "{error}");
    let predicted = seconds(&project).unwrap();
    assert!(predicted > 0.0);
}
