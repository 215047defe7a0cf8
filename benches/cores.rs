//! Predicts how nodes use many cores: `cargo bench -p maquette-tests --bench cores -- [NODE ...]`, for the given nodes of the graph
//! `benches/cores.ron`, by default all. Ten of its nodes have inputs of more than 100 000 elements.
//!
//! `work` is the CPU time on one thread, `span` the time that remains on unlimited threads, both in seconds, and `serial` is the ratio
//! `span / work`. The columns `x 2`, `x 8` and `x 16` are the predicted ratios to the time on one thread, by Brent's bound. `cpu` is CPU
//! time over wall time on two threads, measured, which another load makes smaller.

#![allow(clippy::print_stdout, reason = "the table goes to whoever measures")]

use std::sync::Mutex;
use std::time::Instant;

use maquette::parallel::{WorkSpan, finish_span, start_span};
use maquette::{Graph, Observer, State};
use nodes::{cpu_time, evaluate, load, session};
use rustix::time::ClockId;

#[path = "shared/nodes.rs"]
mod nodes;

fn main() {
    let words: Vec<_> = std::env::args().skip(1).filter(|word| !word.starts_with('-')).collect();
    let graph = load(include_str!("cores.ron"), &[]);
    let all = graph.nodes().iter().map(|node| node.name.clone());
    let selected: Vec<_> = all.filter(|name| words.is_empty() || words.contains(name)).collect();
    let meter = Meter { rows: Mutex::default() };
    evaluate(&graph, &selected, &mut session(1), &meter);
    println!(
        "{:20} {:>8} {:>8} {:>7} {:>5} {:>5} {:>5} {:>8} {:>5}",
        "node", "work", "span", "serial", "x 2", "x 8", "x 16", "wall", "cpu"
    );
    let rows = meter.rows.into_inner().expect("no panic");
    for (node, measured) in rows.into_iter().filter(|(node, _)| selected.contains(node)) {
        let work = measured.work.as_secs_f64();
        let [two, eight, sixteen] = [2, 8, 16].map(|n| work / measured.on(n).as_secs_f64());
        let span = measured.span.as_secs_f64();
        let (wall, cpu) = on_two_threads(&graph, &node);
        println!(
            "{node:20} {work:8.2} {span:8.3} {:7.3} {two:5.2} {eight:5.1} {sixteen:5.1} {wall:8.2} {:5.2}",
            span / work,
            cpu / wall
        );
    }
}

/// Evaluates a node on two threads, after the nodes on which it depends. Returns the wall time and the CPU time in seconds.
fn on_two_threads(graph: &Graph, node: &str) -> (f64, f64) {
    let mut session = session(2);
    let links = graph.nodes_of(node).into_iter().flat_map(|node| &graph.nodes()[node].links);
    let dependencies: Vec<_> = links.map(|link| graph.nodes()[link.node].name.clone()).collect();
    evaluate(graph, &dependencies, &mut session, &());
    let (start, before) = (Instant::now(), cpu_time(ClockId::ProcessCPUTime));
    evaluate(graph, &[node.to_owned()], &mut session, &());
    let cpu = cpu_time(ClockId::ProcessCPUTime) - before;
    (start.elapsed().as_secs_f64(), cpu.as_secs_f64())
}

/// Measures the spans of all nodes, which run on a pool of one thread.
struct Meter {
    rows: Mutex<Vec<(String, WorkSpan)>>,
}

impl Observer for Meter {
    fn on_start(&self, _: &str) {
        start_span(|| cpu_time(ClockId::ThreadCPUTime));
    }

    fn on_finish(&self, node: &str, _: State, _: f64) {
        if let Some(span) = finish_span() {
            self.rows.lock().expect("no panic").push((node.to_owned(), span));
        }
    }
}
