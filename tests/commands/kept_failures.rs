//! A batch does not repeat failures that would recur, but repeats those caused by the machine.

use std::fs;

use serde_json::Value as Json;

use crate::project::{Project, TETRAHEDRON};

const GRAPH: &str = r#"Graph(
    format: 1,
    params: { "levels": Integer(default: 1, min: 0, max: 9, doc: "Levels.") },
    nodes: {
        "mesh": ReadMesh(path: "tet.obj"),
        "fine": Subdivide(mesh: "mesh", scheme: Loop, levels: Param("levels")),
    },
    outputs: { "out.ply": "fine" },
)
"#;

fn project(mesh: &str) -> Project {
    let project = Project::new(GRAPH);
    fs::write(project.folder().join("maquette.toml"), "").unwrap();
    fs::write(project.folder().join("tet.obj"), mesh).unwrap();
    project
}

/// Runs a batch of one task; returns the exit code, the state of the task, and true if it ran.
fn batch(project: &Project, more: &[&str]) -> (Option<i32>, String, bool) {
    let words = ["batch", "doll.ron", "--sweep", "levels=4", "--out", "all", "--json"];
    let output = project.maquette(&[&words, more].concat());
    let told: Json = serde_json::from_slice(&output.stdout).unwrap();
    let task = &told["tasks"][0];
    let state = task["state"].as_str().unwrap().to_owned();
    (output.status.code(), state, task["ran"].as_bool().unwrap())
}

fn task(project: &Project) -> std::path::PathBuf {
    let record = fs::read_dir(project.folder().join("all/tasks")).unwrap();
    let names = record.map(|it| it.unwrap().path()).filter(|it| it.extension().unwrap() == "json");
    let name = Vec::from_iter(names).pop().unwrap().file_stem().unwrap().to_owned();
    project.folder().join("all").join(name)
}

#[test]
fn what_failed_for_want_of_memory_is_tried_again() {
    let project = project(TETRAHEDRON);
    let little = batch(&project, &["--max-memory", "2kB"]);
    assert_eq!(little, (Some(1), "failed".into(), true));
    assert_eq!(batch(&project, &[]), (Some(0), "done".into(), true));
    assert_eq!(batch(&project, &[]), (Some(0), "done".into(), false));
}

#[test]
fn what_could_not_be_written_is_tried_again() {
    let project = project(TETRAHEDRON);
    assert_eq!(batch(&project, &[]).0, Some(0));
    let task = task(&project);
    fs::remove_dir_all(&task).unwrap();
    // A file in place of the folder prevents every user, even root, from writing.
    fs::write(&task, "").unwrap();
    assert_eq!(batch(&project, &[]), (Some(1), "failed".into(), true));
    assert_eq!(batch(&project, &[]), (Some(1), "failed".into(), true));
    let dry = project.maquette(&["batch", "doll.ron", "--sweep", "levels=4", "--out", "all", "-n"]);
    let dry = String::from_utf8_lossy(&dry.stdout).into_owned();
    assert!(dry.contains("it failed because memory, disk space"), "{dry}");
    fs::remove_file(&task).unwrap();
    assert_eq!(batch(&project, &[]), (Some(0), "done".into(), true));
}

#[test]
fn what_fails_by_itself_is_kept_and_says_how_it_is_run_again() {
    let project = project("no mesh\n");
    assert_eq!(batch(&project, &[]), (Some(1), "failed".into(), true));
    assert_eq!(batch(&project, &[]), (Some(1), "failed".into(), false));
    for more in [&[][..], &["-n"]] {
        let words = ["batch", "doll.ron", "--sweep", "levels=4", "--out", "all"];
        let output = project.maquette(&[&words, more].concat());
        let told = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(told.contains("nothing has changed; use --retry to run it again"), "{told}");
    }
    assert_eq!(batch(&project, &["--retry"]), (Some(1), "failed".into(), true));
}

#[test]
fn a_sweep_in_the_middle_of_a_merge_says_so() {
    let project = project(TETRAHEDRON);
    let side =
        |value: u32| format!("Sweep(graph: \"doll.ron\", over: Values(\"levels\", [{value}]))");
    let (ours, theirs) = (side(1), side(2));
    let text = format!("<<<<<<< ours\n{ours}\n=======\n{theirs}\n>>>>>>> theirs\n");
    for (name, words) in [
        ("a.sweep.ron", &["batch", "a.sweep.ron", "-n"][..]),
        ("c.ron", &["edit", "c.ron", "migrate"]),
    ] {
        fs::write(project.folder().join(name), &text).unwrap();
        let output = project.maquette(words);
        let told = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(told.contains("error[G001]: this file contains merge conflict markers"), "{told}");
        assert!(told.contains(&format!("{name}:1:1")), "{told}");
        assert_eq!(output.status.code(), Some(1));
    }
    // After the conflict markers are removed, other errors of the sweep are reported as usual.
    fs::write(project.folder().join("a.sweep.ron"), ours.replace("Sweep", "Sweeep")).unwrap();
    let output = project.maquette(&["batch", "a.sweep.ron", "-n"]);
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(told.contains("expected Sweep(..), found "), "{told}");
}
