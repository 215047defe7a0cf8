//! The block of text that a watch shows on a terminal: the diagnostics, and below them the status of the last run.

use std::path::Path;

use maquette_engine::eval::State;
use maquette_syntax::diagnostics::{render, sanitize};
use maquette_syntax::error::{Diagnostic, Severity};

use super::worker::Report;
use crate::DisplayPath;
use crate::terminal::wrap;
use crate::{column_width, count_severity};
use crate::{format_count, in_bytes};

/// The maximum number of rows for a list of names in the status, so that the diagnostics have room.
const MAX_ROWS: usize = 3;

/// The information that the block shows.
#[derive(Default)]
pub(super) struct Block {
    /// The path of the graph, as the user has given it.
    pub(super) graph: String,
    pub(super) folder: String,
    /// The link to the live page; `None` if there is no page.
    pub(super) link: Option<String>,
    /// The reason why the live page could not be opened in a browser.
    pub(super) browser_failure: Option<String>,
    pub(super) watched_files: usize,
    /// The reason why files are polled; `None` if the operating system reports changes.
    pub(super) polling_reason: Option<String>,
    /// The current diagnostics.
    pub(super) diagnostics: Vec<Diagnostic>,
    /// The number of the current run, counted from 1.
    pub(super) run: usize,
    /// The last completed evaluation.
    pub report: Option<Report>,
    /// The number of the last run without errors.
    pub(super) last_good_run: Option<usize>,
    /// True while the run with the number `run` is in progress.
    pub(super) is_running: bool,
    /// The name of the running node, and the finished fraction of its work (0 to 1) if it is known.
    pub(super) node: Option<(String, Option<f64>)>,
    /// Messages about nodes that still run after a cancellation.
    pub(super) unresponsive: Vec<String>,
    /// The error of the user's command, if its last call failed.
    pub(super) command_failure: Option<String>,
    pub(super) shows_profile: bool,
}

/// Formats text for a terminal. The text is colored if the field is true, and plain otherwise.
#[derive(Clone, Copy)]
struct Paint(bool);

impl Paint {
    fn style(self, style: &str, text: &str) -> String {
        let text = sanitize(text);
        if self.0 { format!("\x1b[{style}m{text}\x1b[0m") } else { text.into_owned() }
    }

    fn bold(self, text: &str) -> String {
        self.style("1", text)
    }

    fn dim(self, text: &str) -> String {
        self.style("2", text)
    }

    fn red(self, text: &str) -> String {
        self.style("1;31", text)
    }

    fn green(self, text: &str) -> String {
        self.style("32", text)
    }
}

impl Block {
    /// Returns the rows of the block for a terminal with this width and height.
    pub(super) fn rows(&self, (width, height): (usize, usize), color: bool) -> Vec<String> {
        let paint = Paint(color);
        let mut status = vec![self.head_row(paint)];
        // Show the report only if it is about the current run.
        match self.report.as_ref().filter(|report| report.run == self.run) {
            Some(report) if self.shows_profile => status.extend(profile_rows(report, width, paint)),
            Some(report) => status.extend(summary_rows(report, &self.folder, width, paint)),
            None => {}
        }
        status.extend(self.unresponsive.iter().map(|words| paint.red(words)));
        status.extend(self.command_failure.as_ref().map(|text| paint.red(text)));
        status.extend(self.link.as_ref().map(|link| paint.dim(&format!("live page: {link}"))));
        status.extend(self.browser_failure.as_ref().map(|why| paint.dim(why)));
        if let Some(why) = &self.polling_reason {
            status.push(paint.dim(&format!("polling files twice a second: {why}")));
        }
        status.push(self.foot_row(paint));
        let mut status: Vec<String> = status.iter().flat_map(|row| wrap(row, width)).collect();
        if status.len() > height {
            // If the terminal is too low, drop rows in the middle. Keep the first row (the result) and the last row (the keys) as long as
            // possible.
            let too_many = status.len() - height;
            let last = status.len() - 1;
            status.drain(last.saturating_sub(too_many).max(1).min(last)..last);
            status.truncate(height);
        }
        let mut rows = self.diagnostic_rows(width, height - status.len(), color);
        rows.extend(status);
        rows
    }

