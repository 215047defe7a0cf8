//! Chains of nodes that use the same graph, which contains a `ForEach` over data. Each node works on the result of the previous one.

use std::time::{Duration, Instant};

use maquette::value::Mesh;
use maquette::{Options, Run, RunResult, Session, Settings};
use maquette_nodes::PACKS;

/// A graph that moves each part of a mesh and merges the results. `ALL` is replaced by the list of meshes to merge.
const LIB: &str = r#"Graph(format: 1, inputs: { "mesh": Mesh(doc: "It.") }, nodes: {
    "each": ForEach(graph: "Transform", over: Parts("mesh"), with: (translate: (100, 0, 0))), "all": Merge(meshes: ALL),
}, outputs: { "all": "all" })"#;

/// Runs a chain of `count` nodes that use the graph `LIB`. `all` is the list of meshes that each of them merges. `first` defines the node
/// `n0`, at which the chain begins.
fn run(count: usize, all: &str, first: &str) -> (RunResult, Duration) {
    let folder = tempfile::tempdir().unwrap();
    fn write(name: &str, text: &str, folder: &tempfile::TempDir) {
        std::fs::write(folder.path().join(name), text).unwrap();
    }
    write(
        "two.obj",
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 5 0 0\nv 6 0 0\nv 5 1 0\nf 1 2 3\nf 4 5 6\n",
        &folder,
    );
    write("lib.ron", &LIB.replace("ALL", all), &folder);
    let chain = (1..=count).map(|at| format!("\"n{at}\": Lib(mesh: \"n{}\"),\n", at - 1));
    let chain = String::from_iter(chain);
    let text = format!(
        "Graph(format: 1, use: {{ \"Lib\": \"lib.ron\" }}, nodes: {{ {first}, {chain} }}, outputs: {{ \"all.ply\": \"n{count}\" }})"
    );
    write("graph.ron", &text, &folder);
    let mut session =
        Session::new(PACKS, &Settings { threads: 2, ..Settings::in_memory() }).unwrap();
    let checked = session.load(&folder.path().join("graph.ron"), &Options::default());
    let graph = checked.graph.unwrap_or_else(|| panic!("{:?}", checked.diagnostics));
    let start = Instant::now();
    (session.run(&graph, &Run::default()).unwrap(), start.elapsed())
}

const TWO: &str = r#""n0": ReadMesh(path: "two.obj")"#;

fn faces(done: &RunResult) -> usize {
    let mesh =
        done.get::<Mesh>("all.ply").unwrap_or_else(|why| panic!("{why}: {:?}", done.diagnostics()));
    mesh.faces().len()
}

#[test]
fn a_chain_four_times_as_long_takes_some_four_times_as_long() {
    fn best(count: usize) -> Duration {
        let runs = (0..3).map(|_| run(count, "\"each\"", TWO));
        runs.map(|(done, time)| {
            assert_eq!(faces(&done), 2);
            time
        })
        .min()
        .unwrap()
    }
    let (short, long) = (best(60), best(240));
    assert!(long < 9 * short, "{short:?}, {long:?}");
}

#[test]
fn counts_that_are_guessed_wrongly_are_found_out() {
    // Each node of the chain doubles the number of parts.
    let (done, _) = run(6, "[\"each\", \"mesh\"]", TWO);
    assert_eq!((faces(&done), done.diagnostics().len()), (128, 0));
    let (done, _) = run(3, "[\"each\", \"mesh\", \"mesh\"]", TWO);
    assert_eq!(faces(&done), 54);
}

#[test]
fn behind_what_fails_one_example_stands_for_all() {
    let first = r#""in": ReadMesh(path: "two.obj"), "before": Lib(mesh: "in"), "n0": Reconstruct(points: ["before"], skin: Open, spacing: 1e40)"#;
    let (done, _) = run(2, "\"each\"", first);
    let names: Vec<_> = done.trace().0.iter().map(|node| node.name.clone()).collect();
    assert!(names.contains(&"before/each/2".to_owned()), "{names:?}");
    let behind = names.iter().filter(|name| name.starts_with("n1/each/"));
    assert_eq!(Vec::from_iter(behind), ["n1/each/mesh", "n1/each/*"], "{names:?}");
}
