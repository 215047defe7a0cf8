//! What differs between graphs is told only where a reader sees a difference.

use std::path::PathBuf;

use maquette::{Catalog, Graph, Source};
use maquette_nodes::PACKS;

fn differences(old: &str, new: &str) -> Vec<String> {
    let source = |text: &str| Source { name: PathBuf::from("graph.ron"), text: text.to_owned() };
    let found = Graph::differences(&source(old), &source(new), &Catalog::new(PACKS)).unwrap();
    found.iter().map(ToString::to_string).collect()
}

#[test]
fn a_node_that_is_called_as_an_input_rewires_nothing() {
    let old = r#"Graph(format: 1, nodes: {
        "in": ReadMesh(path: "in.ply"),
        "parts": ForEach(graph: "Transform", over: Parts("in"), each: "mesh"),
        "all": Merge(meshes: "parts"),
    }, outputs: { "all.ply": "all" })"#;
    let new = old.replace("\"in\"", "\"mesh\"");
    assert_eq!(differences(old, &new), ["node mesh: renamed, was in"]);
    assert_eq!(differences(&new, old), ["node in: renamed, was mesh"]);
}

#[test]
fn a_word_of_an_unknown_node_that_no_longer_names_a_node_is_the_same_word() {
    let old = r#"Graph(format: 1, nodes: {
        "ball": ReadMesh(path: "ball.ply"),
        "hair": HairStrands(on: "ball", color: "red"),
    }, outputs: {})"#;
    let new = old.replace("\"ball\": ReadMesh(path: \"ball.ply\"),", "");
    assert_eq!(differences(old, &new), [r#"node ball: removed: ReadMesh(path: "ball.ply")"#]);
}
