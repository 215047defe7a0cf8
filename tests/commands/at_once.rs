//! Several commands change one file at the same time, and no change is lost.

use std::io::Write;
use std::process::{Child, Stdio};

use serde_json::json;

use crate::output::stdout_of;
use crate::project::Project;

const COUNT: usize = 8;

fn project() -> Project {
    let params = (0..COUNT).map(|k| format!("\"p{k}\": Number(default: 0.0),"));
    let nodes = (0..COUNT).map(|k| {
        format!("\"n{k}\": Transform(mesh: \"mesh\", translate: (Param(\"p{k}\"), 0, 0)),")
    });
    let (params, nodes) = (String::from_iter(params), String::from_iter(nodes));
    let mesh = "\"mesh\": ReadMesh(path: \"coarse.obj\"),";
    let text = format!(
        "Graph(format: 1, params: {{{params}}}, nodes: {{{mesh}{nodes}}}, outputs: {{\"a.ply\": \"n0\"}})"
    );
    let project = Project::new(&text);
    project.copy_asset("coarse.obj", "coarse.obj");
    project
}

/// Starts one process for each number below `COUNT`, and then waits for all of them. `words` returns the arguments of a process.
fn at_once(project: &Project, words: impl Fn(usize) -> Vec<String>) {
    let started: Vec<Child> = (0..COUNT)
        .map(|k: usize| {
            let words = words(k);
            let words: Vec<_> = words.iter().map(String::as_str).collect();
            let mut command = project.command(&words);
            command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
        })
        .collect();
    for (k, mut child) in started.into_iter().enumerate() {
        assert!(child.wait().unwrap().success(), "{:?}", words(k));
    }
}

fn names(project: &Project) -> Vec<String> {
    let entries = std::fs::read_dir(project.folder()).unwrap().flatten();
    let mut names: Vec<_> =
        entries.map(|it| it.file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

#[test]
fn no_edit_is_lost() {
    let project = project();
    let before = names(&project);
    at_once(&project, |k| {
        ["edit", "doll.ron", "set", &format!("p{k}={}", k + 1)].map(str::to_owned).into()
    });
    let text = std::fs::read_to_string(project.graph()).unwrap();
    for k in 0..COUNT {
        assert!(text.contains(&format!("\"p{k}\": Number(default: {})", k + 1)), "{k}: {text}");
    }
    assert_eq!(names(&project), before, "nothing is left behind");
}

#[test]
fn no_pin_is_lost() {
    let project = project();
    at_once(&project, |k| ["pin", "doll.ron", &format!("n{k}")].map(str::to_owned).into());
    fn count_pins(project: &Project) -> usize {
        let output = project.maquette(&["pin", "doll.ron", "--list"]);
        stdout_of(&output).lines().count()
    }
    assert_eq!(count_pins(&project), COUNT);
    at_once(&project, |k| {
        ["pin", "--remove", "doll.ron", &format!("n{k}")].map(str::to_owned).into()
    });
    assert_eq!(count_pins(&project), 0);
    assert!(!names(&project).contains(&"doll.pins".to_owned()));
}

#[test]
fn no_update_of_a_lock_is_lost() {
    let uses = (0..COUNT).map(|k| format!("\"U{k}\": \"u{k}.ron\","));
    let nodes = (0..COUNT).map(|k| format!("\"n{k}\": U{k}(mesh: \"mesh\"),"));
    let (uses, nodes) = (String::from_iter(uses), String::from_iter(nodes));
    let mesh = "\"mesh\": ReadMesh(path: \"coarse.obj\"),";
    let project = Project::new(&format!(
        "Graph(format: 1, use: {{{uses}}}, nodes: {{{mesh}{nodes}}}, outputs: {{\"a.ply\": \"n0\"}})"
    ));
    project.copy_asset("coarse.obj", "coarse.obj");
    fn write_used(scale: u32, project: &Project) {
        for k in 0..COUNT {
            let text = format!(
                "Graph(format: 1, inputs: {{\"mesh\": Mesh()}}, nodes: {{\"it\": Transform(mesh: \"mesh\", scale: ({scale}, 1, 1))}}, outputs: {{\"skin\": \"it\"}})"
            );
            project.write(&format!("u{k}.ron"), text);
        }
    }
    write_used(1, &project);
    at_once(&project, |_| ["lock", "doll.ron"].map(str::to_owned).into());
    write_used(2, &project);
    at_once(&project, |k| {
        ["lock", "--update", "doll.ron", &format!("U{k}"), "--yes"].map(str::to_owned).into()
    });
    let output = project.maquette(&["lock", "--update", "doll.ron", "--yes"]);
    let told = stdout_of(&output);
    assert!(told.contains("is up to date"), "{told}");
}

#[test]
fn a_layout_is_that_of_one_of_those_who_wrote_it_and_none_is_refused() {
    let project = project();
    fn places(k: usize, turn: usize) -> serde_json::Value {
        let nodes = (0..COUNT).map(|n| (format!("n{n}"), json!([k, turn])));
        json!({ "nodes": serde_json::Map::from_iter(nodes) })
    }
    let turns = 20;
    let hosts: Vec<_> = (0..COUNT)
        .map(|k: usize| {
            let mut command = project.command(&["serve", "--stdio"]);
            let piped = command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null());
            let mut host = piped.spawn().unwrap();
            let mut requests = host.stdin.take().unwrap();
            for turn in 1..=turns {
                let layout = places(k, turn);
                let ask =
                    json!({ "id": turn, "do": "layout", "graph": "doll.ron", "layout": layout });
                writeln!(requests, "{ask}").unwrap();
            }
            host
        })
        .collect();
    for host in hosts {
        let told = host.wait_with_output().unwrap().stdout;
        let told = String::from_utf8_lossy(&told);
        let answers = told.lines().filter(|line| line.contains("\"event\":\"answer\"")).count();
        assert_eq!(answers, turns, "{told}");
    }
    let text = project.read("doll.layout.ron");
    let is_last_of = |k: &usize| text.matches(&format!(": ({k}.0, {turns}.0)")).count() == COUNT;
    assert!((0..COUNT).any(|k| is_last_of(&k)), "{text}");
    let known = ["coarse.obj", "doll.layout.ron", "doll.ron"];
    assert_eq!(names(&project), known, "nothing is left behind");
}
