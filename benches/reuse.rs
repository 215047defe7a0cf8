//! Measures the cost of graphs that use other graphs. A graph with two trivial nodes is used 2 041 times, nested three levels deep.
//!
//! Each use sets a parameter to its own value, so no two nodes have the same cache key. Graphs are evaluated on two threads.
//!
//! Each bench states its target, if it has one.

use std::path::PathBuf;

use divan::{Bencher, black_box};
use maquette::{Catalog, CheckedGraph, Evaluator, Graph, Options};

#[path = "shared/numbers.rs"]
mod numbers;

use numbers::PACK;

fn main() {
    divan::main();
}

/// Returns a graph that uses another graph `count` times in a chain: each use takes the result of the previous one.
fn level(used: &str, count: usize, is_first: bool) -> String {
    let uses = (0..count).map(|k| {
        let to = match k {
            0 if is_first => "zero".to_owned(),
            0 => "to".to_owned(),
            _ => format!("n{}", k - 1),
        };
        let number = if is_first {
            format!("{}", k * 1000)
        } else {
            format!("Expr(\"number * {count} + {k}\")")
        };
        format!("\"n{k}\": Used(to: \"{to}\", number: {number}),\n")
    });
    let (inputs, zero, output) = match is_first {
        true => ("", "\"zero\": Add(number: 0),\n", ""),
        false => (
            "inputs: { \"to\": Number() }, params: { \"number\": Number(default: 0) },",
            "",
            "\"sum\": \"LAST\"",
        ),
    };
    let output = output.replace("LAST", &format!("n{}", count - 1));
    format!(
        "Graph(format: 1, use: {{ \"Used\": \"{used}\" }}, {inputs} nodes: {{ {zero}{} }}, outputs: {{ {output} }})",
        String::from_iter(uses)
    )
}

const LEAF: &str = "Graph(format: 1, inputs: { \"to\": Number() }, params: { \"number\": Number(default: 0) },
    nodes: { \"a\": Add(to: \"to\", number: Param(\"number\")), \"b\": Add(to: \"a\", number: 1) }, outputs: { \"sum\": \"b\" })";

/// Writes graphs that use each other 13, 12 and 12 times, down to the graph with two nodes. Returns the path of the outermost graph.
fn project() -> PathBuf {
    let folder = tempfile::tempdir().expect("a temporary folder").keep();
    let files = [
        ("leaf.ron", LEAF.to_owned()),
        ("inner.ron", level("leaf.ron", 12, false)),
        ("outer.ron", level("inner.ron", 12, false)),
        ("graph.ron", level("outer.ron", 13, true)),
    ];
    for (name, text) in files {
        std::fs::write(folder.join(name), text).expect("a file");
    }
    folder.join("graph.ron")
}

fn load(path: &std::path::Path) -> Graph {
    let CheckedGraph { graph, diagnostics: problems, .. } =
        Graph::load(path, &Catalog::new(&[&PACK]), &Options::default());
    graph.unwrap_or_else(|| panic!("{}", problems[0].message))
}

/// Target: at most 100 ms.
#[divan::bench(sample_count = 21)]
fn check_2041_uses(bencher: Bencher<'_, '_>) {
    let path = project();
    bencher.bench(|| black_box(load(&path)));
}

fn evaluator() -> Evaluator {
    Evaluator::new(2, 1 << 30).expect("threads")
}

/// Target: at most 2 us for each of the 3 745 nodes, 7.5 ms in total.
#[divan::bench(sample_count = 51)]
fn evaluate_3745_nodes(bencher: Bencher<'_, '_>) {
    let graph = load(&project());
    assert_eq!(graph.node_names().count(), 3745);
    bencher.with_inputs(evaluator).bench_refs(|evaluator| {
        black_box(evaluator.evaluate_nodes(&graph, &["n12"]));
    });
}

#[divan::bench(sample_count = 51)]
fn evaluate_again(bencher: Bencher<'_, '_>) {
    let (graph, mut evaluator) = (load(&project()), evaluator());
    evaluator.evaluate_nodes(&graph, &["n12"]);
    bencher.bench_local(|| black_box(evaluator.evaluate_nodes(&graph, &["n12"])));
}
