//! Names of what a graph is given are fields of its uses, which have no hyphens.

use maquette::{Catalog, Graph, Options, Severity};

const UP: &str = r#"Graph(
    format: 1,
    inputs: { "the-mesh": Mesh(doc: "") },
    params: { "eye-step": Number(default: 1.0, doc: "") },
    nodes: { "moved": Transform(mesh: "the-mesh", translate: (0, Param("eye-step"), 0)) },
    outputs: { "out-mesh": "moved" },
)"#;

#[test]
fn who_writes_a_graph_and_who_uses_it_are_told_of_names_that_cannot_be_given() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let catalog = Catalog::new(maquette_nodes::PACKS);
    let using = r#"Graph(format: 1, use: { "Up": "up.ron" }, nodes: { "up": Up() }, outputs: { "a.ply": "up" })"#;
    let options = Options::default().with_text(path("up.ron"), UP).with_text(path("a.ron"), using);
    let graph = Graph::load(&path("up.ron"), &catalog, &options).graph.unwrap();
    let told = graph
        .unused()
        .iter()
        .map(|it| (it.severity, &UP[it.span.start..it.span.end], &it.message[..]));
    assert_eq!(
        Vec::from_iter(told),
        [
            (
                Severity::Warning,
                "\"the-mesh\"",
                "no graph that uses this one can give `the-mesh`: a field has no hyphens"
            ),
            (
                Severity::Warning,
                "\"eye-step\"",
                "no graph that uses this one can give `eye-step`: a field has no hyphens"
            ),
        ]
    );
    let [problem] = &Graph::load(&path("a.ron"), &catalog, &options).problems[..] else {
        panic!("one problem")
    };
    assert_eq!(problem.message, "Up needs a link at its port `the-mesh`");
    assert_eq!(
        problem.help,
        "a field has no hyphens: write its name in the graph's file without them"
    );
    // A graph that is not used by others may have any names.
    let alone = UP.replace("    inputs: { \"the-mesh\": Mesh(doc: \"\") },\n", "");
    let alone = alone
        .replace("mesh: \"the-mesh\"", "mesh: \"m\"")
        .replace("nodes: {", "nodes: { \"m\": ReadMesh(path: \"a.obj\"),");
    let alone = alone.replace("out-mesh", "a.ply");
    std::fs::write(path("a.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    let options = Options::default().with_text(path("b.ron"), alone);
    let graph = Graph::load(&path("b.ron"), &catalog, &options).graph.unwrap();
    assert_eq!(graph.unused(), []);
}
