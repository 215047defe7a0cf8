//! What a watch tells: on a terminal, to a pipe, or to a program.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use maquette_engine::eval::{Observer, State};
use maquette_graph::Graph;
use maquette_graph::catalog::Catalog;
use maquette_preview::Page;
use maquette_syntax::error::{Problem, Severity};
use serde_json::json;

use super::block::Block;
use super::worker::{Observe, Report, Seen};
use crate::events::{Both, Ending, Events, Listener, does_not_stop};
use crate::run::counts;
use crate::terminal::{Input, Screen};
use crate::{counted, eprint, print, print_as_it_is, report, shows_color};

/// Tells the user, or a program, how the watch goes.
pub(super) trait View {
    /// What follows the evaluations.
    fn observe(&self) -> Observe {
        Box::new(|_| Box::new(Stubborn))
    }

    /// These many files are watched from now on; `polled` says why the system's events do not suffice.
    fn watching(&mut self, files: &[PathBuf], polled: Option<&str>);

    /// A run begins.
    fn begin(&mut self, run: usize, changed: &[PathBuf]);

    /// The graph can be evaluated, and will be.
    fn graph(&mut self, _: &Graph) {}

    /// The graph was checked. If there are errors no node is run.
    fn checked(&mut self, run: usize, problems: &[Problem]);

    /// A run with errors in the graph is over: nothing was evaluated.
    fn end_broken(&mut self, run: usize, problems: &[Problem]);

    /// A run was stopped by a newer change.
    fn cancelled(&mut self, run: usize);

    /// A run is over.
    fn end(&mut self, report: &Report);

    /// Values that somebody looks at; `live` ones are of values that are not in the graph's file.
    fn values(&mut self, _run: usize, _live: bool, _: &Seen) {}

    /// What was evaluated only to be looked at, as of a run, was given up.
    fn left(&mut self, _run: usize) {}

    /// Values were not put into the graph's file.
    fn refused(&mut self, _why: &str) {}

    /// The user's command failed.
    fn command_failed(&mut self, why: &str) {
        eprint(&format!("{why}\n"));
    }

    /// The live page was not opened in a browser.
    fn not_opened(&mut self, why: &str) {
        eprint(&format!("{why}\n"));
    }

    /// Time passes while a run is under way.
    fn refresh(&mut self) {}

    /// The terminal has another size.
    fn resized(&mut self) {}

    /// More or less detail.
    fn toggle_profile(&mut self) {}
}

/// Events, for a program or the live page.
pub(super) struct Program(pub(super) Listener);

impl View for Program {
    fn observe(&self) -> Observe {
        let listener = self.0.clone();
        Box::new(move |cancel| Box::new(Events::new(listener.clone(), cancel.clone())))
    }

    fn watching(&mut self, files: &[PathBuf], polled: Option<&str>) {
        self.0.tell("watching", json!({ "files": files, "polled": polled }));
    }

    fn begin(&mut self, run: usize, changed: &[PathBuf]) {
        self.0.tell("run", json!({ "run": run, "changed": changed }));
    }

    fn checked(&mut self, _: usize, problems: &[Problem]) {
        self.0.tell_problems(problems);
    }

    fn end_broken(&mut self, run: usize, problems: &[Problem]) {
        self.0.tell_end(&Ending { run, trace: None, written: &[], problems, seconds: 0.0 });
    }

    fn cancelled(&mut self, run: usize) {
        self.0.tell("cancelled", json!({ "run": run }));
    }

    fn end(&mut self, report: &Report) {
        let Report { run, trace, problems, written, seconds, .. } = report;
        self.0.tell_problems(problems);
        let (trace, seconds) = (Some(trace), *seconds);
        self.0.tell_end(&Ending { run: *run, trace, written, problems, seconds });
    }

    /// What is heard besides is not for programs.
    fn command_failed(&mut self, _: &str) {}
}

