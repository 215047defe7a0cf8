//! `--profile`: where the time and the memory of a run went.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use maquette_engine::Exchange;
use maquette_engine::eval::RunTrace;
use maquette_engine::session::Written;
use maquette_engine::writing::{Destination, Refused};

use super::{column_width, in_bytes};

/// How many seconds it took to read the graph, and the files of its nodes.
pub(super) struct Read {
    pub(super) graph: f64,
    pub(super) files: f64,
}

/// A line of the table.
struct Row<'a> {
    name: &'a str,
    kind: &'a str,
    state: &'a str,
    seconds: f64,
    bytes: usize,
    thread: String,
}

/// A table of the nodes, of what was read and of what was written, the slowest first. Times on several threads at once add up.
pub(super) fn table(trace: &RunTrace, read: &Read, written: &[Written]) -> String {
    let nodes = trace.0.iter().map(|node| Row {
        name: &node.name,
        kind: &node.node,
        state: node.state.word(),
        seconds: node.seconds,
        bytes: node.bytes,
        thread: node.thread.to_string(),
    });
    let aside = |name, kind, state, seconds| Row {
        name,
        kind,
        state,
        seconds,
        bytes: 0,
        thread: String::new(),
    };
    let outputs = written.iter().map(|file| match file.unchanged {
        true => aside(&file.output, "output", "as it was", file.seconds),
        false => aside(&file.output, "output", "written", file.seconds),
    });
    let reading = [aside("graph", "", "read", read.graph), aside("files", "", "read", read.files)];
    let mut rows: Vec<_> = nodes.chain(reading).chain(outputs).collect();
    rows.sort_by(|a, b| b.seconds.total_cmp(&a.seconds));
    let total: f64 = rows.iter().map(|row| row.seconds).sum();
    let width = |cell: fn(&Row<'_>) -> usize| column_width(rows.iter().map(cell)).max("node".len());
    let (names, kinds) = (width(|row| row.name.len()), width(|row| row.kind.len()));
    let mut text = format!(
        "{:<names$}  {:<kinds$}  {:<9}  {:>10}  {:>6}  {:>10}  thread\n",
        "node", "type", "state", "time", "share", "memory"
    );
    for row in &rows {
        let share = if 0.0 < total { 100.0 * row.seconds / total } else { 0.0 };
        let Row { name, kind, state, thread, .. } = row;
        let (time, memory) = (milliseconds(row.seconds), in_bytes(row.bytes));
        let _ = writeln!(
            text,
            "{name:<names$}  {kind:<kinds$}  {state:<9}  {time:>10}  {share:>4.0} %  {memory:>10}  {thread:>6}",
        );
    }
    let (time, memory) = (milliseconds(total), in_bytes(rows.iter().map(|row| row.bytes).sum()));
    let _ = writeln!(
        text,
        "{:<names$}  {:<kinds$}  {:<9}  {time:>10}  {:>4} %  {memory:>10}",
        "all", "", "", 100
    );
    text
}

/// What the server of results was asked for.
pub(super) fn exchange(exchange: &Exchange) -> String {
    let Exchange { found, missing, damaged, .. } = exchange;
    format!("server of results: {found} files found, {missing} missing, {damaged} damaged\n")
}

fn milliseconds(seconds: f64) -> String {
    format!("{:.1} ms", seconds * 1e3)
}

/// Writes the trace for Chrome's tracing page or Perfetto: `GRAPH.trace.json` among the outputs.
pub(super) fn write_trace(
    trace: &RunTrace,
    graph: &Path,
    folder: &Path,
    destination: &Destination<'_>,
) -> Result<PathBuf, Refused> {
    let name = graph.file_stem().unwrap_or_default().to_string_lossy();
    let path = folder.join(format!("{name}.trace.json"));
    destination.write(&path, trace.to_chrome().to_string().as_bytes())?;
    Ok(path)
}
