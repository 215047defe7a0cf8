//! The ways in which a watch reports its progress: as a block on a terminal, as lines, or as events.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use maquette_engine::eval::{Observer, State};
use maquette_graph::Graph;
use maquette_graph::catalog::Catalog;
use maquette_preview::Page;
use maquette_syntax::error::{Diagnostic, Severity};
use serde_json::json;

use super::block::Block;
use super::worker::{ObserverFactory, Report, ViewedValues};
use crate::events::{BothObservers, Events, Listener, RunEnd, unresponsive_message};
use crate::run::counts;
use crate::terminal::{Input, Screen};
use crate::{
    count_severity, eprint, format_count, has_errors, print, print_as_it_is, report, shows_color,
};

/// Shows the progress of a watch to the user or a program.
pub(super) trait View {
    /// Returns a function that creates an observer for each evaluation.
    fn observe(&self) -> ObserverFactory {
        Box::new(|_| Box::new(UnresponsiveReporter))
    }

    /// Shows the watched files. `polled` is the reason why files are polled, if they are.
    fn show_watch_list(&mut self, files: &[PathBuf], polled: Option<&str>);

    /// Shows that the run with the number `run` begins, because the files `changed` have changed.
    fn show_begin(&mut self, run: usize, changed: &[PathBuf]);

    /// Shows a graph that is about to be evaluated.
    fn show_graph(&mut self, _: &Graph) {}

    /// Shows the diagnostics of the check. If one of them is an error, no node runs.
    fn show_check(&mut self, run: usize, diagnostics: &[Diagnostic]);

    /// Shows the end of a run in which nothing was evaluated, because the graph has errors.
    fn show_broken(&mut self, run: usize, diagnostics: &[Diagnostic]);

    /// Shows that a run was cancelled because of a newer change.
    fn show_cancel(&mut self, run: usize);

    /// Shows the end of a run.
    fn show_end(&mut self, report: &Report);

    /// Shows values on live pages. `live` is true during a drag, in which the parameters differ from those in the graph file.
    fn show_values(&mut self, _run: usize, _live: bool, _: &ViewedValues) {}

    /// Shows that an evaluation for live pages was cancelled.
    fn show_abandon(&mut self, _run: usize) {}

    /// Shows the reason why values could not be set in the graph file.
    fn show_refusal(&mut self, _why: &str) {}

    /// Shows the error of the user's command.
    fn show_command_failure(&mut self, why: &str) {
        eprint(&format!("{why}\n"));
    }

    /// Shows the reason why the live page was not opened in a browser.
    fn show_browser_failure(&mut self, why: &str) {
        eprint(&format!("{why}\n"));
    }

    /// Updates the display during a run.
    fn refresh(&mut self) {}

    /// Redraws after the terminal was resized.
    fn redraw(&mut self) {}

    /// Switches between the summary and the profile of the last run.
    fn toggle_profile(&mut self) {}
}

/// A view that sends events, to another program or to live pages.
pub(super) struct EventView(pub(super) Listener);

impl View for EventView {
    fn observe(&self) -> ObserverFactory {
        let listener = self.0.clone();
        Box::new(move |cancel| Box::new(Events::new(listener.clone(), cancel.clone())))
    }

    fn show_watch_list(&mut self, files: &[PathBuf], polled: Option<&str>) {
        self.0.send("watching", json!({ "files": files, "polled": polled }));
    }

    fn show_begin(&mut self, run: usize, changed: &[PathBuf]) {
        self.0.send("run", json!({ "run": run, "changed": changed }));
    }

    fn show_check(&mut self, _: usize, diagnostics: &[Diagnostic]) {
        self.0.send_problems(diagnostics);
    }

    fn show_broken(&mut self, run: usize, diagnostics: &[Diagnostic]) {
        self.0.send_end(&RunEnd { run, trace: None, written: &[], diagnostics, seconds: 0.0 });
    }

    fn show_cancel(&mut self, run: usize) {
        self.0.send("cancelled", json!({ "run": run }));
    }

    fn show_end(&mut self, report: &Report) {
        let Report { run, trace, diagnostics, written, seconds, .. } = report;
        self.0.send_problems(diagnostics);
        let (trace, seconds) = (Some(trace), *seconds);
        self.0.send_end(&RunEnd { run: *run, trace, written, diagnostics, seconds });
    }