    fn head_row(&self, paint: Paint) -> String {
        let graph = paint.bold(&self.graph);
        if self.is_running {
            let node = self.node.as_ref().map(|(node, share)| match share {
                Some(share) => format!("computing {}, {:.0} %", sanitize(node), share * 100.0),
                None => format!("computing {}, progress unknown", sanitize(node)),
            });
            let node = node.unwrap_or_else(|| "running".into());
            return format!("{graph}  run {}: {node}", self.run);
        }
        let errors = count_severity(&self.diagnostics, Severity::Error);
        if errors > 0 {
            let errors = paint.red(&format_count(errors, "error"));
            let ran = self.report.as_ref().is_some_and(|report| report.run == self.run);
            let stays = match self.last_good_run {
                Some(good) if ran => {
                    format!("; outputs that were not written stay as in run {good}")
                }
                Some(good) => format!("; the outputs stay as in run {good}"),
                None => String::new(),
            };
            return format!("{graph}  run {}: {errors}{stays}", self.run);
        }
        let Some(report) = &self.report else { return format!("{graph}  run {}", self.run) };
        let warnings = match self.diagnostics.len() {
            0 => String::new(),
            count => format!(", {}", format_count(count, "warning")),
        };
        let (done, time) = (paint.green("up to date"), milliseconds(report.seconds));
        format!("{graph}  run {}: {done}, {time}{warnings}", self.run)
    }

    fn foot_row(&self, paint: Paint) -> String {
        let keys = "r run  f recompute  p profile  q quit";
        paint.dim(&format!("watching {}   {keys}", format_count(self.watched_files, "file")))
    }

    /// Returns the diagnostics that fit into `height` rows. If some do not fit, a row with their number and an empty row follow.
    fn diagnostic_rows(&self, width: usize, height: usize, color: bool) -> Vec<String> {
        let mut rows = Vec::new();
        for (index, diagnostic) in self.diagnostics.iter().enumerate() {
            let mut lines = wrap(&render(diagnostic, color, Some(width)), width);
            lines.push(String::new());
            let rest = self.diagnostics.len() - index - 1;
            let room = height.saturating_sub(rows.len() + usize::from(rest > 0) * 2);
            if lines.len() > room {
                let shown = if index == 0 { room.saturating_sub(2) } else { 0 };
                rows.extend(lines.into_iter().take(shown));
                let more = rest + usize::from(shown == 0);
                let more = match (more, shown) {
                    (0, _) => "...".to_owned(),
                    (more, 0) => format!("... and {more} more; `maquette check` lists all"),
                    (more, _) => format!("...\n... and {more} more; `maquette check` lists all"),
                };
                rows.extend(more.lines().flat_map(|line| wrap(line, width)));
                rows.push(String::new());
                break;
            }
            rows.extend(lines);
        }
        rows.truncate(height);
        rows
    }
}

fn milliseconds(seconds: f64) -> String {
    if seconds < 10.0 { format!("{:.0} ms", seconds * 1e3) } else { format!("{seconds:.1} s") }
}

/// Summarizes a run: the number of nodes in each state, and the written files.
fn summary_rows(report: &Report, folder: &str, width: usize, paint: Paint) -> Vec<String> {
    let nodes = |state: State| report.trace.0.iter().filter(move |node| node.state == state);
    let names = |state| nodes(state).map(|node| node.name.clone()).collect::<Vec<_>>();
    let computed = nodes(State::Computed).map(|node| {
        let unchanged = if node.unchanged { " (unchanged)" } else { "" };
        format!("{} {:.1} ms{unchanged}", node.name, node.seconds * 1e3)
    });
    let files = |unchanged: bool| {
        let files = report.written.iter().filter(move |file| file.unchanged == unchanged);
        files.map(move |file| {
            let name =
                Path::new(&file.path).strip_prefix(folder).unwrap_or(&file.path).for_display();
            if unchanged { name.to_string() } else { format!("{name} {}", in_bytes(file.bytes)) }
        })
    };
    let mut rows = Vec::new();
    for (label, items) in [
        ("computed", computed.collect()),
        ("equal", names(State::Equal)),
        ("cached", names(State::Cached)),
        ("failed", names(State::Failed)),
        ("skipped", names(State::Skipped)),
        ("wrote", Vec::from_iter(files(false))),
        ("unchanged", Vec::from_iter(files(true))),
    ] {
        rows.extend(list_rows(label, &items, width, paint));
    }
    rows
}

