//! Measures the overhead of the engine, with graphs of trivial nodes, and with a cheap node after an expensive one.
//!
//! Graphs are evaluated on two threads. Each bench makes the change that its name describes before each evaluation, and measures only the
//! evaluation. `benches/peers` runs equal chains and trees in other programs (peers): salsa and Blender.
//!
//! There is no performance target: the results are compared with those of the peers.

use divan::{Bencher, black_box};
use maquette::{Catalog, Evaluator, Graph, Options, Pack};

#[path = "shared/numbers.rs"]
mod numbers;

use numbers::PACK;

fn main() {
    divan::main();
}

const CHAIN: usize = 10_000;

fn load(text: &str, packs: &[&Pack]) -> Graph {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.keep().join("graph.ron");
    std::fs::write(&path, text).expect("a file");
    std::fs::write(path.with_file_name("ring.obj"), ring()).expect("a file");
    let checked = Graph::load(&path, &Catalog::new(packs), &Options::default());
    checked.graph.unwrap_or_else(|| panic!("{}", checked.diagnostics[0].message))
}

/// Returns a graph with a chain of additions. `changed` is the index of one node and the number that it adds. All other nodes add 1.
fn chain(changed: Option<(usize, u32)>) -> Graph {
    fn number(k: usize, changed: &Option<(usize, u32)>) -> f64 {
        match *changed {
            Some((place, number)) if place == k => f64::from(number),
            _ => 1.0,
        }
    }
    fn link(k: usize) -> String {
        if k == 0 { String::new() } else { format!("to: \"n{}\", ", k - 1) }
    }
    let nodes = (0..CHAIN)
        .map(|k| format!("\"n{k}\": Add({}number: {:?}),\n", link(k), number(k, &changed)));
    let text =
        format!("Graph(format: 1, nodes: {{ {} }}, outputs: {{}})", String::from_iter(nodes));
    load(&text, &[&PACK])
}

fn evaluator() -> Evaluator {
    Evaluator::new(2, 1 << 30).expect("threads")
}

/// Evaluates the last node of the chain.
fn evaluate(evaluator: &mut Evaluator, graph: &Graph) {
    black_box(evaluator.evaluate_nodes(graph, &[&format!("n{}", CHAIN - 1)]));
}

#[divan::bench(sample_count = 21)]
fn chain_first_evaluation(bencher: Bencher<'_, '_>) {
    let graph = chain(None);
    bencher.with_inputs(evaluator).bench_refs(|evaluator| evaluate(evaluator, &graph));
}

#[divan::bench(sample_count = 101)]
fn chain_nothing_changed(bencher: Bencher<'_, '_>) {
    let (graph, mut evaluator) = (chain(None), evaluator());
    evaluate(&mut evaluator, &graph);
    bencher.bench_local(|| evaluate(&mut evaluator, &graph));
}

#[divan::bench(sample_count = 101)]
fn chain_loaded_again_and_nothing_changed(bencher: Bencher<'_, '_>) {
    let (graphs, mut evaluator) = ([chain(None), chain(None)], evaluator());
    evaluate(&mut evaluator, &graphs[1]);
    let mut turn = 0;
    bencher.bench_local(|| {
        turn = 1 - turn;
        evaluate(&mut evaluator, &graphs[turn]);
    });
}

/// Evaluates the chain again and again. Each time, the node with the index `place` adds a new number, so its result is not in the cache.
fn changed_at(bencher: Bencher<'_, '_>, place: usize) {
    let graphs: Vec<_> = (2..66).map(|number| chain(Some((place, number)))).collect();
    let mut evaluator = evaluator();
    evaluate(&mut evaluator, &graphs[0]);
    let mut turn = 0;
    bencher.bench_local(|| {
        turn += 1;
        evaluate(&mut evaluator, &graphs[turn]);
    });
}

#[divan::bench(sample_count = 21, sample_size = 1)]
fn chain_last_changed(bencher: Bencher<'_, '_>) {
    changed_at(bencher, CHAIN - 1);
}

#[divan::bench(sample_count = 21, sample_size = 1)]
fn chain_first_changed(bencher: Bencher<'_, '_>) {
    changed_at(bencher, 0);
}

/// Returns a torus of 6 000 triangles as an OBJ file.
fn ring() -> String {
    const AROUND: usize = 60;
    const ACROSS: usize = 50;
    fn turn(k: usize, of: usize) -> f64 {
        k as f64 / of as f64 * std::f64::consts::TAU
    }
    let mut text = String::new();
    for (i, j) in (0..AROUND).flat_map(|i| (0..ACROSS).map(move |j| (i, j))) {
        let (a, b) = (turn(i, AROUND), turn(j, ACROSS));
        let radius = 3.0 + libm::cos(b);
        text +=
            &format!("v {} {} {}\n", radius * libm::cos(a), radius * libm::sin(a), libm::sin(b));
    }
    fn vertex(i: usize, j: usize) -> usize {
        i % AROUND * ACROSS + j % ACROSS + 1
    }
    for (i, j) in (0..AROUND).flat_map(|i| (0..ACROSS).map(move |j| (i, j))) {
        let [a, b, c, d] =
            [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)].map(|(i, j)| vertex(i, j));
        text += &format!("f {a} {b} {c}\nf {a} {c} {d}\n");
    }
    text
}

/// Returns a graph that subdivides the torus three times, to 384 000 triangles, and then moves the result.
fn subdivision_graph(step: u32) -> Graph {
    let text = format!(
        "Graph(format: 1, nodes: {{
            \"mesh\": ReadMesh(path: \"ring.obj\"),
            \"fine\": Subdivide(mesh: \"mesh\", scheme: Loop, levels: 3),
            \"moved\": Transform(mesh: \"fine\", translate: ({step}, 0, 0)),
        }}, outputs: {{}})"
    );
    load(&text, maquette_nodes::PACKS)
}

#[divan::bench(sample_count = 21, sample_size = 1)]
fn cheap_behind_subdivision_changed(bencher: Bencher<'_, '_>) {
    let graphs: Vec<_> = (0..66).map(subdivision_graph).collect();
    let mut evaluator = evaluator();
    evaluator.evaluate_nodes(&graphs[0], &["moved"]);
    let mut turn = 0;
    bencher.bench_local(|| {
        turn += 1;
        black_box(evaluator.evaluate_nodes(&graphs[turn], &["moved"]));
    });
}

#[divan::bench(sample_count = 101)]
fn cheap_behind_subdivision_nothing_changed(bencher: Bencher<'_, '_>) {
    let (graph, mut evaluator) = (subdivision_graph(1), evaluator());
    // Wait, because a file that was just written is read again by each evaluation: a second write at nearly the same time might go
    // unnoticed.
    std::thread::sleep(std::time::Duration::from_secs(1));
    evaluator.evaluate_nodes(&graph, &["moved"]);
    bencher.bench_local(|| black_box(evaluator.evaluate_nodes(&graph, &["moved"])));
}
