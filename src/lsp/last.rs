//! What the last evaluation of a graph found, by whatever process: shapes, times and sizes, without a value.

use std::fmt::Write;

use maquette_engine::eval::Remembered;
use maquette_engine::session::Session;
use maquette_graph::Graph;

use super::slot::takes;

/// What is known of a graph's last evaluation.
#[derive(Default)]
pub(super) struct Last {
    graph: Option<Graph>,
    results: Vec<Option<Remembered>>,
}

/// What is told of a node or an output.
pub(super) struct Told {
    shape: String,
    seconds: f64,
    bytes: usize,
    is_current: bool,
}

impl Last {
    /// Looks it up; nothing is run.
    pub(super) fn of(graph: &Graph, session: &mut Session) -> Self {
        let graph = session.as_last_known(graph);
        let results = session.remembered(&graph);
        Self { graph: Some(graph), results }
    }

    /// Of what a link, or the name of a node, leads to. The time and size of a use are those of all nodes in it.
    pub(super) fn told(&self, link: &str) -> Option<Told> {
        let graph = self.graph.as_ref()?;
        let name = link.split('.').next()?;
        let nodes = graph.nodes_of(name);
        let results =
            nodes.iter().filter_map(|&node| self.results.get(node)?.as_ref()).collect::<Vec<_>>();
        let (node, output) = graph.target(link).or_else(|| nodes.first().map(|&node| (node, 0)))?;
        let found = self.results.get(node)?.as_ref()?;
        Some(Told {
            shape: found.shapes.get(output).cloned().unwrap_or_default(),
            seconds: results.iter().map(|result| result.seconds).sum(),
            bytes: results.iter().map(|result| result.bytes).sum(),
            is_current: results.len() == nodes.len()
                && results.iter().all(|result| result.is_current),
        })
    }

    /// A sentence about it; empty if nothing is known.
    pub(super) fn in_words(&self, link: &str) -> String {
        let Some(told) = self.told(link) else { return String::new() };
        let when = if told.is_current {
            "last"
        } else {
            "stale: something that it hangs on has changed; last"
        };
        let gap = if told.shape.is_empty() { "" } else { ", " };
        let (shape, time, size) = (&told.shape, in_time(told.seconds), in_size(told.bytes));
        format!("{when}: {shape}{gap}{time}, {size}")
    }

    /// What a parameter takes, and what is said of it.
    pub(super) fn parameter(&self, name: &str) -> Option<(String, String)> {
        let schema = self.graph.as_ref()?.schema();
        let field = schema.get("properties")?.get(name)?;
        let doc = field["description"].as_str().unwrap_or_default();
        Some((takes(field, schema), doc.to_owned()))
    }
}

impl Told {
    /// `1024 x 768, 12 ms`, as it stands behind a line.
    pub(super) fn in_short(&self) -> String {
        let mut words = self.shape.clone();
        let gap = if words.is_empty() { "" } else { ", " };
        let _ = write!(words, "{gap}{}", in_time(self.seconds));
        if !self.is_current {
            words += " (stale)";
        }
        words
    }
}

fn in_time(seconds: f64) -> String {
    match seconds {
        ..1e-3 => format!("{:.0} µs", seconds * 1e6),
        1e-3..1.0 => format!("{:.0} ms", seconds * 1e3),
        _ => format!("{seconds:.1} s"),
    }
}

fn in_size(bytes: usize) -> String {
    match bytes {
        0..1_000 => format!("{bytes} B"),
        1_000..1_000_000 => format!("{:.0} kB", bytes as f64 / 1e3),
        _ => format!("{:.1} MB", bytes as f64 / 1e6),
    }
}
