//! Measures how the work of nodes grows with the size of a mesh: `cargo bench -p maquette-tests --bench growth -- [NODE ...]`, for the given
//! nodes of the graph `benches/growth.ron`, by default all. Each size has four times as many faces as the one before.
//!
//! For each size, prints the CPU time on one thread in milliseconds, and the memory in megabytes: the peak of the process beyond what it had
//! before. `x` is the ratio of the times of the two largest sizes. It is 4 for linear growth, and 4.5 at most for `n log n`. A node that has
//! taken more than [`MAX_SECONDS`] is not measured at larger sizes.

#![allow(clippy::print_stdout, reason = "the table goes to whoever measures")]

use std::sync::Mutex;
use std::time::Duration;

use maquette::{Observer, State};
use nodes::{cpu_time, evaluate, load, session};
use rustix::time::ClockId;

#[path = "shared/nodes.rs"]
mod nodes;

/// The numbers of subdivisions: meshes of 48 000, 194 000, 775 000 and 3.1 million triangles.
const LEVELS: [u32; 4] = [2, 3, 4, 5];

/// The maximum time of a node that is also measured at the next larger size.
const MAX_SECONDS: f64 = 20.0;

fn main() {
    let words: Vec<_> = std::env::args().skip(1).filter(|word| !word.starts_with('-')).collect();
    let text = include_str!("growth.ron");
    let graph = load(text, &[]);
    let all = graph.nodes().iter().map(|node| node.name.clone());
    let selected: Vec<_> = all.filter(|name| words.is_empty() || words.contains(name)).collect();
    println!("{:12} {:>6} {}", "node", "x", "ms (MB)   ".repeat(LEVELS.len()));
    for node in selected {
        let mut measured: Vec<Cost> = Vec::new();
        for level in LEVELS {
            if measured.last().is_some_and(|last| MAX_SECONDS < last.time.as_secs_f64()) {
                break;
            }
            let meter = Meter { node: &node, start: Mutex::default(), cost: Mutex::default() };
            let graph = load(text, &[("levels", level.to_string())]);
            evaluate(&graph, std::slice::from_ref(&node), &mut session(1), &meter);
            measured.extend(meter.cost.into_inner().expect("no panic"));
        }
        let ratio = match &measured[..] {
            [.., before, last] => last.time.div_duration_f64(before.time),
            _ => f64::NAN,
        };
        let costs = measured.iter().map(|cost| {
            format!("{:>9.1} ({:>5})", 1e3 * cost.time.as_secs_f64(), cost.kilobytes / 1024)
        });
        println!("{node:12} {ratio:6.2} {}", costs.collect::<String>());
    }
}

/// What a node took.
struct Cost {
    time: Duration,
    kilobytes: u64,
}

/// Measures one node, which runs on a pool of one thread.
struct Meter<'a> {
    node: &'a str,
    /// The CPU time and the memory before the node.
    start: Mutex<Option<(Duration, u64)>>,
    cost: Mutex<Option<Cost>>,
}

impl Observer for Meter<'_> {
    fn on_start(&self, node: &str) {
        if node == self.node {
            // Linux then counts the peak anew.
            let _ = std::fs::write("/proc/self/clear_refs", "5");
            let start = (cpu_time(ClockId::ThreadCPUTime), memory("VmRSS"));
            *self.start.lock().expect("no panic") = Some(start);
        }
    }

    fn on_finish(&self, node: &str, _: State, _: f64) {
        if let Some((start, before)) =
            self.start.lock().expect("no panic").take_if(|_| node == self.node)
        {
            let time = cpu_time(ClockId::ThreadCPUTime) - start;
            let kilobytes = memory("VmHWM").saturating_sub(before);
            *self.cost.lock().expect("no panic") = Some(Cost { time, kilobytes });
        }
    }
}

/// Returns a line of the process's state in kilobytes, 0 if it is not known.
fn memory(name: &str) -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix(name));
    line.and_then(|line| line.split_whitespace().nth(1)?.parse().ok()).unwrap_or(0)
}
