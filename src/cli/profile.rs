//! `--profile`: prints the time and the memory of each part of a run.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use maquette_engine::RequestCounts;
use maquette_engine::eval::RunTrace;
use maquette_engine::session::OutputFile;
use maquette_engine::writing::{Destination, WriteError};

use super::{column_width, in_bytes};

/// The time spent reading files, in seconds: the graph file, and the files that nodes read.
pub(super) struct ReadTimes {
    pub(super) graph: f64,
    pub(super) files: f64,
}

/// A line of the profile table.
struct Row<'a> {
    name: &'a str,
    kind: &'a str,
    state: &'a str,
    seconds: f64,
    bytes: usize,
    thread: String,
}

impl<'a> Row<'a> {
    /// Creates the row for a file that was read or written.
    fn for_file(name: &'a str, kind: &'a str, state: &'a str, seconds: f64) -> Self {
        Self { name, kind, state, seconds, bytes: 0, thread: String::new() }
    }
}

/// Returns a table of nodes, read files and written files, sorted by time, the slowest first. The total is the sum of all times, even of
/// nodes that ran in parallel.
pub(super) fn profile_table(trace: &RunTrace, read: &ReadTimes, written: &[OutputFile]) -> String {
    let nodes = trace.0.iter().map(|node| Row {
        name: &node.name,
        kind: &node.node,
        state: node.state.word(),
        seconds: node.seconds,
        bytes: node.bytes,
        thread: node.thread.to_string(),
    });
    let outputs = written.iter().map(|file| match file.unchanged {
        true => Row::for_file(&file.output, "output", "unchanged", file.seconds),
        false => Row::for_file(&file.output, "output", "written", file.seconds),
    });
    let reading = [
        Row::for_file("graph", "", "read", read.graph),
        Row::for_file("files", "", "read", read.files),
    ];
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

/// Describes the number of requests to the cache server and their results.
pub(super) fn describe_exchange(exchange: &RequestCounts) -> String {
    let RequestCounts { found, missing, damaged, .. } = exchange;
    format!("cache server: {found} files found, {missing} missing, {damaged} damaged\n")
}

fn milliseconds(seconds: f64) -> String {
    format!("{:.1} ms", seconds * 1e3)
}

/// Writes the trace of a run as `GRAPH.trace.json` into the output folder. Chrome's tracing page and Perfetto can show the file.
pub(super) fn write_trace(
    trace: &RunTrace,
    graph: &Path,
    folder: &Path,
    destination: &Destination<'_>,
) -> Result<PathBuf, WriteError> {
    let name = graph.file_stem().unwrap_or_default().to_string_lossy();
    let path = folder.join(format!("{name}.trace.json"));
    destination.write(&path, trace.to_chrome().to_string().as_bytes())?;
    Ok(path)
}