/// The live page beside another view.
pub(super) struct WithPage {
    page: Page,
    program: Program,
    catalog: Arc<Catalog>,
    other: Box<dyn View>,
}

impl WithPage {
    pub(super) fn new(page: Page, catalog: Arc<Catalog>, other: Box<dyn View>) -> Self {
        let program = Program(Listener::new(page.teller()));
        Self { page, program, catalog, other }
    }
}

impl View for WithPage {
    fn observe(&self) -> Observe {
        let (page, other) = (self.program.observe(), self.other.observe());
        Box::new(move |cancel| Box::new(Both(page(cancel), other(cancel))))
    }

    fn watching(&mut self, files: &[PathBuf], polled: Option<&str>) {
        self.program.watching(files, polled);
        self.other.watching(files, polled);
    }

    fn begin(&mut self, run: usize, changed: &[PathBuf]) {
        self.program.begin(run, changed);
        self.other.begin(run, changed);
    }

    fn graph(&mut self, graph: &Graph) {
        self.page.show(graph, &self.catalog);
        self.other.graph(graph);
    }

    fn checked(&mut self, run: usize, problems: &[Problem]) {
        self.program.checked(run, problems);
        self.other.checked(run, problems);
    }

    fn end_broken(&mut self, run: usize, problems: &[Problem]) {
        self.program.end_broken(run, problems);
        self.other.end_broken(run, problems);
    }

    fn cancelled(&mut self, run: usize) {
        self.program.cancelled(run);
        self.other.cancelled(run);
    }

    fn end(&mut self, report: &Report) {
        self.program.end(report);
        self.other.end(report);
    }

    fn values(&mut self, run: usize, live: bool, values: &Seen) {
        self.page.show_values(run, live, values);
    }

    fn left(&mut self, run: usize) {
        self.program.cancelled(run);
    }

    fn refused(&mut self, why: &str) {
        self.program.0.tell("refused", json!({ "why": why }));
    }

    fn command_failed(&mut self, why: &str) {
        self.other.command_failed(why);
    }

    fn not_opened(&mut self, why: &str) {
        self.other.not_opened(why);
    }

    fn refresh(&mut self) {
        self.other.refresh();
    }

    fn resized(&mut self) {
        self.other.resized();
    }

    fn toggle_profile(&mut self) {
        self.other.toggle_profile();
    }
}

/// Says nothing but which nodes do not stop.
struct Stubborn;

impl Observer for Stubborn {
    fn does_not_stop(&self, node: &str, kind: &str, pack: &str) {
        eprint(&format!("{}\n", does_not_stop(node, kind, pack)));
    }
}

/// One line a run, for pipes and files.
#[derive(Default)]
pub(super) struct Lines {
    /// What the warnings of the last run say.
    warned: Vec<String>,
}

impl Lines {
    /// The problems of a run without the warnings that the last run had, too, and how many these are.
    fn news(&mut self, problems: Vec<Problem>) -> (Vec<Problem>, usize) {
        let warnings = problems.iter().filter(|problem| problem.severity == Severity::Warning);
        let now: Vec<_> = warnings.map(|problem| problem.message.clone()).collect();
        let before = std::mem::replace(&mut self.warned, now);
        let count = problems.len();
        let new: Vec<_> = problems
            .into_iter()
            .filter(|problem| {
                problem.severity == Severity::Error || !before.contains(&problem.message)
            })
            .collect();
        let known = count - new.len();
        (new, known)
    }
}

impl View for Lines {
    fn watching(&mut self, files: &[PathBuf], polled: Option<&str>) {
        eprint(&format!("watching {}\n", counted(files.len(), "file")));
        if let Some(why) = polled {
            eprint(&format!("looking at the files twice a second: {why}\n"));
        }
    }

    fn begin(&mut self, _: usize, _: &[PathBuf]) {}

    /// Problems are printed with the run that they belong to.
    fn checked(&mut self, _: usize, _: &[Problem]) {}

