//! The one block of text that a watch shows on a terminal: problems above, the status of the last run below.

use std::path::Path;

use maquette_engine::eval::State;
use maquette_syntax::error::{Problem, Severity};
use maquette_syntax::telling::harmless;
use maquette_syntax::telling::in_full;

use super::worker::Report;
use crate::Shown;
use crate::column_width;
use crate::terminal::wrapped;
use crate::{counted, in_bytes};

/// A list of names in the status takes at most so many rows; the problems need the room.
const MOST_ROWS: usize = 3;

/// Everything that the block tells.
#[derive(Default)]
pub(super) struct Block {
    /// The graph's file, as given.
    pub(super) graph: String,
    pub(super) folder: String,
    /// The link of the live page, if there is one.
    pub(super) link: Option<String>,
    /// Why it was not opened in a browser.
    pub(super) not_opened: Option<String>,
    pub(super) watched: usize,
    /// Why files are polled; none if the system reports changes.
    pub(super) polled: Option<String>,
    /// What is wrong now.
    pub(super) problems: Vec<Problem>,
    /// Which run or attempt this is about.
    pub(super) run: usize,
    /// The last evaluation that came to its end.
    pub report: Option<Report>,
    /// The last run without errors.
    pub(super) good: Option<usize>,
    /// Whether run `run` is under way.
    pub(super) running: bool,
    /// The node under way, and its share if it is known.
    pub(super) node: Option<(String, Option<f64>)>,
    /// The nodes that go on though they were told to stop, in words.
    pub(super) stubborn: Vec<String>,
    /// What became of the user's command, if it failed.
    pub(super) command: Option<String>,
    pub(super) profile: bool,
}

/// Colors, or none.
#[derive(Clone, Copy)]
struct Paint(bool);

impl Paint {
    fn with(self, style: &str, text: &str) -> String {
        let text = harmless(text);
        if self.0 { format!("\x1b[{style}m{text}\x1b[0m") } else { text.into_owned() }
    }

    fn bold(self, text: &str) -> String {
        self.with("1", text)
    }

    fn dim(self, text: &str) -> String {
        self.with("2", text)
    }

    fn red(self, text: &str) -> String {
        self.with("1;31", text)
    }

    fn green(self, text: &str) -> String {
        self.with("32", text)
    }
}

impl Block {
    /// The block in rows that fit into a terminal.
    pub(super) fn rows(&self, (width, height): (usize, usize), color: bool) -> Vec<String> {
        let paint = Paint(color);
        let mut status = vec![self.head(paint)];
        // Of a graph that cannot run, what ran before would be stale.
        match self.report.as_ref().filter(|report| report.run == self.run) {
            Some(report) if self.profile => status.extend(profile(report, width, paint)),
            Some(report) => status.extend(summary(report, &self.folder, width, paint)),
            None => {}
        }
        status.extend(self.stubborn.iter().map(|words| paint.red(words)));
        status.extend(self.command.as_ref().map(|text| paint.red(text)));
        status.extend(self.link.as_ref().map(|link| paint.dim(&format!("live page: {link}"))));
        status.extend(self.not_opened.as_ref().map(|why| paint.dim(why)));
        if let Some(why) = &self.polled {
            status.push(paint.dim(&format!("looking at the files twice a second: {why}")));
        }
        status.push(self.foot(paint));
        let mut status: Vec<String> = status.iter().flat_map(|row| wrapped(row, width)).collect();
        if status.len() > height {
            // The first row, which says how it went, and the last one, which tells the keys, stay longest.
            let too_many = status.len() - height;
            let last = status.len() - 1;
            status.drain(last.saturating_sub(too_many).max(1).min(last)..last);
            status.truncate(height);
        }
        let mut rows = self.problem_rows(width, height - status.len(), color);
        rows.extend(status);
        rows
    }

