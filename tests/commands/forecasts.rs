//! `run -n`, `batch -n` and `why` predict a run exactly. This includes results that the cache has dropped, and large files, which the
//! commands do not read.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use crate::project::{Project, TETRAHEDRON};

const GRAPH: &str = r#"Graph(
    format: 1,
    params: { "lift": Number(default: 5.0, min: 0.0, max: 40.0, doc: "Lift.") },
    nodes: {
        "mesh": ReadMesh(path: "tet.obj"),
        "lifted": Transform(mesh: "mesh", translate: (0, Param("lift"), 0)),
        "other": Transform(mesh: "mesh", translate: (1, 0, 0)),
    },
    outputs: { "out.obj": "lifted", "other.obj": "other" },
)
"#;

fn project() -> Project {
    let project = Project::with_tetrahedron(GRAPH);
    wait();
    project
}

/// Runs a command; returns the state and name of each node or task that it prints, such as `cached lifted`, and the whole text.
fn forecast(project: &Project, words: &[&str]) -> (Vec<String>, String) {
    let words = [words, &["--cache", "cache"]].concat();
    let output = project.maquette(&words);
    let text = String::from_utf8(output.stdout).unwrap();
    let lines = text
        .lines()
        .map(|line| {
            let words: Vec<_> = line.split_whitespace().take(2).collect();
            words.join(" ")
        })
        .collect();
    (lines, text)
}

/// Lists the cache files that contain results.
fn results(project: &Project) -> Vec<PathBuf> {
    fn files(
        folder: &Path,
    ) -> std::iter::Flatten<std::iter::Flatten<std::result::IntoIter<fs::ReadDir>>> {
        fs::read_dir(folder).into_iter().flatten().flatten()
    }
    let homes = files(&project.folder().join("cache")).map(|home| home.path());
    homes
        .flat_map(|home| files(&home.join("entries")).map(|file| file.path()).collect::<Vec<_>>())
        .collect()
}

/// Removes the results from the cache and keeps its other files.
fn drop_results(project: &Project) {
    let dropped = results(project);
    assert!(!dropped.is_empty());
    dropped.iter().for_each(|file| fs::remove_file(file).unwrap());
}

/// Waits until the modification time of a file that is written next differs from those of existing files.
fn wait() {
    std::thread::sleep(Duration::from_millis(150));
}

#[test]
fn what_the_cache_has_dropped_is_told_if_it_is_needed() {
    let project = project();
    forecast(&project, &["run", "doll.ron"]);
    wait();
    let cached = ["cached mesh", "cached lifted", "cached other"].map(str::to_owned);
    assert_eq!(forecast(&project, &["run", "doll.ron", "-n"]).0, cached);
    assert!(forecast(&project, &["why", "doll.ron", "lifted"]).1.contains("`lifted` does not run"));
    drop_results(&project);
    // All outputs exist, so no result is needed.
    assert_eq!(forecast(&project, &["run", "doll.ron", "-n"]).0, cached);
    let (_, why) = forecast(&project, &["why", "doll.ron", "lifted"]);
    assert!(why.starts_with("`lifted` runs: "), "{why}");
    fs::remove_file(project.folder().join("out/doll/out.obj")).unwrap();
    let (lines, text) = forecast(&project, &["run", "doll.ron", "-n"]);
    assert_eq!(lines, ["runs mesh", "runs lifted", "cached other"], "{text}");
    // The run does what was predicted.
    let (_, text) = forecast(&project, &["run", "doll.ron"]);
    assert!(text.contains("computed  lifted") && text.contains("cached    other"), "{text}");
}

#[test]
fn a_batch_knows_what_the_cache_has_dropped() {
    let project = project();
    let batch = ["batch", "doll.ron", "--sweep", "lift=1", "--out", "all"];
    forecast(&project, &batch);
    wait();
    let outputs = fs::read_dir(project.folder().join("all"))
        .unwrap()
        .map(|folder: std::io::Result<fs::DirEntry>| folder.unwrap().path().join("out.obj"));
    fs::remove_file(outputs.into_iter().find(|it| it.exists()).unwrap()).unwrap();
    assert!(
        forecast(&project, &[&batch[..], &["-n"]].concat()).1.contains("; 0 nodes, 0 of them new"),
        "{}",
        forecast(&project, &[&batch[..], &["-n"]].concat()).1
    );
    drop_results(&project);
    assert!(
        forecast(&project, &[&batch[..], &["-n"]].concat()).1.contains("; 2 nodes, 2 of them new"),
        "{}",
        forecast(&project, &[&batch[..], &["-n"]].concat()).1
    );
}

#[test]
fn a_large_file_is_not_read_for_a_forecast() {
    let project = project();
    let large = project.folder().join("tet.obj");
    forecast(&project, &["run", "doll.ron"]);
    forecast(&project, &["batch", "doll.ron", "--sweep", "lift=1"]);
    fs::File::create(&large).unwrap().set_len(50 << 30).unwrap();
    let start = Instant::now();
    for words in [&["run", "doll.ron", "-n"][..], &["why", "doll.ron", "mesh"]] {
        let (_, text) = forecast(&project, words);
        assert!(text.contains("file tet.obj may have changed and was not read"), "{text}");
        assert!(text.contains("may run"), "{text}");
    }
    let (_, text) = forecast(&project, &["batch", "doll.ron", "--sweep", "lift=1", "-n"]);
    assert!(text.contains("`tet.obj` may have changed and was not read"), "{text}");
    // Reading a file of 50 GB would take minutes.
    assert!(start.elapsed() < Duration::from_secs(20), "{:?}", start.elapsed());
}