    /// Does nothing, because there is no event for the user's command.
    fn show_command_failure(&mut self, _: &str) {}
}

/// A view that shows everything both on live pages and in another view.
pub(super) struct PageView {
    page: Page,
    program: EventView,
    catalog: Arc<Catalog>,
    other: Box<dyn View>,
}

impl PageView {
    pub(super) fn new(page: Page, catalog: Arc<Catalog>, other: Box<dyn View>) -> Self {
        let program = EventView(Listener::new(page.message_sender()));
        Self { page, program, catalog, other }
    }
}

impl View for PageView {
    fn observe(&self) -> ObserverFactory {
        let (page, other) = (self.program.observe(), self.other.observe());
        Box::new(move |cancel| Box::new(BothObservers(page(cancel), other(cancel))))
    }

    fn show_watch_list(&mut self, files: &[PathBuf], polled: Option<&str>) {
        self.program.show_watch_list(files, polled);
        self.other.show_watch_list(files, polled);
    }

    fn show_begin(&mut self, run: usize, changed: &[PathBuf]) {
        self.program.show_begin(run, changed);
        self.other.show_begin(run, changed);
    }

    fn show_graph(&mut self, graph: &Graph) {
        self.page.show(graph, &self.catalog);
        self.other.show_graph(graph);
    }

    fn show_check(&mut self, run: usize, diagnostics: &[Diagnostic]) {
        self.program.show_check(run, diagnostics);
        self.other.show_check(run, diagnostics);
    }

    fn show_broken(&mut self, run: usize, diagnostics: &[Diagnostic]) {
        self.program.show_broken(run, diagnostics);
        self.other.show_broken(run, diagnostics);
    }

    fn show_cancel(&mut self, run: usize) {
        self.program.show_cancel(run);
        self.other.show_cancel(run);
    }

    fn show_end(&mut self, report: &Report) {
        self.program.show_end(report);
        self.other.show_end(report);
    }

    fn show_values(&mut self, run: usize, live: bool, values: &ViewedValues) {
        self.page.show_values(run, live, values);
    }

    fn show_abandon(&mut self, run: usize) {
        self.program.show_cancel(run);
    }

    fn show_refusal(&mut self, why: &str) {
        self.program.0.send("refused", json!({ "why": why }));
    }

    fn show_command_failure(&mut self, why: &str) {
        self.other.show_command_failure(why);
    }

    fn show_browser_failure(&mut self, why: &str) {
        self.other.show_browser_failure(why);
    }

    fn refresh(&mut self) {
        self.other.refresh();
    }

    fn redraw(&mut self) {
        self.other.redraw();
    }

    fn toggle_profile(&mut self) {
        self.other.toggle_profile();
    }
}

/// An observer that only reports nodes that still run after a cancellation.
struct UnresponsiveReporter;

impl Observer for UnresponsiveReporter {
    fn on_unresponsive(&self, node: &str, kind: &str, pack: &str) {
        eprint(&format!("{}\n", unresponsive_message(node, kind, pack)));
    }
}

/// A view that prints one line per run, for output to a pipe or file.
#[derive(Default)]
pub(super) struct LineView {
    /// The messages of all warnings of the last run.
    last_warnings: Vec<String>,
}

impl LineView {
    /// Removes the warnings that the previous run also had. Returns the remaining diagnostics, and the number of removed warnings.
    fn split_known_warnings(&mut self, diagnostics: Vec<Diagnostic>) -> (Vec<Diagnostic>, usize) {
        let warnings =
            diagnostics.iter().filter(|diagnostic| diagnostic.severity == Severity::Warning);
        let now: Vec<_> = warnings.map(|diagnostic| diagnostic.message.clone()).collect();
        let before = std::mem::replace(&mut self.last_warnings, now);
        let count = diagnostics.len();
        let new: Vec<_> = diagnostics
            .into_iter()
            .filter(|diagnostic| {
                diagnostic.severity == Severity::Error || !before.contains(&diagnostic.message)
            })
            .collect();
        let known = count - new.len();
        (new, known)
    }
}

impl View for LineView {
    fn show_watch_list(&mut self, files: &[PathBuf], polled: Option<&str>) {
        eprint(&format!("watching {}\n", format_count(files.len(), "file")));
        if let Some(why) = polled {
            eprint(&format!("polling files twice a second: {why}\n"));
        }
    }