    fn end_broken(&mut self, run: usize, problems: &[Problem]) {
        report(problems);
        let errors = problems.iter().filter(|problem| problem.severity == Severity::Error).count();
        let errors = counted(errors, "error");
        print(&format!("run {run}: {errors}; the outputs stay as they are\n"));
    }

    fn cancelled(&mut self, _: usize) {}

    fn end(&mut self, done: &Report) {
        let (news, known) = self.news(done.problems.clone());
        report(&news);
        let written = done.written.iter().filter(|file| !file.unchanged).count();
        let (counts, seconds) = (counts(&done.trace), done.seconds);
        let written = counted(written, "file");
        let known = match known {
            0 => String::new(),
            known => format!("; {} as before", counted(known, "warning")),
        };
        print(&format!("run {}: {counts}; {written} written; {seconds:.3} s{known}\n", done.run));
    }
}

fn has_errors(problems: &[Problem]) -> bool {
    problems.iter().any(|problem| problem.severity == Severity::Error)
}

/// The nodes under way, in the order of their names, each with its share.
type UnderWay = Arc<Mutex<BTreeMap<String, Option<f64>>>>;

/// The nodes that do not stop, in words.
type Unheeding = Arc<Mutex<Vec<String>>>;

/// An evaluation that takes longer than this shows which node it is at.
const PATIENCE: Duration = Duration::from_millis(300);

/// One block on a terminal.
pub(super) struct Terminal {
    screen: Screen,
    color: bool,
    block: Block,
    under_way: UnderWay,
    unheeding: Unheeding,
    began: Option<Instant>,
}

impl Terminal {
    pub(super) fn open(
        graph: &Path,
        folder: &Path,
        link: Option<String>,
        sink: impl Fn(Input) + Send + 'static,
    ) -> std::io::Result<Self> {
        let screen = Screen::open(sink)?;
        let color = shows_color(&std::io::stdout());
        let (graph, folder) = (graph.display().to_string(), folder.display().to_string());
        let block = Block { graph, folder, link, ..Block::default() };
        let (under_way, unheeding) = (UnderWay::default(), Unheeding::default());
        Ok(Self { screen, color, block, under_way, unheeding, began: None })
    }

    fn draw(&self) {
        self.screen.draw(&self.block.rows(self.screen.size(), self.color));
    }
}

impl Drop for Terminal {
    /// Leaves the last block on the terminal's own screen, where it can still be read, and without the keys.
    fn drop(&mut self) {
        let mut rows = self.block.rows(self.screen.size(), self.color);
        rows.pop();
        self.screen.close();
        print_as_it_is(&rows.iter().map(|row| format!("{row}\n")).collect::<String>());
    }
}

impl View for Terminal {
    fn observe(&self) -> Observe {
        let (under_way, unheeding) = (self.under_way.clone(), self.unheeding.clone());
        Box::new(move |_| {
            unheeding.lock().unwrap_or_else(|broken| broken.into_inner()).clear();
            Box::new(Follow(under_way.clone(), unheeding.clone()))
        })
    }

    fn watching(&mut self, files: &[PathBuf], polled: Option<&str>) {
        self.block.watched = files.len();
        self.block.polled = polled.map(str::to_owned);
        self.draw();
    }

    /// Draws nothing yet: most runs are over before anybody could read that they began.
    fn begin(&mut self, run: usize, _: &[PathBuf]) {
        self.block.run = run;
        self.block.problems.clear();
        self.block.running = true;
        self.block.node = None;
        self.began = Some(Instant::now());
    }

    /// Of a good graph the run says more.
    fn checked(&mut self, run: usize, problems: &[Problem]) {
        if !has_errors(problems) {
            return;
        }
        self.block.run = run;
        self.block.running = false;
        self.block.problems = problems.to_vec();
        self.draw();
    }

    fn end_broken(&mut self, _: usize, _: &[Problem]) {
        self.draw();
    }