/// A graph that lifts a mesh, which is its input.
const FUNCTION: &str = r#"Graph(
    format: 1,
    params: { "lift": Number(default: 5.0, min: 0.0, max: 40.0, doc: "Lift.") },
    inputs: { "mesh": Mesh(doc: "It.") },
    nodes: { "lifted": Transform(mesh: "mesh", translate: (0, Param("lift"), 0)) },
    outputs: { "out": "lifted" },
)
"#;

#[test]
fn a_large_file_at_an_input_is_not_read_for_a_forecast() {
    let project = project();
    project.save(FUNCTION);
    let sweep = "Sweep(graph: \"doll.ron\", over: Files(\"*.obj\", input: \"mesh\"))";
    fs::write(project.folder().join("all.sweep.ron"), sweep).unwrap();
    fn large(bytes: u64, project: &Project) {
        let file = fs::File::create(project.folder().join("large.obj")).unwrap();
        file.set_len(bytes).unwrap();
    }
    large(50 << 30, &project);
    let start = Instant::now();
    let input = ["--input", "mesh=large.obj"];
    for before in [false, true] {
        let unread = match before {
            false => "not computed before",
            true => "file large.obj may have changed and was not read",
        };
        for words in [&["run", "doll.ron", "-n"][..], &["why", "doll.ron", "lifted"]] {
            let (_, text) = forecast(&project, &[words, &input].concat());
            assert!(text.contains(unread), "{words:?}: {text}");
        }
        let (lines, text) = forecast(&project, &["batch", "all.sweep.ron", "-n"]);
        assert_eq!(lines.len(), 3, "{text}");
        assert!(text.contains("2 of 2 tasks would run"), "{text}");
        forecast(&project, &["run", "doll.ron", "--input", "mesh=tet.obj"]);
    }
    // Reading a file of 50 GB would take minutes.
    assert!(start.elapsed() < Duration::from_secs(30), "{:?}", start.elapsed());
    let (_, text) = forecast(&project, &["run", "doll.ron", "-n", "--input", "mesh=tet.obj"]);
    assert!(text.starts_with("cached"), "{text}");
}

#[test]
fn a_large_file_at_an_input_that_has_not_changed_is_known_by_its_stamp() {
    let project = project();
    project.save(FUNCTION);
    fn write(corner: &str, project: &Project) {
        let comment = format!("#{}\n", " ".repeat(99)).repeat(700_000);
        let mesh = TETRAHEDRON.replace("v 9 0 0", corner);
        fs::write(project.folder().join("large.obj"), mesh + &comment).unwrap();
        wait();
    }
    let input = ["--input", "mesh=large.obj"];
    fn dry(project: &Project, input: &[&str; 2]) -> (Vec<String>, String) {
        forecast(project, &[&["run", "doll.ron", "-n"], &input[..]].concat())
    }
    write("v 9 0 0", &project);
    forecast(&project, &[&["run", "doll.ron"], &input[..]].concat());
    let (lines, text) = dry(&project, &input);
    assert_eq!(lines, ["cached mesh", "cached lifted"], "{text}");
    let (_, text) =
        forecast(&project, &[&["run", "doll.ron", "-n", "--set", "lift=6"], &input[..]].concat());
    assert!(text.contains("parameter `translate[1]` 5 -> 6"), "{text}");
    write("v 8 0 0", &project);
    let (lines, text) = dry(&project, &input);
    assert_eq!(lines, ["may run", "may run"].map(str::to_owned), "{text}");
    assert!(text.contains("file large.obj may have changed and was not read"), "{text}");
}

#[test]
fn only_leaves_out_what_is_expected_of_other_outputs() {
    let project = project();
    let expect = "    expect: [Bounds(of: \"other.obj\", low: (0, 0, 0), high: (1, 1, 1))],\n)\n";
    project.save(&GRAPH.replace("\n)\n", &format!("\n{expect}")));
    let whole = project.maquette(&["run", "doll.ron", "--json"]);
    assert_eq!(whole.status.code(), Some(1), "`other.obj` is not as it is expected");
    fs::remove_dir_all(project.folder().join("out")).unwrap();
    let only = project.maquette(&["run", "doll.ron", "--no-cache", "--only", "out.obj", "--json"]);
    let told: serde_json::Value = serde_json::from_slice(&only.stdout).unwrap();
    let names = told["nodes"].as_array().unwrap().iter().map(|node| node["name"].clone());
    assert_eq!(Vec::from_iter(names), ["mesh", "lifted"]);
    assert_eq!((only.status.code(), &told["problems"]), (Some(0), &serde_json::json!([])));
    let only = project.maquette(&["run", "doll.ron", "--only", "other.obj"]);
    assert_eq!(only.status.code(), Some(1), "what is expected of it is judged");
}