    fn show_begin(&mut self, _: usize, _: &[PathBuf]) {}

    /// Does nothing, because diagnostics are printed at the end of the run.
    fn show_check(&mut self, _: usize, _: &[Diagnostic]) {}

    fn show_broken(&mut self, run: usize, diagnostics: &[Diagnostic]) {
        report(diagnostics);
        let errors = count_severity(diagnostics, Severity::Error);
        let errors = format_count(errors, "error");
        print(&format!("run {run}: {errors}; the outputs stay as they are\n"));
    }

    fn show_cancel(&mut self, _: usize) {}

    fn show_end(&mut self, done: &Report) {
        let (news, known) = self.split_known_warnings(done.diagnostics.clone());
        report(&news);
        let written = done.written.iter().filter(|file| !file.unchanged).count();
        let (counts, seconds) = (counts(&done.trace), done.seconds);
        let written = format_count(written, "file");
        let known = match known {
            0 => String::new(),
            known => format!("; {} (unchanged)", format_count(known, "warning")),
        };
        print(&format!("run {}: {counts}; {written} written; {seconds:.3} s{known}\n", done.run));
    }
}

/// The running nodes by name, each with the finished fraction of its work (0 to 1) if it is known.
type RunningNodes = Arc<Mutex<BTreeMap<String, Option<f64>>>>;

/// Messages about nodes that still run after a cancellation.
type UnresponsiveNodes = Arc<Mutex<Vec<String>>>;

/// The time after which the display names the node that is running.
const NODE_DELAY: Duration = Duration::from_millis(300);

/// A view that shows a block of text on a terminal, and redraws it.
pub(super) struct TerminalView {
    screen: Screen,
    color: bool,
    block: Block,
    running_nodes: RunningNodes,
    unresponsive: UnresponsiveNodes,
    started_at: Option<Instant>,
}

impl TerminalView {
    pub(super) fn open(
        graph: &Path,
        folder: &Path,
        link: Option<String>,
        sink: impl Fn(Input) + Send + 'static,
    ) -> std::io::Result<Self> {
        let screen = Screen::is_open(sink)?;
        let color = shows_color(&std::io::stdout());
        let (graph, folder) = (graph.display().to_string(), folder.display().to_string());
        let block = Block { graph, folder, link, ..Block::default() };
        let (running_nodes, unresponsive) = (RunningNodes::default(), UnresponsiveNodes::default());
        Ok(Self { screen, color, block, running_nodes, unresponsive, started_at: None })
    }

    fn draw(&self) {
        self.screen.draw(&self.block.rows(self.screen.size(), self.color));
    }
}

impl Drop for TerminalView {
    /// Prints the last block to the normal screen, without the line about keys.
    fn drop(&mut self) {
        let mut rows = self.block.rows(self.screen.size(), self.color);
        rows.pop();
        self.screen.close();
        print_as_it_is(&rows.iter().map(|row| format!("{row}\n")).collect::<String>());
    }
}

impl View for TerminalView {
    fn observe(&self) -> ObserverFactory {
        let (running_nodes, unresponsive) = (self.running_nodes.clone(), self.unresponsive.clone());
        Box::new(move |_| {
            unresponsive.lock().unwrap_or_else(|broken| broken.into_inner()).clear();
            Box::new(NodeTracker(running_nodes.clone(), unresponsive.clone()))
        })
    }

    fn show_watch_list(&mut self, files: &[PathBuf], polled: Option<&str>) {
        self.block.watched_files = files.len();
        self.block.polling_reason = polled.map(str::to_owned);
        self.draw();
    }

    /// Draws nothing yet, because most runs end before anybody could read it.
    fn show_begin(&mut self, run: usize, _: &[PathBuf]) {
        self.block.run = run;
        self.block.diagnostics.clear();
        self.block.is_running = true;
        self.block.node = None;
        self.started_at = Some(Instant::now());
    }

    /// Draws only errors. Warnings are drawn at the end of the run.
    fn show_check(&mut self, run: usize, diagnostics: &[Diagnostic]) {
        if !has_errors(diagnostics) {
            return;
        }
        self.block.run = run;
        self.block.is_running = false;
        self.block.diagnostics = diagnostics.to_vec();
        self.draw();
    }

