//! `--profile`: where the time and the memory of a run went.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use super::in_bytes;
use crate::eval::{NodeTrace, Trace};
use crate::writing::{Place, Refused};

/// A table of the nodes, the slowest first.
pub(super) fn table(trace: &Trace) -> String {
    let total: f64 = trace.0.iter().map(|node| node.seconds).sum();
    let mut nodes = Vec::from_iter(&trace.0);
    nodes.sort_by(|a, b| b.seconds.total_cmp(&a.seconds));
    let width = |cell: fn(&NodeTrace) -> &str| {
        nodes.iter().map(|node| cell(node).len()).max().unwrap_or(0).max(4)
    };
    let (names, kinds) = (width(|node| &node.name), width(|node| &node.node));
    let mut text = format!(
        "{:<names$}  {:<kinds$}  {:<8}  {:>10}  {:>6}  {:>10}  thread\n",
        "node", "type", "state", "time", "share", "memory"
    );
    for node in nodes {
        let share = if 0.0 < total { 100.0 * node.seconds / total } else { 0.0 };
        let (time, state) = (format!("{:.1} ms", node.seconds * 1e3), node.state.word());
        let (memory, thread) = (in_bytes(node.bytes), node.thread);
        let _ = writeln!(
            text,
            "{:<names$}  {:<kinds$}  {state:<8}  {time:>10}  {share:>4.0} %  {memory:>10}  {thread:>6}",
            node.name, node.node
        );
    }
    let time = format!("{:.1} ms", total * 1e3);
    let memory = in_bytes(trace.0.iter().map(|node| node.bytes).sum());
    let _ = writeln!(
        text,
        "{:<names$}  {:<kinds$}  {:<8}  {time:>10}  {:>4} %  {memory:>10}",
        "all", "", "", 100
    );
    text
}

/// Writes the trace for Chrome's tracing page or Perfetto: `GRAPH.trace.json` among the outputs.
pub(super) fn write_trace(
    trace: &Trace,
    graph: &Path,
    folder: &Path,
    place: &Place<'_>,
) -> Result<PathBuf, Refused> {
    let name = graph.file_stem().unwrap_or_default().to_string_lossy();
    let path = folder.join(format!("{name}.trace.json"));
    place.write(&path, trace.to_chrome().to_string().as_bytes())?;
    Ok(path)
}
