//! If one input file is missing, only the nodes that depend on it fail.

use std::fs;

use serde_json::Value as Json;

use crate::project::{Project, TETRAHEDRON};

const GRAPH: &str = r#"Graph(
    format: 1,
    params: { "which": Choice(default: Good, of: [Good, Bad], doc: "Which.") },
    nodes: {
        "good": ReadMesh(path: "tet.obj"),
        "bad": ReadMesh(path: "tte.obj"),
        "moved": Transform(mesh: "bad"),
        "chosen": Switch(choose: Param("which"), cases: { "Good": "good", "Bad": "moved" }),
    },
    outputs: { "good.obj": "good", "bad.obj": "moved", "chosen.obj": "chosen" },
)
"#;

pub(crate) fn project() -> Project {
    Project::with_tetrahedron(GRAPH)
}

/// Runs the graph; returns the exit code, the severity and message of each diagnostic, and the names of all written files.
fn run(project: &Project, more: &[&str]) -> (Option<i32>, Vec<String>, Vec<String>) {
    let output = project.maquette(&[&["run", "doll.ron", "--json"], more].concat());
    let told: Json = serde_json::from_slice(&output.stdout).unwrap();
    fn text(value: &Json) -> String {
        value.as_str().unwrap().to_owned()
    }
    fn list(name: &str, told: &Json) -> Vec<Json> {
        told[name].as_array().unwrap().clone()
    }
    let problems = list("problems", &told).into_iter().map(|problem| {
        format!(
            "{} {}: {}",
            text(&problem["severity"]),
            text(&problem["code"]),
            text(&problem["message"])
        )
    });
    let written = list("outputs", &told).into_iter().map(|output| text(&output["name"]));
    (output.status.code(), problems.collect(), written.collect())
}

fn words(words: &[&str]) -> Vec<String> {
    words.iter().map(|&word| word.to_owned()).collect()
}

const ERROR: &str = "error G013: there is no file `tte.obj`";
const WARNING: &str = "warning G013: there is no file `tte.obj`";

#[test]
fn a_run_writes_what_does_not_depend_on_the_file_and_fails() {
    let project = project();
    let (code, problems, mut written) = run(&project, &[]);
    written.sort();
    assert_eq!((code, problems), (Some(1), words(&[ERROR])));
    assert_eq!(written, words(&["chosen.obj", "good.obj"]));
}

#[test]
fn what_is_not_wanted_and_cases_that_are_not_chosen_are_no_errors() {
    let project = project();
    for only in ["good.obj", "chosen.obj"] {
        let (code, problems, written) = run(&project, &["--only", only]);
        assert_eq!((code, problems, written), (Some(0), words(&[WARNING]), words(&[only])));
    }
    for more in [
        ["--only", "bad.obj", "--set", "which=Good"],
        ["--only", "chosen.obj", "--set", "which=Bad"],
    ] {
        let (code, problems, written) = run(&project, &more);
        assert_eq!((code, problems, written), (Some(1), words(&[ERROR]), words(&[])));
    }
}

#[test]
fn what_is_looked_at_alone_needs_no_other_file() {
    let project = project();
    for (node, code) in [("good", 0), ("chosen", 0), ("bad", 1), ("moved", 1)] {
        let output = project.maquette(&["inspect", "doll.ron", node]);
        let told = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(code), "{node}: {told}");
        assert_eq!(told.contains("there is no file `tte.obj`"), code == 1, "{node}: {told}");
    }
    fn run_why(node: &str, project: &Project) -> Vec<u8> {
        project.maquette(&["why", "doll.ron", node]).stdout
    }
    assert!(String::from_utf8_lossy(&run_why("good", &project)).starts_with("`good` does not run"));
    let told = String::from_utf8(run_why("moved", &project)).unwrap();
    assert!(told.contains("`moved` is skipped") && told.contains("tte.obj"), "{told}");
    // `check` reports the missing file as an error even if no output needs it.
    assert_eq!(project.maquette(&["check", "doll.ron"]).status.code(), Some(1));
}

#[test]
fn a_dry_run_says_what_would_fail() {
    let project = project();
    fn dry(more: &[&str], project: &Project) -> std::process::Output {
        project.maquette(&[&["run", "doll.ron", "-n"], more].concat())
    }
    let all = dry(&[], &project);
    let told = String::from_utf8_lossy(&all.stdout).into_owned();
    assert_eq!(all.status.code(), Some(1), "{told}");
    fn line(word: &str, node: &str, told: &str) -> bool {
        told.lines().any(|line| line.split_whitespace().take(2).eq([word, node]))
    }
    assert!(
        line("failed", "bad", &told)
            && line("skipped", "moved", &told)
            && line("runs", "good", &told),
        "{told}"
    );
    assert_eq!(dry(&["--only", "good.obj"], &project).status.code(), Some(0));
}

#[test]
fn a_watch_goes_on_and_takes_the_file_as_soon_as_it_is_there() {
    let project = project();
    let mut watch = project.start(&[]);
    let run = watch.run();
    assert_eq!((run.state("good"), run.state("bad")), ("computed", "failed"), "{run:?}");
    assert_eq!(run.problems[0]["message"], "there is no file `tte.obj`");
    // The file has new content; otherwise its result would already be cached.
    let other = TETRAHEDRON.replace('9', "8");
    fs::write(project.folder().join("tte.obj"), other).unwrap();
    assert_eq!(watch.run_until_ok().state("bad"), "computed");
    watch.end();
    project.assert_outputs_are_right();
}