    fn head(&self, paint: Paint) -> String {
        let graph = paint.bold(&self.graph);
        if self.running {
            let node = self.node.as_ref().map(|(node, share)| match share {
                Some(share) => format!("computing {}, {:.0} %", harmless(node), share * 100.0),
                None => format!("computing {}, progress unknown", harmless(node)),
            });
            let node = node.unwrap_or_else(|| "running".into());
            return format!("{graph}  run {}: {node}", self.run);
        }
        let errors =
            self.problems.iter().filter(|problem| problem.severity == Severity::Error).count();
        if errors > 0 {
            let errors = paint.red(&counted(errors, "error"));
            let ran = self.report.as_ref().is_some_and(|report| report.run == self.run);
            let stays = match self.good {
                Some(good) if ran => format!("; outputs that are not made stay as in run {good}"),
                Some(good) => format!("; the outputs stay as in run {good}"),
                None => String::new(),
            };
            return format!("{graph}  run {}: {errors}{stays}", self.run);
        }
        let Some(report) = &self.report else { return format!("{graph}  run {}", self.run) };
        let warnings = match self.problems.len() {
            0 => String::new(),
            count => format!(", {}", counted(count, "warning")),
        };
        let (done, time) = (paint.green("up to date"), milliseconds(report.seconds));
        format!("{graph}  run {}: {done}, {time}{warnings}", self.run)
    }

    fn foot(&self, paint: Paint) -> String {
        let keys = "r run  f recompute  p profile  q quit";
        paint.dim(&format!("watching {}   {keys}", counted(self.watched, "file")))
    }

    /// As many problems as there is room for, and how many more there are; then an empty row.
    fn problem_rows(&self, width: usize, height: usize, color: bool) -> Vec<String> {
        let mut rows = Vec::new();
        for (index, problem) in self.problems.iter().enumerate() {
            let mut problem = wrapped(&in_full(problem, color, Some(width)), width);
            problem.push(String::new());
            let rest = self.problems.len() - index - 1;
            let room = height.saturating_sub(rows.len() + usize::from(rest > 0) * 2);
            if problem.len() > room {
                let shown = if index == 0 { room.saturating_sub(2) } else { 0 };
                rows.extend(problem.into_iter().take(shown));
                let more = rest + usize::from(shown == 0);
                let more = match (more, shown) {
                    (0, _) => "...".to_owned(),
                    (more, 0) => format!("... and {more} more; `maquette check` lists all"),
                    (more, _) => format!("...\n... and {more} more; `maquette check` lists all"),
                };
                rows.extend(more.lines().flat_map(|line| wrapped(line, width)));
                rows.push(String::new());
                break;
            }
            rows.extend(problem);
        }
        rows.truncate(height);
        rows
    }
}

fn milliseconds(seconds: f64) -> String {
    if seconds < 10.0 { format!("{:.0} ms", seconds * 1e3) } else { format!("{seconds:.1} s") }
}