/// Formats a list as `label  one, two, three`. If not all items fit, the number of omitted items is appended.
fn list_rows(label: &str, items: &[String], width: usize, paint: Paint) -> Vec<String> {
    const INDENT: usize = 10;
    let room = width.saturating_sub(INDENT + " and 1000 more".len()).max(1);
    let items: Vec<_> = items.iter().map(|item| sanitize(item)).collect();
    let Some((first, rest)) = items.split_first() else { return Vec::new() };
    let mut rows = vec![first.clone().into_owned()];
    for (index, item) in rest.iter().enumerate() {
        let full = rows.len() == MAX_ROWS;
        let row = rows.last_mut().expect("there is a row");
        if row.chars().count() + item.chars().count() + 2 <= room {
            *row += ", ";
            *row += item;
        } else if !full {
            *row += ",";
            rows.push(item.clone().into_owned());
        } else {
            *row += &format!(" and {} more", rest.len() - index);
            break;
        }
    }
    let labels = std::iter::once(label).chain(std::iter::repeat(""));
    let labels = labels.map(|label| paint.dim(&format!("{label:<INDENT$}")));
    labels.zip(&rows).map(|(label, row)| label + row).collect()
}

/// Formats a table of the nodes that ran, with time, memory and the reason.
fn profile_rows(report: &Report, width: usize, paint: Paint) -> Vec<String> {
    let nodes = &report.trace.0;
    let longest = column_width(nodes.iter().map(|node| node.name.len()));
    let mut rows = vec![paint.dim(&format!(
        "{:<8}  {:<longest$}  {:>9}  {:>9}  why",
        "state", "node", "time", "memory"
    ))];
    for node in nodes {
        let time = match node.state {
            State::Computed => format!("{:.1} ms", node.seconds * 1e3),
            _ => String::new(),
        };
        let (state, name, memory) = (node.state.word(), &node.name, in_bytes(node.bytes));
        let unchanged = if node.unchanged { "; same result" } else { "" };
        let row = format!(
            "{state:<8}  {name:<longest$}  {time:>9}  {memory:>9}  {}{unchanged}",
            node.reason
        );
        rows.push(sanitize(&row).chars().take(width).collect());
    }
    rows
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;
    use std::sync::Arc;

    use expect_test::{Expect, expect};
    use maquette_engine::eval::{NodeTrace, RunTrace};
    use maquette_engine::session::OutputFile;
    use maquette_syntax::error::{Source, Span, code};
    use maquette_value::Hash;

    use super::super::worker::Purpose;
    use super::*;

    fn node(name: &str, state: State, reason: &str) -> NodeTrace {
        NodeTrace {
            name: name.into(),
            node: "Node".into(),
            state,
            unchanged: name == "knots",
            reason: reason.into(),
            start: 0.0,
            thread: 0,
            seconds: if state == State::Computed { 0.0123 } else { 0.0 },
            bytes: 4_100_000,
            estimate: None,
            warnings: Vec::new(),
        }
    }

    fn after_a_run() -> Block {
        fn written_file(name: &str, unchanged: bool) -> OutputFile {
            OutputFile {
                output: name.into(),
                path: PathBuf::from("out/doll").join(name),
                bytes: 5_200_000,
                hash: Hash::compute(b""),
                unchanged,
                seconds: 0.0,
            }
        }
        let report = Report {
            run: 12,
            cancelled: false,
            trace: RunTrace(vec![
                node("scan", State::Cached, "nothing that it depends on changed"),
                node("raised", State::Computed, "parameter `steps` changed"),
                node("knots", State::Computed, "input `net` changed"),
                node("grid", State::Equal, "its inputs came out the same"),
            ]),
            diagnostics: Vec::new(),
            written: vec![written_file("model.ply", false), written_file("nose.png", true)],
            unwritten: None,
            seconds: 0.0381,
            purpose: Purpose::Outputs,
        };
        Block {
            graph: "doll.ron".into(),
            folder: "out/doll".into(),
            watched_files: 5,
            run: 12,
            last_good_run: Some(12),
            report: Some(report),
            ..Block::default()
        }
    }

    fn block_with_errors() -> Block {
        let text = "Graph(\n    format: 1,\n    nodes: { \"a\": Treshold() },\n)\n";
        let source = Arc::new(Source { name: "doll.ron".into(), text: text.into() });
        let place = (source, Span { start: 40, end: 48 });
        let message = "there is no node type `Treshold`";
        let diagnostic = Diagnostic {
            help: "did you mean `Threshold`?".into(),
            ..Diagnostic::new(Severity::Error, code::UNKNOWN_NODE, place, message)
        };
        Block { run: 13, diagnostics: vec![diagnostic; 3], ..after_a_run() }
    }

    fn check(block: &Block, size: (usize, usize), expected: Expect) {
        expected.assert_eq(&block.rows(size, false).join("\n"));
    }

    #[test]
    fn a_run_is_summarized_in_a_few_rows() {
        check(
            &after_a_run(),
            (80, 24),
            expect![[r#"
            doll.ron  run 12: up to date, 38 ms
            computed  raised 12.3 ms, knots 12.3 ms (unchanged)
            equal     grid
            cached    scan
            wrote     model.ply 5.2 MB
            unchanged nose.png
            watching 5 files   r run  f recompute  p profile  q quit"#]],
        );
    }

    #[test]
    fn the_link_of_the_live_page_is_above_the_keys() {
        let block = Block { link: Some("http://127.0.0.1:1/#0".into()), ..after_a_run() };
        let rows = block.rows((80, 24), false);
        assert_eq!(rows[rows.len() - 2], "live page: http://127.0.0.1:1/#0");
    }

    #[test]
    fn a_profile_shows_times_memory_and_reasons() {
        let block = Block { shows_profile: true, ..after_a_run() };
        check(
            &block,
            (80, 24),
            expect![[r#"
            doll.ron  run 12: up to date, 38 ms
            state     node         time     memory  why
            cached    scan                  4.1 MB  nothing that it depends on changed
            computed  raised    12.3 ms     4.1 MB  parameter `steps` changed
            computed  knots     12.3 ms     4.1 MB  input `net` changed; same result
            equal     grid                  4.1 MB  its inputs came out the same
            watching 5 files   r run  f recompute  p profile  q quit"#]],
        );
    }

    #[test]
    fn diagnostics_are_above_and_those_that_do_not_fit_are_counted() {
        check(
            &block_with_errors(),
            (80, 14),
            expect![[r#"
                error[G003]: there is no node type `Treshold`
                 --> doll.ron:3:19
                  |
                3 |     nodes: { "a": Treshold() },
                  |                   ^^^^^^^^
                  |
                  = help: did you mean `Threshold`?

                ... and 2 more; `maquette check` lists all

                doll.ron  run 13: 3 errors; the outputs stay as in run 12
                watching 5 files   r run  f recompute  p profile  q quit"#]],
        );
    }

    #[test]
    fn the_block_fits_into_every_terminal() {
        for block in
            [after_a_run(), block_with_errors(), Block { shows_profile: true, ..after_a_run() }]
        {
            for width in 1..90 {
                for height in 1..30 {
                    let rows = block.rows((width, height), true);
                    assert!(rows.len() <= height, "{width} x {height}: {rows:#?}");
                    let widest = rows.iter().map(|row| console::measure_text_width(row)).max();
                    assert!(widest <= Some(width), "{width} x {height}: {rows:#?}");
                }
            }
        }
    }
}
