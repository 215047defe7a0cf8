//! Every command that runs a graph reports a useless cache server once, and in the same words.

use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::Stdio;

use serde_json::{Value as Json, json};

use super::{Machine, Mode, Server, lock_machine, stderr_of};

const GRAPH: &str = r#"Graph(
    format: 1,
    nodes: {
        "mesh": ReadMesh(path: "mesh.obj"),
        "fine": Subdivide(mesh: "mesh", scheme: Loop, levels: 1),
    },
    outputs: { "fine.ply": "fine" },
)
"#;

const MESH: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";

/// Makes a folder with graphs, a test and a sweep.
fn project() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fn write(name: &str, text: &str, folder: &tempfile::TempDir) {
        std::fs::write(folder.path().join(name), text).unwrap();
    }
    write("maquette.toml", "", &folder);
    write("mesh.obj", MESH, &folder);
    write("fine.ron", GRAPH, &folder);
    write("fine.test.ron", r#"Test(graph: "fine.ron", cases: { "one": (), "two": () })"#, &folder);
    write(
        "many.sweep.ron",
        r#"Sweep(graph: "fine.ron", over: Values("fine.levels", [0, 1, 2]))"#,
        &folder,
    );
    folder
}

/// Runs a command on a machine without cached results, and returns its messages about the server.
fn warnings(project: &Path, address: &str, words: &[&str]) -> Vec<String> {
    let machine = Machine::new();
    let mut command = machine.command(&[words, &["--cache-remote", address]].concat());
    let output = command.current_dir(project).output().unwrap();
    let lines = stderr_of(&output);
    let of_server = lines.lines().filter(|line| line.contains("the server of results"));
    of_server.map(str::to_owned).collect()
}

#[test]
fn every_command_tells_the_trouble_with_a_server_once_and_in_the_same_words() {
    let _alone = lock_machine();
    let (server, project) = (Server::new(), project());
    let (address, folder) = (server.address(), project.path());
    server.set(Mode::Fails);
    let wanted = format!(
        "warning: the server of results {address}: 500 Internal Server Error; it is not used any more"
    );
    for words in [
        "run fine.ron",
        "replay out/fine/fine.ply --graph fine.ron",
        "render fine.ron fine fine.png",
        "render sheet fine.ron",
        "inspect fine.ron fine",
        "render gallery .",
        "test . --threads 2",
        "batch many.sweep.ron --jobs 3",
    ] {
        let told = warnings(folder, &address, &words.split(' ').collect::<Vec<_>>());
        assert_eq!(told, std::slice::from_ref(&wanted), "{words}");
    }
}

#[test]
fn a_host_hears_of_the_trouble_with_a_server() {
    let _alone = lock_machine();
    let (server, project, machine) = (Server::new(), project(), Machine::new());
    server.set(Mode::Fails);
    let address = server.address();
    let mut command = machine.command(&["serve", "--stdio", "--cache-remote", &address]);
    let command = command.current_dir(project.path()).stdin(Stdio::piped()).stdout(Stdio::piped());
    let mut process = command.spawn().unwrap();
    // The run lasts only while its stdin is open.
    let mut requests = process.stdin.take().unwrap();
    writeln!(requests, "{}", json!({ "id": 1, "do": "run", "graph": "fine.ron" })).unwrap();
    let lines = BufReader::new(process.stdout.take().unwrap()).lines();
    let mut events = lines.map(|line| serde_json::from_str::<Json>(&line.unwrap()).unwrap());
    let answer = events.find(|event| event["id"] == 1).unwrap();
    drop(requests);
    process.wait().unwrap();
    let problem = &answer["problems"][0];
    assert_eq!((&answer["ok"], &problem["severity"]), (&true.into(), &"warning".into()));
    assert!(
        problem["message"].as_str().unwrap().contains("500 Internal Server Error"),
        "{problem}"
    );
}
