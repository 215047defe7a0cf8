//! `maquette check --preflight`: prints what a run needs, before anything large is read.

use std::fmt::Write as _;
use std::path::PathBuf;

use maquette_engine::eval::needs::{NodeNeeds, RunNeeds};
use maquette_graph::Graph;
use maquette_node::{Certainty, ValueSize};
use maquette_syntax::error::Diagnostic;
use serde_json::{Value as Json, json};

use super::{DisplayPath, column_width, format_count, in_bytes};

/// The needs of a run of a graph.
pub(super) struct Preflight {
    pub(super) path: PathBuf,
    pub(super) graph: Graph,
    pub(super) needs: RunNeeds,
}

impl Preflight {
    /// Returns an error or a warning for each node that needs more memory than is allowed.
    pub(super) fn diagnostics(&self) -> &[Diagnostic] {
        &self.needs.diagnostics
    }

    /// Returns the sum of the times of all nodes in seconds, without those that are unknown.
    fn seconds(&self) -> f64 {
        self.needs
            .nodes
            .iter()
            .filter_map(|node| node.seconds)
            .fold(0.0, |sum, seconds| sum + seconds)
    }

    /// Returns the sum of the sizes of all results in bytes, without those that are unknown.
    fn bytes(&self) -> f64 {
        let sizes = self.needs.nodes.iter().filter_map(NodeNeeds::size);
        sizes.fold(0.0, |sum, size| sum + size.bytes)
    }
}

/// Returns the table of the needs of each node.
pub(super) fn table(preflight: &Preflight) -> String {
    let nodes = preflight.graph.nodes();
    let rows: Vec<[String; 7]> = preflight
        .needs
        .nodes
        .iter()
        .map(|needs| {
            let node = &nodes[needs.index];
            row(needs, &node.name, node.kind())
        })
        .collect();
    let head = ["node", "type", "state", "size", "is", "memory", "time"].map(str::to_owned);
    let widths: [usize; 7] = std::array::from_fn(|column| {
        column_width(rows.iter().chain([&head]).map(|row| row[column].chars().count()))
    });
    let mut text = format!("{}\n", preflight.path.for_display());
    for row in [&head].into_iter().chain(&rows) {
        let cells =
            row.iter().zip(widths).enumerate().map(|(column, (cell, width))| match column {
                0..=2 | 4 => format!("{cell:<width$}"),
                _ => format!("{cell:>width$}"),
            });
        let _ = writeln!(text, "{}", cells.collect::<Vec<_>>().join("  ").trim_end());
    }
    let RunNeeds { peak, max_bytes, .. } = preflight.needs;
    let unknown = preflight.needs.nodes.iter().filter(|node| node.seconds.is_none()).count();
    let time = match unknown {
        0 => in_seconds(preflight.seconds()),
        1 => format!("{} without 1 node", in_seconds(preflight.seconds())),
        _ => format!("{} without {unknown} nodes", in_seconds(preflight.seconds())),
    };
    let _ = writeln!(
        text,
        "all: results {}, at most {} at a time, {} are allowed; time {time}",
        in_gigabytes(preflight.bytes()),
        in_gigabytes(peak),
        in_gigabytes(max_bytes as f64),
    );
    text
}

/// Returns the cells of a node's row.
fn row(needs: &NodeNeeds, name: &str, kind: &str) -> [String; 7] {
    let size = needs.size();
    [
        name.to_owned(),
        kind.to_owned(),
        needs.state.to_owned(),
        size.map_or_else(|| "unknown".to_owned(), describe),
        size.map_or("", |size| word(size.certainty)).to_owned(),
        needs.memory.map_or_else(|| "unknown".to_owned(), in_gigabytes),
        needs.seconds.map_or_else(|| "unknown".to_owned(), in_seconds),
    ]
}

/// Returns the number of faces or points.
fn describe(size: ValueSize) -> String {
    if size.faces > 0.0 {
        format_count(size.faces as usize, "face")
    } else {
        format_count(size.points as usize, "point")
    }
}

fn word(certainty: Certainty) -> &'static str {
    match certainty {
        Certainty::Exact => "exact",
        Certainty::Predicted => "predicted",
        Certainty::Guess => "a guess",
    }
}

/// Formats a number of bytes, such as `4.1 GB`.
fn in_gigabytes(bytes: f64) -> String {
    if bytes < 1e9 { in_bytes(bytes as usize) } else { format!("{:.1} GB", bytes / 1e9) }
}

fn in_seconds(seconds: f64) -> String {
    if seconds < 1.0 { format!("{:.0} ms", seconds * 1e3) } else { format!("{seconds:.0} s") }
}

/// Returns the needs as JSON, in the form that the option `--json` prints.
pub(super) fn as_json(preflight: &Preflight) -> Json {
    let nodes = preflight.needs.nodes.iter().map(|needs| {
        let node = &preflight.graph.nodes()[needs.index];
        let size = needs.size();
        json!({
            "name": node.name,
            "node": node.kind(),
            "state": needs.state,
            "points": size.map(|size| size.points),
            "faces": size.map(|size| size.faces),
            "bytes": size.map(|size| size.bytes),
            "size_is": size.map(|size| word(size.certainty)),
            "memory": needs.memory,
            "seconds": needs.seconds,
        })
    });
    json!({
        "graph": preflight.path.display().to_string(),
        "nodes": nodes.collect::<Vec<_>>(),
        "bytes": preflight.bytes(),
        "peak": preflight.needs.peak,
        "max_memory": preflight.needs.max_bytes,
        "seconds": preflight.seconds(),
    })
}
