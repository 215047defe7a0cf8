//! Measures the time to check a graph. The graph reads no files, so this is the time to parse and check its text.
//!
//! There is no performance target.

use maquette::{Catalog, Graph, Options};

fn main() {
    divan::main();
}

/// Returns a graph with a chain of `nodes` transforms of one mesh. Each of them has a parameter given by an expression.
fn graph(nodes: usize) -> String {
    let chain = (1..nodes).map(|k| {
        format!("        \"n{k}\": Transform(mesh: \"n{}\", translate: (Expr(\"step * {k}\"), 0, Param(\"step\"))),\n", k - 1)
    });
    format!(
        "Graph(\n    format: 1,\n    params: {{ \"step\": Number(default: 0.5) }},\n    nodes: {{\n        \"n0\": ReadMesh(path: \"mesh.obj\"),\n{}    }},\n    outputs: {{ \"out.ply\": \"n{}\" }},\n)\n",
        String::from_iter(chain),
        nodes - 1
    )
}

#[divan::bench(args = [50, 500, 5000])]
fn check(bencher: divan::Bencher<'_, '_>, nodes: usize) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    std::fs::write(folder.path().join("mesh.obj"), "").expect("a file");
    let path = folder.path().join("graph.ron");
    std::fs::write(&path, graph(nodes)).expect("a file");
    bencher.bench(|| {
        let catalog = Catalog::new(maquette_nodes::PACKS);
        let checked = Graph::load(&path, &catalog, &Options::default());
        assert!(checked.graph.is_some());
    });
}
