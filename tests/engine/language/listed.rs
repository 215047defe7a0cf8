//! An expectation about a single value is an error if its name refers to a list of values.

use maquette::{Catalog, test_graphs};
use maquette_nodes::PACKS;

/// Returns the errors of a test file with an expectation about the value `of`.
fn check_messages(of: &str) -> Vec<String> {
    let folder = tempfile::tempdir().unwrap();
    fn write(name: &str, text: &str, folder: &tempfile::TempDir) {
        std::fs::write(folder.path().join(name), text).unwrap();
    }
    write(
        "two.obj",
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 5 0 0\nv 6 0 0\nv 5 1 0\nf 1 2 3\nf 4 5 6\n",
        &folder,
    );
    write(
        "graph.ron",
        r#"Graph(format: 1, nodes: {
            "two": ReadMesh(path: "two.obj"),
            "parts": ForEach(graph: "Transform", over: Parts("two")),
            "listed": ForEach(graph: "Transform", over: [(), ()], links: (mesh: "two")),
            "all": Merge(meshes: ["parts", "listed"]),
        }, outputs: { "all.ply": "all" })"#,
        &folder,
    );
    write(
        "graph.test.ron",
        &format!("Test(graph: \"graph.ron\", expect: [Manifold({of:?})])"),
        &folder,
    );
    let run = test_graphs(folder.path(), &Catalog::new(PACKS), 1).unwrap();
    run.failures
        .into_iter()
        .filter(|why| why.contains("no output or node") || why.contains("expected"))
        .collect()
}

#[test]
fn a_list_is_told_as_one_and_an_element_is_a_value() {
    for list in ["parts", "parts.mesh", "listed"] {
        let told = check_messages(list);
        let words = format!("expected a single value, found the list `{list}`");
        assert!(told.len() == 1 && told[0].contains(&words), "{told:?}");
    }
    for one in ["parts/2", "listed/1", "all"] {
        assert_eq!(check_messages(one), [""; 0], "{one}");
    }
}