    fn cancelled(&mut self, _: usize) {
        self.began = None;
        self.block.stubborn.clear();
    }

    fn end(&mut self, report: &Report) {
        self.began = None;
        self.block.stubborn.clear();
        self.block.running = false;
        self.block.command = None;
        self.block.run = report.run;
        self.block.problems = report.problems.clone();
        if !has_errors(&self.block.problems) {
            self.block.good = Some(report.run);
        }
        self.block.report = Some(report.clone());
        self.draw();
    }

    fn command_failed(&mut self, why: &str) {
        self.block.command = Some(why.to_owned());
        self.draw();
    }

    fn not_opened(&mut self, why: &str) {
        self.block.not_opened = Some(why.to_owned());
        self.draw();
    }

    fn refresh(&mut self) {
        if self.began.is_some_and(|began| began.elapsed() > PATIENCE) {
            let under_way = self.under_way.lock().unwrap_or_else(|broken| broken.into_inner());
            let first = under_way.iter().next();
            self.block.node = first.map(|(node, share)| (node.clone(), *share));
            drop(under_way);
            let unheeding = self.unheeding.lock().unwrap_or_else(|broken| broken.into_inner());
            self.block.stubborn.clone_from(&unheeding);
            drop(unheeding);
            self.draw();
        }
    }

    fn resized(&mut self) {
        self.draw();
    }

    fn toggle_profile(&mut self) {
        self.block.profile = !self.block.profile;
        self.draw();
    }
}

/// Notes which nodes are under way.
struct Follow(UnderWay, Unheeding);

impl Observer for Follow {
    fn started(&self, node: &str) {
        self.note(|nodes| nodes.insert(node.to_owned(), None));
    }

    fn progress(&self, node: &str, share: f64) {
        self.note(|nodes| nodes.get_mut(node).map(|known| known.replace(share)));
    }

    fn does_not_stop(&self, node: &str, kind: &str, pack: &str) {
        let words = does_not_stop(node, kind, pack);
        self.1.lock().unwrap_or_else(|broken| broken.into_inner()).push(words);
    }

    fn finished(&self, node: &str, _: State, _: f64) {
        self.note(|nodes| nodes.remove(node));
    }
}

impl Follow {
    fn note<T>(&self, change: impl FnOnce(&mut BTreeMap<String, Option<f64>>) -> T) {
        change(&mut self.0.lock().unwrap_or_else(|broken| broken.into_inner()));
    }
}

#[cfg(test)]
mod tests {
    use maquette_syntax::error::{Source, Span, code};

    use super::*;

    #[test]
    fn a_warning_is_told_when_it_comes_and_not_again_while_it_stays() {
        let source = Arc::new(Source { name: "a.ron".into(), text: String::new() });
        fn problem(severity: Severity, message: &str, source: &Arc<Source>) -> Problem {
            Problem::new(severity, code::WARNING, (source.clone(), Span::default()), message)
        }
        fn warning(source: &Arc<Source>) -> Problem {
            problem(Severity::Warning, "it is thin", source)
        }
        fn error(source: &Arc<Source>) -> Problem {
            problem(Severity::Error, "it is torn", source)
        }
        let mut lines = Lines::default();
        fn told(problems: Vec<Problem>, lines: &mut Lines) -> (Vec<String>, usize) {
            let (news, known) = lines.news(problems);
            (news.into_iter().map(|problem| problem.message).collect::<Vec<_>>(), known)
        }
        assert_eq!(
            told(vec![warning(&source), error(&source)], &mut lines),
            (vec!["it is thin".into(), "it is torn".into()], 0)
        );
        assert_eq!(
            told(vec![warning(&source), error(&source)], &mut lines),
            (vec!["it is torn".into()], 1)
        );
        assert_eq!(told(vec![], &mut lines), (vec![], 0));
        assert_eq!(told(vec![warning(&source)], &mut lines), (vec!["it is thin".into()], 0));
    }
}