    fn show_broken(&mut self, _: usize, _: &[Diagnostic]) {
        self.draw();
    }

    fn show_cancel(&mut self, _: usize) {
        self.started_at = None;
        self.block.unresponsive.clear();
    }

    fn show_end(&mut self, report: &Report) {
        self.started_at = None;
        self.block.unresponsive.clear();
        self.block.is_running = false;
        self.block.command_failure = None;
        self.block.run = report.run;
        self.block.diagnostics = report.diagnostics.clone();
        if !has_errors(&self.block.diagnostics) {
            self.block.last_good_run = Some(report.run);
        }
        self.block.report = Some(report.clone());
        self.draw();
    }

    fn show_command_failure(&mut self, why: &str) {
        self.block.command_failure = Some(why.to_owned());
        self.draw();
    }

    fn show_browser_failure(&mut self, why: &str) {
        self.block.browser_failure = Some(why.to_owned());
        self.draw();
    }

    fn refresh(&mut self) {
        if self.started_at.is_some_and(|started_at| started_at.elapsed() > NODE_DELAY) {
            let running_nodes =
                self.running_nodes.lock().unwrap_or_else(|broken| broken.into_inner());
            let first = running_nodes.iter().next();
            self.block.node = first.map(|(node, share)| (node.clone(), *share));
            drop(running_nodes);
            let unresponsive =
                self.unresponsive.lock().unwrap_or_else(|broken| broken.into_inner());
            self.block.unresponsive.clone_from(&unresponsive);
            drop(unresponsive);
            self.draw();
        }
    }

    fn redraw(&mut self) {
        self.draw();
    }

    fn toggle_profile(&mut self) {
        self.block.shows_profile = !self.block.shows_profile;
        self.draw();
    }
}

/// An observer that records which nodes are running.
struct NodeTracker(RunningNodes, UnresponsiveNodes);

impl Observer for NodeTracker {
    fn on_start(&self, node: &str) {
        self.note(|nodes| nodes.insert(node.to_owned(), None));
    }

    fn on_progress(&self, node: &str, share: f64) {
        self.note(|nodes| nodes.get_mut(node).map(|known| known.replace(share)));
    }

    fn on_unresponsive(&self, node: &str, kind: &str, pack: &str) {
        let words = unresponsive_message(node, kind, pack);
        self.1.lock().unwrap_or_else(|broken| broken.into_inner()).push(words);
    }

    fn on_finish(&self, node: &str, _: State, _: f64) {
        self.note(|nodes| nodes.remove(node));
    }
}

impl NodeTracker {
    fn note<T>(&self, change: impl FnOnce(&mut BTreeMap<String, Option<f64>>) -> T) {
        change(&mut self.0.lock().unwrap_or_else(|broken| broken.into_inner()));
    }
}

#[cfg(test)]
mod tests {
    use maquette_syntax::error::{Source, Span, code};

    use super::*;

    #[test]
    fn an_unchanged_warning_is_reported_once() {
        let source = Arc::new(Source { name: "a.ron".into(), text: String::new() });
        fn diagnostic(severity: Severity, message: &str, source: &Arc<Source>) -> Diagnostic {
            Diagnostic::new(severity, code::WARNING, (source.clone(), Span::default()), message)
        }
        fn warning(source: &Arc<Source>) -> Diagnostic {
            diagnostic(Severity::Warning, "it is thin", source)
        }
        fn error(source: &Arc<Source>) -> Diagnostic {
            diagnostic(Severity::Error, "it is torn", source)
        }
        let mut lines = LineView::default();
        fn split(diagnostics: Vec<Diagnostic>, lines: &mut LineView) -> (Vec<String>, usize) {
            let (news, known) = lines.split_known_warnings(diagnostics);
            (news.into_iter().map(|diagnostic| diagnostic.message).collect::<Vec<_>>(), known)
        }
        assert_eq!(
            split(vec![warning(&source), error(&source)], &mut lines),
            (vec!["it is thin".into(), "it is torn".into()], 0)
        );
        assert_eq!(
            split(vec![warning(&source), error(&source)], &mut lines),
            (vec!["it is torn".into()], 1)
        );
        assert_eq!(split(vec![], &mut lines), (vec![], 0));
        assert_eq!(split(vec![warning(&source)], &mut lines), (vec!["it is thin".into()], 0));
    }
}
