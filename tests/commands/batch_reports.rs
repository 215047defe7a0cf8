//! Messages of a batch about its tasks before they run, and tasks made from tables and ranges.

use std::fs;
use std::process::Output;

use serde_json::Value as Json;

use crate::project::Project;

const GRAPH: &str = r#"Graph(
    format: 1,
    params: { "size": Number(default: 1.0, min: 0.1, max: 99.0, doc: "Its size.") },
    nodes: { "ball": Primitive(shape: Sphere(radius: Param("size"))) },
    outputs: { "a.ply": "ball" },
)
"#;

fn project(sweep: &str) -> Project {
    let project = Project::new(GRAPH);
    fs::write(project.folder().join("maquette.toml"), "").unwrap();
    fs::write(project.folder().join("s.sweep.ron"), sweep).unwrap();
    project
}

fn document(output: &Output) -> Json {
    let told = String::from_utf8_lossy(&output.stderr);
    serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{told}"))
}

fn sizes(document: &Json) -> Vec<String> {
    let tasks = document["tasks"].as_array().unwrap().iter();
    tasks.map(|task| task["values"]["size"].as_str().unwrap().to_owned()).collect()
}

#[test]
fn a_report_counts_and_fails_until_all_tasks_are_done() {
    let project = project("Sweep(graph: \"doll.ron\", over: Values(\"size\", [1, 2]))");
    fn report(more: &[&str], project: &Project) -> (Option<i32>, String, Output) {
        let output = project.maquette(&[&["batch", "s.sweep.ron", "--report"], more].concat());
        let words = String::from_utf8_lossy(&output.stderr).into_owned();
        (output.status.code(), words, output)
    }
    fn counts(document: &Json) -> [u64; 3] {
        ["done", "failed", "missing"].map(|name| document[name].as_u64().unwrap())
    }
    let (code, words, _) = report(&[], &project);
    assert_eq!((code, &words[..]), (Some(1), "error: 2 tasks: 0 done, 0 failed, 2 missing\n"));
    project.maquette(&["batch", "s.sweep.ron", "--task", "1"]);
    let (code, _, output) = report(&["--json"], &project);
    let told = document(&output);
    assert_eq!((code, counts(&told)), (Some(1), [1, 0, 1]));
    assert_eq!(told["tasks"][0]["state"], "missing");
    assert_eq!(
        (&told["tasks"][1]["state"], &told["tasks"][1]["name"]),
        (&"done".into(), &"2".into())
    );
    let (code, _, output) = report(&["--events"], &project);
    let told = document(&output);
    assert_eq!((code, counts(&told), &told["event"]), (Some(1), [1, 0, 1], &"batch".into()));
    project.maquette(&["batch", "s.sweep.ron"]);
    let (code, words, output) = report(&["--json"], &project);
    assert_eq!((code, counts(&document(&output)), words), (Some(0), [2, 0, 0], String::new()));
}

#[test]
fn a_forecast_is_json_where_that_is_asked_for() {
    let project = project("Sweep(graph: \"doll.ron\", over: Values(\"size\", [1, 2]))");
    project.maquette(&["batch", "s.sweep.ron", "--task", "0"]);
    let told = document(&project.maquette(&["batch", "s.sweep.ron", "-n", "--json"]));
    assert_eq!(
        (&told["tasks"][0]["state"], &told["tasks"][1]["state"]),
        (&"done".into(), &"run".into())
    );
    assert_eq!((&told["due"], sizes(&told)), (&1.into(), vec!["1".to_owned(), "2".to_owned()]));
    let events = project.maquette(&["batch", "s.sweep.ron", "-n", "--events"]);
    let lines = String::from_utf8(events.stdout).unwrap();
    let lines =
        lines.lines().map(|line| serde_json::from_str::<Json>(line).unwrap()).collect::<Vec<_>>();
    assert_eq!((lines.len(), &lines[2]["due"]), (3, &1.into()));
}

#[test]
fn tasks_come_from_ranges_and_tables() {
    fn reported_files(over: &str, files: &[(&str, &str)]) -> (Vec<String>, Vec<String>) {
        let project = project(&format!("Sweep(graph: \"doll.ron\", over: {over})"));
        files.iter().for_each(|(name, text)| fs::write(project.folder().join(name), text).unwrap());
        let told = document(&project.maquette(&["batch", "s.sweep.ron", "-n", "--json"]));
        let problems = told["problems"].as_array().unwrap();
        let words = problems.iter().map(|it| it["message"].as_str().unwrap().to_owned());
        (sizes(&told), Vec::from_iter(words))
    }
    let sized =
        |sizes: &[&str]| (sizes.iter().map(|it| (*it).to_owned()).collect::<Vec<_>>(), Vec::new());
    assert_eq!(reported_files("Range(\"size\", 5, 20, 4)", &[]), sized(&["5", "10", "15", "20"]));
    assert_eq!(reported_files("Range(\"size\", 2, 1.5, 3)", &[]), sized(&["2", "1.75", "1.5"]));
    let csv = ("t.csv", "\u{feff}size\r\n2\r\n3.5\r\n");
    assert_eq!(reported_files("Table(\"t.csv\")", &[csv]), sized(&["2", "3.5"]));
    let json = ("t.json", "[{\"size\": 2}, {\"size\": 3.5}]");
    assert_eq!(reported_files("Table(\"t.json\")", &[json]), sized(&["2", "3.5"]));
    fn wrong(over: &str, files: &[(&str, &str)], wanted: &str) {
        let (sizes, words) = reported_files(over, files);
        assert!(
            sizes.is_empty() && words.iter().any(|it| it.contains(wanted)),
            "{over}: {words:?}"
        );
    }
    wrong("Range(\"size\", 5, 20, 1)", &[], "2");
    wrong("Range(\"size\", 5, 200, 4)", &[], "size");
    wrong("Table(\"none.csv\")", &[], "none.csv");
    wrong("Table(\"t.csv\")", &[("t.csv", "size;b\n1;2\n")], "semicolon");
    wrong("Table(\"t.csv\")", &[("t.csv", "sise\n1\n")], "sise");
    wrong("Table(\"t.csv\")", &[("t.csv", "size\n\"1,5\"\n")], "point");
    wrong("Table(\"../../../../../../etc/x.csv\")", &[], "outside");
}