/// What ran, what did not, what was written: a few rows.
fn summary(report: &Report, folder: &str, width: usize, paint: Paint) -> Vec<String> {
    let nodes = |state: State| report.trace.0.iter().filter(move |node| node.state == state);
    let names = |state| nodes(state).map(|node| node.name.clone()).collect::<Vec<_>>();
    let computed = nodes(State::Computed).map(|node| {
        let unchanged = if node.unchanged { " (the same)" } else { "" };
        format!("{} {:.1} ms{unchanged}", node.name, node.seconds * 1e3)
    });
    let files = |unchanged: bool| {
        let files = report.written.iter().filter(move |file| file.unchanged == unchanged);
        files.map(move |file| {
            let name = Path::new(&file.path).strip_prefix(folder).unwrap_or(&file.path).shown();
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
        ("the same", Vec::from_iter(files(true))),
    ] {
        rows.extend(list(label, &items, width, paint));
    }
    rows
}

/// `label  one, two, three`, with how many more there are where the room ends.
fn list(label: &str, items: &[String], width: usize, paint: Paint) -> Vec<String> {
    const INDENT: usize = 10;
    let room = width.saturating_sub(INDENT + " and 1000 more".len()).max(1);
    let items: Vec<_> = items.iter().map(|item| harmless(item)).collect();
    let Some((first, rest)) = items.split_first() else { return Vec::new() };
    let mut rows = vec![first.clone().into_owned()];
    for (index, item) in rest.iter().enumerate() {
        let full = rows.len() == MOST_ROWS;
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
    let label = |index| if index == 0 { label } else { "" };
    let label = |index| paint.dim(&format!("{:<INDENT$}", label(index)));
    rows.iter().enumerate().map(|(index, row)| label(index) + row).collect()
}

/// Every node with its time, its memory and its reason.
fn profile(report: &Report, width: usize, paint: Paint) -> Vec<String> {
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
        let unchanged = if node.unchanged { "; came out the same" } else { "" };
        let row = format!(
            "{state:<8}  {name:<longest$}  {time:>9}  {memory:>9}  {}{unchanged}",
            node.reason
        );
        rows.push(harmless(&row).chars().take(width).collect());
    }
    rows
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;
    use std::sync::Arc;

    use expect_test::{Expect, expect};
    use maquette_engine::eval::{NodeTrace, RunTrace};
    use maquette_engine::session::Written;
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
        fn written(name: &str, unchanged: bool) -> Written {
            Written {
                output: name.into(),
                path: PathBuf::from("out/doll").join(name),
                bytes: 5_200_000,
                hash: Hash::of(b""),
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
            problems: Vec::new(),
            written: vec![written("model.ply", false), written("nose.png", true)],
            unwritten: None,
            seconds: 0.0381,
            purpose: Purpose::Outputs,
        };
        Block {
            graph: "doll.ron".into(),
            folder: "out/doll".into(),
            watched: 5,
            run: 12,
            good: Some(12),
            report: Some(report),
            ..Block::default()
        }
    }

    fn broken() -> Block {
        let text = "Graph(\n    format: 1,\n    nodes: { \"a\": Treshold() },\n)\n";
        let source = Arc::new(Source { name: "doll.ron".into(), text: text.into() });
        let place = (source, Span { start: 40, end: 48 });
        let message = "there is no node type `Treshold`";
        let problem = Problem {
            help: "did you mean `Threshold`?".into(),
            ..Problem::new(Severity::Error, code::UNKNOWN_NODE, place, message)
        };
        Block { run: 13, problems: vec![problem; 3], ..after_a_run() }
    }

    fn check(block: &Block, size: (usize, usize), expected: Expect) {
        expected.assert_eq(&block.rows(size, false).join("\n"));
    }

    #[test]
    fn a_run_is_told_in_a_few_rows() {
        check(
            &after_a_run(),
            (80, 24),
            expect![[r#"
            doll.ron  run 12: up to date, 38 ms
            computed  raised 12.3 ms, knots 12.3 ms (the same)
            equal     grid
            cached    scan
            wrote     model.ply 5.2 MB
            the same  nose.png
            watching 5 files   r run  f recompute  p profile  q quit"#]],
        );
    }

    #[test]
    fn the_link_of_the_live_page_stands_above_the_keys() {
        let block = Block { link: Some("http://127.0.0.1:1/#0".into()), ..after_a_run() };
        let rows = block.rows((80, 24), false);
        assert_eq!(rows[rows.len() - 2], "live page: http://127.0.0.1:1/#0");
    }

    #[test]
    fn a_profile_tells_times_memory_and_reasons() {
        let block = Block { profile: true, ..after_a_run() };
        check(
            &block,
            (80, 24),
            expect![[r#"
            doll.ron  run 12: up to date, 38 ms
            state     node         time     memory  why
            cached    scan                  4.1 MB  nothing that it depends on changed
            computed  raised    12.3 ms     4.1 MB  parameter `steps` changed
            computed  knots     12.3 ms     4.1 MB  input `net` changed; came out the same
            equal     grid                  4.1 MB  its inputs came out the same
            watching 5 files   r run  f recompute  p profile  q quit"#]],
        );
    }

    #[test]
    fn problems_stand_above_and_those_without_room_are_counted() {
        check(
            &broken(),
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
        for block in [after_a_run(), broken(), Block { profile: true, ..after_a_run() }] {
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
