//! Compares graphs. A difference is reported only if it matters to the meaning of the graphs.

use std::path::PathBuf;

use maquette::{Catalog, Graph, Source};
use maquette_nodes::PACKS;

fn differences(old: &str, new: &str) -> Vec<String> {
    fn source(text: &str) -> Source {
        Source { name: PathBuf::from("graph.ron"), text: text.to_owned() }
    }
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

/// A graph that refers to other files in every possible way.
const READS: &str = r#"Graph(
    format: 1,
    use: { "Up": "lib/up.ron" },
    params: { "file": Text(default: Draft(final: "data/a.obj", draft: "data/rough.obj")) },
    nodes: {
        "a": ReadMesh(path: Param("file")),
        "b": ReadMesh(path: "data/b.obj"),
        "up": Up(mesh: "b"),
    },
    outputs: { "a.ply": "a", "up.ply": "up" },
)"#;

/// Returns the differences between the project's `graph.ron`, whose text is [`READS`], and another graph in the project.
fn differences_in_a_project(name: &str, text: &str) -> Vec<String> {
    let folder = tempfile::tempdir().unwrap();
    let project = std::fs::canonicalize(folder.path()).unwrap();
    fn write(name: &str, text: &str, project: &std::path::Path) -> Source {
        let path = project.join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, text).unwrap();
        Source { name: path, text: text.to_owned() }
    }
    write("maquette.toml", "", &project);
    write(
        "lib/up.ron",
        r#"Graph(format: 1, inputs: { "mesh": Mesh() },
            nodes: { "up": Transform(mesh: "mesh") }, outputs: { "mesh": "up" })"#,
        &project,
    );
    let (old, new) = (write("graph.ron", READS, &project), write(name, text, &project));
    let found = Graph::differences_with_uses(&old, &new, &Catalog::new(PACKS)).unwrap();
    let back = Graph::differences_with_uses(&new, &old, &Catalog::new(PACKS)).unwrap();
    assert_eq!(found.len(), back.len(), "{back:?}");
    found.iter().map(ToString::to_string).collect()
}

#[test]
fn the_same_files_from_another_folder_are_no_difference() {
    let below = READS.replace("data/", "../data/").replace("lib/", "../lib/");
    for (name, text) in [
        ("sub/graph.ron", &below[..]),
        ("sub/patch.ron", r#"Patch(format: 1, of: "../graph.ron")"#),
        (
            "sub/patch.ron",
            r#"Patch(format: 1, of: "../graph.ron", params: { "file": Draft(final: "../data/a.obj", draft: "../data/rough.obj") },
                nodes: { "b": (path: "../data/b.obj") })"#,
        ),
    ] {
        assert_eq!(differences_in_a_project(name, text), Vec::<String>::new(), "{text}");
    }
}

#[test]
fn other_files_of_the_same_project_are_told_as_seen_from_the_old_graph() {
    let patch = r#"Patch(format: 1, of: "../graph.ron", nodes: { "b": (path: "data/b.obj") })"#;
    assert_eq!(
        differences_in_a_project("sub/patch.ron", patch),
        [r#"node b: changed path: "data/b.obj" -> "sub/data/b.obj""#]
    );
}

#[test]
fn paths_of_another_project_are_compared_as_they_are_written() {
    let folders = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let [old, new] = folders
        .each_ref()
        .map(|folder| Source { name: folder.path().join("graph.ron"), text: READS.to_owned() });
    assert_eq!(Graph::differences(&old, &new, &Catalog::new(PACKS)).unwrap(), []);
}

/// Returns the differences of the same graph in two checkouts with different library graphs.
fn differences_of_checkouts(library: Option<&str>, other_library: Option<&str>) -> Vec<String> {
    const GRAPH: &str = r#"Graph(format: 1, use: { "L": "lib.ron" }, nodes: {
        "a": L(), "b": L(up_step: 2.0), "c": L(up_step: 3.0),
    }, outputs: { "a.ply": "a", "b.ply": "b", "c.ply": "c" })"#;
    let folders = [(); 2].map(|()| tempfile::tempdir().unwrap());
    fn checkout(folder: &tempfile::TempDir, library: Option<&str>) -> Source {
        let name = folder.path().join("graph.ron");
        std::fs::write(folder.path().join("maquette.toml"), "").unwrap();
        std::fs::write(&name, GRAPH).unwrap();
        if let Some(library) = library {
            std::fs::write(folder.path().join("lib.ron"), library).unwrap();
        }
        Source { name, text: GRAPH.to_owned() }
    }
    let (old, new) = (checkout(&folders[0], library), checkout(&folders[1], other_library));
    let found = Graph::differences_with_uses(&old, &new, &Catalog::new(PACKS)).unwrap();
    found.iter().map(ToString::to_string).collect()
}

const LIBRARY: &str = r#"Graph(format: 1, params: { "up-step": Number(default: 2.0, unit: "mm") },
    nodes: { "ball": ReadMesh(path: "ball.ply"), "up": Transform(mesh: "ball", translate: (0.0, Param("up-step"), 0.0)) },
    outputs: { "mesh": "up" })"#;

#[test]
fn another_default_of_a_used_graph_is_told_there_alone() {
    let other = LIBRARY.replace("default: 2.0", "default: 3.0");
    assert_eq!(
        differences_of_checkouts(Some(LIBRARY), Some(&other)),
        ["in L: parameter up-step: changed default: 2 -> 3"]
    );
}

#[test]
fn a_used_graph_that_one_side_lacks_is_told() {
    let missing = ["use L: changed file: found -> missing"];
    assert_eq!(differences_of_checkouts(Some(LIBRARY), None), missing);
    assert_eq!(
        differences_of_checkouts(None, Some(LIBRARY)),
        ["use L: changed file: missing -> found"]
    );
}
