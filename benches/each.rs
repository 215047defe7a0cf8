//! Measures the cost of a `ForEach` loop over 5 000 regions of a picture of a megapixel, on two threads. The node that is repeated is
//! trivial, so this is the time of the engine itself.

use std::path::PathBuf;

use divan::{Bencher, black_box};
use maquette::value::Points;
use maquette::{AnyValue, Catalog, Graph, Options, Pack, Run, Session, Settings, node};
use regions::{Center, Collect, grid};

#[path = "../tests/common/regions.rs"]
mod regions;

fn main() {
    divan::main();
}

const PACK: Pack =
    Pack { name: "regions", nodes: &[node::<Center>(), node::<Collect>()], ..Pack::EMPTY };

const TEXT: &str = r#"Graph(
    format: 1,
    inputs: { "labels": Labels() },
    nodes: {
        "regions": ForEach(graph: "Center", over: "labels"),
        "all": Collect(points: "regions"),
    },
    outputs: { "all": "all" },
)"#;

fn load() -> Graph {
    let path = PathBuf::from("regions.ron");
    let options = Options::default().with_text(&path, TEXT);
    let checked = Graph::load(&path, &Catalog::new(&[&PACK]), &options);
    checked.graph.unwrap_or_else(|| panic!("{:?}", checked.diagnostics))
}

fn session() -> Session {
    let settings = Settings { threads: 2, memory: 1 << 30, ..Settings::in_memory() };
    Session::new(&[&PACK], &settings).expect("threads")
}

fn run(session: &mut Session, graph: &Graph, labels: &AnyValue) {
    let inputs = [("labels".to_owned(), labels.clone())].into();
    let found = session.run(graph, &Run { inputs, ..Run::default() });
    let found = found.unwrap_or_else(|problems| panic!("{problems:?}"));
    assert!(found.get::<Points>("all").expect("points").positions().len() == 5000);
}

/// Target: at most 100 ms.
#[divan::bench]
fn check(bencher: Bencher<'_, '_>) {
    bencher.bench(|| black_box(load()));
}

/// Runs 5 000 regions without cached results.
#[divan::bench(sample_count = 11)]
fn first_run(bencher: Bencher<'_, '_>) {
    let (graph, labels) = (load(), grid(None));
    bencher.with_inputs(session).bench_values(|mut session| run(&mut session, &graph, &labels));
}

/// Changes one region before each run, a different one each time. Then the node of that region runs, and the node that collects all
/// regions.
#[divan::bench(sample_count = 21)]
fn one_changed(bencher: Bencher<'_, '_>) {
    let (graph, mut session, mut changed) = (load(), session(), 0);
    run(&mut session, &graph, &grid(None));
    let next = || {
        changed += 77;
        grid(Some(changed % 5000))
    };
    bencher.with_inputs(next).bench_local_values(|labels| run(&mut session, &graph, &labels));
}

/// Runs again without any change.
#[divan::bench(sample_count = 21)]
fn run_unchanged(bencher: Bencher<'_, '_>) {
    let (graph, mut session, labels) = (load(), session(), grid(None));
    run(&mut session, &graph, &labels);
    bencher.bench_local(|| run(&mut session, &graph, &labels));
}
