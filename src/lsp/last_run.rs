//! The record of the last evaluation of a graph, by any process. It contains shapes, times and sizes of results, but not their values.

use std::fmt::Write;

use maquette_engine::eval::LastResult;
use maquette_engine::session::Session;
use maquette_graph::Graph;

use super::expected_syntax::takes;

/// The record of the last evaluation of a graph.
#[derive(Default)]
pub(super) struct LastRun {
    graph: Option<Graph>,
    results: Vec<Option<LastResult>>,
}

/// The shape, time and size of a result: the outputs of a node, or a single output.
pub(super) struct ResultSummary {
    shape: String,
    seconds: f64,
    bytes: usize,
    is_current: bool,
}

impl LastRun {
    /// Loads the record of the last evaluation of a graph. Nothing is evaluated.
    pub(super) fn load(graph: &Graph, session: &mut Session) -> Self {
        let graph = session.with_last_counts(graph);
        let results = session.last_results(&graph);
        Self { graph: Some(graph), results }
    }

    /// Returns the summary of the result of a link or a node name, or `None` if nothing is known. For a node that uses another graph, the
    /// time and size are totals over that graph's nodes.
    pub(super) fn summary(&self, link: &str) -> Option<ResultSummary> {
        let graph = self.graph.as_ref()?;
        let name = link.split('.').next()?;
        let nodes = graph.nodes_of(name);
        let results =
            nodes.iter().filter_map(|&node| self.results.get(node)?.as_ref()).collect::<Vec<_>>();
        let (node, output) = graph.target(link).or_else(|| nodes.first().map(|&node| (node, 0)))?;
        let found = self.results.get(node)?.as_ref()?;
        Some(ResultSummary {
            shape: found.descriptions.get(output).cloned().unwrap_or_default(),
            seconds: results.iter().map(|result| result.seconds).sum(),
            bytes: results.iter().map(|result| result.bytes).sum(),
            is_current: results.len() == nodes.len()
                && results.iter().all(|result| result.is_current),
        })
    }

    /// Describes the result of a link in a sentence. Returns an empty text if nothing is known about it.
    pub(super) fn describe(&self, link: &str) -> String {
        let Some(summary) = self.summary(link) else { return String::new() };
        let when =
            if summary.is_current { "last" } else { "outdated: a dependency has changed; last" };
        let gap = if summary.shape.is_empty() { "" } else { ", " };
        let (shape, time, size) =
            (&summary.shape, in_time(summary.seconds), in_size(summary.bytes));
        format!("{when}: {shape}{gap}{time}, {size}")
    }

    /// Returns the type and the documentation of a parameter of the graph.
    pub(super) fn parameter(&self, name: &str) -> Option<(String, String)> {
        let schema = self.graph.as_ref()?.schema();
        let field = schema.get("properties")?.get(name)?;
        let doc = field["description"].as_str().unwrap_or_default();
        Some((takes(field, schema), doc.to_owned()))
    }
}

impl ResultSummary {
    /// Formats the summary for an inlay hint, such as `1024 x 768, 12 ms`.
    pub(super) fn format_short(&self) -> String {
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
