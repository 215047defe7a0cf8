//! Ports that accept many values but get none, for example from a `ForEach` over data without elements.

use maquette::value::Mesh;
use maquette::{Catalog, Graph, Options, Run, Session, Settings};
use maquette_nodes::PACKS;

/// Runs a graph. Returns its output `out.ply`, if there is one, and the messages.
fn run(fields: &str) -> (Option<Mesh>, Vec<String>) {
    let folder = tempfile::tempdir().unwrap();
    let promising = r#"Graph(format: 1, inputs: { "mesh": Mesh(doc: "It.") }, nodes: { "all": Merge(meshes: []) },
        outputs: { "all": "all" }, promises: { "all": [NonEmpty] })"#;
    std::fs::write(folder.path().join("empty.obj"), "v 0 0 0\n").unwrap();
    std::fs::write(folder.path().join("lib.ron"), promising).unwrap();
    let path = folder.path().join("graph.ron");
    std::fs::write(&path, format!("Graph(format: 1, {fields})")).unwrap();
    let checked = Graph::load(&path, &Catalog::new(PACKS), &Options::default());
    let graph = checked.graph.unwrap_or_else(|| panic!("{:?}", checked.diagnostics));
    let mut session =
        Session::new(PACKS, &Settings { threads: 2, ..Settings::in_memory() }).unwrap();
    let done = session.run(&graph, &Run::default()).unwrap();
    let told = done.diagnostics().iter().map(|problem| problem.message.clone()).collect();
    (done.get::<Mesh>("out.ply").ok().map(|mesh| (*mesh).clone()), told)
}

const EMPTY: &str = "`all`: the mesh is empty: there are no meshes to merge";

#[test]
fn no_meshes_merge_to_an_empty_one_and_what_is_behind_it_goes_on() {
    let nodes = r#""in": ReadMesh(path: "empty.obj"),
        "each": ForEach(graph: "Transform", over: Parts("in")),
        "all": Merge(meshes: "each"), "fine": Subdivide(mesh: "all", scheme: Loop)"#;
    let outputs = r#""out.ply": "fine", "out.obj": "fine", "out.stl": "fine""#;
    let (mesh, told) = run(&format!("nodes: {{ {nodes} }}, outputs: {{ {outputs} }}"));
    assert_eq!((mesh.unwrap().positions().len(), told), (0, vec![EMPTY.to_owned()]));
}

#[test]
fn what_all_of_nothing_have_is_not_promised() {
    let fields = r#"use: { "Lib": "lib.ron" }, nodes: { "in": ReadMesh(path: "empty.obj"), "it": Lib(mesh: "in") }, outputs: { "out.ply": "it" }"#;
    let (_, told) = run(fields);
    assert!(
        told.iter().any(|told| told.starts_with("expected NonEmpty, but `it.all`")),
        "{told:?}"
    );
}

#[test]
fn what_cannot_be_made_of_nothing_says_what_is_missing() {
    let (_, told) = run(r#"nodes: { "in": ReadMesh(path: "empty.obj"),
        "each": ForEach(graph: "Transform", over: Parts("in")),
        "all": Reconstruct(points: "each") }, outputs: { "out.ply": "all" }"#);
    assert_eq!(
        told,
        [
            "`all` cannot be computed: the list `points` is empty, so there is nothing to reconstruct"
        ]
    );
}
