//! Predicts how nodes use many cores: `cargo bench -p maquette-tests --bench cores -- [NODE ...]`, for the given nodes of the graph
//! `benches/cores.ron`, by default all. Ten of its nodes have inputs of more than 100 000 elements.
//!
//! `work` is the CPU time on one thread, `span` the time that remains on unlimited threads, both in seconds, and `serial` is the ratio
//! `span / work`. The columns `x 2`, `x 8` and `x 16` are the predicted ratios to the time on one thread, by Brent's bound. `cpu` is CPU
//! time over wall time on two threads, measured, which another load makes smaller.

#![allow(clippy::print_stdout, reason = "the table goes to whoever measures")]

use std::path::Path;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use maquette::parallel::{WorkSpan, finish_span, start_span};
use maquette::{CancelToken, Catalog, Evaluator, Graph, Observer, Options, State};
use rustix::time::{ClockId, clock_gettime};

fn main() {
    let nodes: Vec<_> = std::env::args().skip(1).filter(|word| !word.starts_with('-')).collect();
    // A path beside the files that the graph reads.
    let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../graphs/cores.ron"));
    let options = Options::default().with_text(path, include_str!("cores.ron"));
    let checked = Graph::load(path, &Catalog::new(maquette_nodes::PACKS), &options);
    let Some(graph) = checked.graph else {
        checked.diagnostics.iter().for_each(|diagnostic| println!("{}", diagnostic.message));
        return;
    };
    let meter = Meter { nodes: &nodes, rows: Mutex::default(), start: Mutex::default() };
    evaluate(&graph, 1, &meter);
    evaluate(&graph, 2, &meter);
    let rows = meter.rows.into_inner().expect("no panic");
    println!(
        "{:20} {:>8} {:>8} {:>7} {:>5} {:>5} {:>5} {:>8} {:>5}",
        "node", "work", "span", "serial", "x 2", "x 8", "x 16", "wall", "cpu"
    );
    for Row { node, span, wall, cpu } in rows {
        let work = span.work.as_secs_f64();
        let [two, eight, sixteen] = [2, 8, 16].map(|n| work / span.on(n).as_secs_f64());
        let (span, ratio) = (span.span.as_secs_f64(), cpu.div_duration_f64(wall));
        let (serial, wall) = (span / work, wall.as_secs_f64());
        println!(
            "{node:20} {work:8.2} {span:8.3} {serial:7.3} {two:5.2} {eight:5.1} {sixteen:5.1} {wall:8.2} {ratio:5.2}"
        );
    }
}

/// The measurements of a node.
struct Row {
    node: String,
    span: WorkSpan,
    /// The wall time on two threads.
    wall: Duration,
    /// The CPU time on two threads.
    cpu: Duration,
}

/// Measures the selected nodes: first on one thread, then on two.
struct Meter<'a> {
    nodes: &'a [String],
    rows: Mutex<Vec<Row>>,
    start: Mutex<Option<(Instant, Duration)>>,
}

impl Meter<'_> {
    fn is_selected(&self, node: &str) -> bool {
        self.nodes.is_empty() || self.nodes.iter().any(|it| it == node)
    }
}

impl Observer for Meter<'_> {
    fn on_start(&self, node: &str) {
        if !self.is_selected(node) {
            return;
        }
        if rayon::current_num_threads() == 1 {
            start_span(|| cpu_time(ClockId::ThreadCPUTime));
        } else {
            let start = (Instant::now(), cpu_time(ClockId::ProcessCPUTime));
            *self.start.lock().expect("no panic") = Some(start);
        }
    }

    fn on_finish(&self, node: &str, _: State, _: f64) {
        if !self.is_selected(node) {
            return;
        }
        let mut rows = self.rows.lock().expect("no panic");
        if rayon::current_num_threads() == 1 {
            if let Some(span) = finish_span() {
                let [wall, cpu] = [Duration::ZERO; 2];
                rows.push(Row { node: node.to_owned(), span, wall, cpu });
            }
        } else if let Some((start, before)) = self.start.lock().expect("no panic").take() {
            for row in rows.iter_mut().filter(|row| row.node == node) {
                row.wall = start.elapsed();
                row.cpu = cpu_time(ClockId::ProcessCPUTime) - before;
            }
        }
    }
}

fn evaluate(graph: &Graph, threads: usize, observer: &dyn Observer) {
    let mut evaluator = Evaluator::new(threads, 8 << 30).expect("threads");
    evaluator.evaluate_all_nodes(graph, observer, &CancelToken::default());
}

fn cpu_time(clock: ClockId) -> Duration {
    let time = clock_gettime(clock);
    Duration::new(time.tv_sec as u64, time.tv_nsec as u32)
}
