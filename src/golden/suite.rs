//! Runs tests: every case of every tested graph, in parallel.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Component, Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Instant;

use maquette_engine::eval::{RunTrace, ThreadsError};
use maquette_engine::expect::Violation;
use maquette_engine::session;
use maquette_engine::session::Session;
use maquette_engine::writing::{Destination, Sources, WriteError};
use maquette_graph::catalog::Catalog;
use maquette_node::pack::NewFile;
use maquette_syntax::error::{Diagnostic, Severity};
use maquette_value::AnyValue;
use maquette_value::fs;

use crate::case;
use crate::case::TestFile;
use crate::store;
use crate::store::{Golden, GoldenError, WrittenFile, reason_line};
use crate::{Comparison, Tolerance};

mod file;
pub mod html;
mod job;
pub mod junit;
mod nodes;
mod orphans;
mod picture;
mod shard;
mod shared;
mod validate;

pub use file::{FileKind, file_diagnostic};
use job::Job;
use nodes::{changed_lines, changed_warnings};
pub use shard::Shard;
pub use shared::shared_golden_folders;

/// The name of the folder of goldens next to a test file.
const GOLDENS_FOLDER: &str = "goldens";

/// The name of the file in a case's folder of goldens that lists the nodes of the graph.
const NODES_FILE: &str = "nodes.txt";

/// The suffixes that the names of a golden's files can have.
const SUFFIXES: [&str; 4] = [".txt", ".bin", ".png", ".view.png"];

/// The outcome of a case.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum State {
    Passed,
    Failed,
    /// The graph or the test file has errors.
    Broken,
    /// The case was skipped for this reason.
    Skipped(String),
}

/// One case of one graph, and its outcome.
pub struct Case {
    pub graph: PathBuf,
    pub name: String,
    /// The folder that contains the goldens of the case.
    pub folder: PathBuf,
    /// The folder that contains the test file.
    test_folder: PathBuf,
    /// The files that the graph consists of and reads.
    pub sources: Sources,
    pub state: State,
    pub outputs: Vec<OutputComparison>,
    pub diagnostics: Vec<Diagnostic>,
    pub violations: Vec<Violation>,
    /// Messages about warnings that are new or missing since the goldens were accepted.
    pub warnings: Vec<String>,
    /// Goldens in the folder of the case that belong to none of its outputs.
    pub orphans: Vec<PathBuf>,
    /// Notes for the user. They do not make the case fail.
    pub notes: Vec<String>,
    pub trace: RunTrace,
    pub seconds: f64,
    /// The time spent encoding the outputs as files, in seconds.
    pub(crate) file_seconds: f64,
    /// A description of the nodes that the graph has at present. `None` if the graph could not be read.
    nodes: Option<String>,
}

/// The comparison of the value of one or more outputs with its golden.
pub struct OutputComparison {
    /// The name of the golden: `node` or `node.output`.
    pub name: String,
    /// The names of the files to which the value is written.
    pub files: Vec<String>,
    pub comparison: Comparison,
    pub golden: Result<Golden, GoldenError>,
    /// The reason why the golden should be stored again even if the value is equal, or `None`.
    pub outdated_reason: Option<&'static str>,
    pub value: AnyValue,
    /// True if accepting the value would change the golden.
    pub(crate) changed: bool,
    /// Descriptions of the files to which the value was written. The golden contains them.
    files_written: Vec<WrittenFile>,
    accepted_differences: Vec<(String, f64)>,
    tolerance: Tolerance,
}

impl OutputComparison {
    /// Returns the files of a new golden for the value. Computing them takes time if the value is large.
    fn new_files(&self) -> Vec<NewFile> {
        store::files(&self.value, &self.files_written, &self.accepted_differences, &self.tolerance)
    }
}

impl Case {
    pub fn title(&self) -> String {
        format!("{} {}", self.graph.display(), self.name)
    }

    pub fn has_failed(&self) -> bool {
        matches!(self.state, State::Failed | State::Broken)
    }

    /// Returns the reasons why the case failed, one per line.
    pub fn reasons(&self) -> Vec<String> {
        let diagnostics = self.diagnostics.iter().filter(|p| p.severity == Severity::Error);
        let mut reasons: Vec<String> =
            diagnostics.map(|diagnostic| diagnostic.message.clone()).collect();
        reasons
            .extend(self.violations.iter().map(|violation| violation.diagnostic.message.clone()));
        reasons.extend(self.warnings.iter().cloned());
        for output in &self.outputs {
            reasons.extend(
                output.comparison.reasons.iter().map(|why| format!("{}: {why}", output.name)),
            );
        }
        reasons.extend(
            self.orphans.iter().map(|path| format!("{} belongs to no output", path.display())),
        );
        reasons
    }

    /// Describes which nodes have changed since the goldens were accepted.
    pub fn changed_nodes(&self) -> Vec<String> {
        match (self.nodes_before(), &self.nodes) {
            (Some(before), Some(now)) => changed_lines(&before, now),
            _ => Vec::new(),
        }
    }

    fn nodes_before(&self) -> Option<String> {
        fs::read_text(&self.folder.join(NODES_FILE)).ok()
    }

    /// Finds the warnings that are new or missing since the goldens were accepted.
    fn judge_warnings(&mut self) {
        if let (Some(before), Some(now)) = (self.nodes_before(), &self.nodes) {
            self.warnings = changed_warnings(&before, now);
        }
    }

    /// Returns the outputs whose goldens would change if their new values were accepted.
    pub fn changed_outputs(&self) -> impl Iterator<Item = &OutputComparison> {
        self.outputs.iter().filter(|output| output.changed)
    }

    /// Accepts the value of an output as its golden, with the reasons `why`. Returns the size of the golden in bytes.
    pub fn bless(&self, output: &OutputComparison, why: &[String]) -> Result<usize, WriteError> {
        let destination = Destination::without_links(&self.test_folder, &self.sources);
        destination.check_folder(&self.folder)?;
        destination.sweep(&self.folder);
        let new = output.new_files();
        let before = orphans::goldens(&self.folder).remove(&output.name).unwrap_or_default();
        for suffix in SUFFIXES {
            let path = self.folder.join(format!("{}{suffix}", output.name));
            match new.iter().find(|file| file.name == suffix) {
                Some(file) if suffix == ".txt" => {
                    let because = reason_line(why);
                    write(&destination, &path, &[&file.bytes[..], because.as_bytes()].concat())?;
                }
                Some(file) => write(&destination, &path, &file.bytes)?,
                None if before.contains(&path) => destination.remove(&path)?,
                None => {}
            }
        }
        Ok(new.iter().map(|file| file.bytes.len()).sum())
    }

    /// Accepts the rest of a case: its nodes and their warnings. Also removes the goldens that belong to no output.
    pub fn bless_rest(&self) -> Result<(), WriteError> {
        let destination = Destination::without_links(&self.test_folder, &self.sources);
        if let Some(nodes) = self.nodes.as_ref().filter(|_| !self.outputs.is_empty()) {
            write(&destination, &self.folder.join(NODES_FILE), nodes.as_bytes())?;
        }
        self.orphans.iter().try_for_each(|orphan| destination.remove(orphan))
    }
}

fn write(destination: &Destination<'_>, path: &Path, bytes: &[u8]) -> Result<(), WriteError> {
    if fs::read_no_follow(path).is_ok_and(|before| before == bytes) {
        return Ok(());
    }
    destination.write(path, bytes).map(|_| ())
}

/// The settings of a test run.
pub struct Settings<'a> {
    pub catalog: &'a Catalog,
    /// If given, only cases whose title contains this text are run.
    pub filter: Option<&'a str>,
    /// If given, only this part of the selected cases is run.
    pub shard: Option<Shard>,
    /// For each test file in this map, only the cases of the listed graphs are run. For all other test files, the cases of all graphs are
    /// run.
    pub graphs: &'a BTreeMap<PathBuf, BTreeSet<PathBuf>>,
    /// True to ignore cached results.
    pub cold: bool,
    /// True if used graphs must match the lock files.
    pub locked: bool,
    pub threads: usize,
    /// Creates a session with one thread. Each session runs one case at a time, so cases that run in parallel have different sessions.
    pub session: &'a (dyn Fn() -> Result<Session, String> + Sync),
    /// Called with each session after its last case.
    pub finish: &'a (dyn Fn(&Session) + Sync),
}

/// The report of a test run.
pub struct Report {
    pub cases: Vec<Case>,
    /// Errors in test files and in folders of goldens.
    pub diagnostics: Vec<Diagnostic>,
    pub orphans: Vec<PathBuf>,
    pub seconds: f64,
    /// The number of cases that ran in parallel.
    pub threads: usize,
}

impl Report {
    /// Returns the time for which nodes ran, in seconds, summed over all cases.
    pub fn node_seconds(&self) -> f64 {
        self.cases.iter().flat_map(|case| &case.trace.0).map(|node| node.seconds).sum()
    }

    /// Returns the time spent encoding the outputs as files, in seconds, summed over all cases.
    pub fn file_seconds(&self) -> f64 {
        self.cases.iter().map(|case| case.file_seconds).sum()
    }

    /// Returns the number of test files that could not be run.
    pub fn broken_files(&self) -> usize {
        let files = self.diagnostics.iter().map(|diagnostic| &diagnostic.source.name);
        BTreeSet::from_iter(files).len()
    }

    pub fn count(&self, wanted: impl Fn(&Case) -> bool) -> usize {
        self.cases.iter().filter(|case| wanted(case)).count()
    }
}

/// Runs the tests in the given files and folders.
pub fn run(paths: &[PathBuf], settings: &Settings<'_>) -> Result<Report, String> {
    let start = Instant::now();
    let mut diagnostics = Vec::new();
    let mut tests = Vec::new();
    for path in paths {
        match case::read(path, settings.catalog) {
            Ok(test) => tests.push(test),
            Err(found) => diagnostics.extend(found),
        }
    }
    let (found, files) = shared_golden_folders(&tests);
    diagnostics.extend(found);
    tests.retain(|test| !files.contains(&test.source.name));
    let jobs: Vec<Job<'_>> = tests.iter().flat_map(jobs_of).collect();
    let mut orphans = match settings.filter {
        None if settings.graphs.is_empty() => orphans::unclaimed_goldens(&tests),
        _ => Vec::new(),
    };
    ThreadsError::check(settings.threads).map_err(|error| error.to_string())?;
    let is_selected = |job: &&Job<'_>| {
        let graphs = settings.graphs.get(&job.test.source.name);
        graphs.is_none_or(|graphs| graphs.contains(&job.graph))
            && settings.filter.is_none_or(|filter| job.title().contains(filter))
    };
    if let Some(filter) = settings
        .filter
        .filter(|_| diagnostics.is_empty() && !jobs.iter().any(|job| is_selected(&job)))
    {
        return Err(no_case(filter, &jobs));
    }
    let mut jobs: Vec<Job<'_>> = jobs.iter().filter(is_selected).cloned().collect();
    if let Some(shard) = settings.shard {
        let mut is_in =
            shard.contains(&jobs.iter().map(Job::title).collect::<Vec<_>>()).into_iter();
        jobs.retain(|_| is_in.next().unwrap_or(false));
        if !shard.is_first() {
            diagnostics.clear();
            orphans.clear();
        }
    }
    let next = AtomicUsize::new(0);
    let done: Mutex<Vec<(usize, Case)>> = Mutex::new(Vec::new());
    let failed: Mutex<Option<String>> = Mutex::new(None);
    let run_jobs = || match (settings.session)() {
        Err(why) => *failed.lock().unwrap_or_else(|broken| broken.into_inner()) = Some(why),
        Ok(mut session) => {
            while let Some((index, job)) = next_job(&next, &jobs) {
                if settings.cold {
                    session.forget();
                }
                let case = job.run(&mut session, settings.locked);
                done.lock().unwrap_or_else(|broken| broken.into_inner()).push((index, case));
            }
            (settings.finish)(&session);
        }
    };
    std::thread::scope(|scope| {
        for _ in 0..settings.threads.clamp(1, jobs.len().max(1)) {
            scope.spawn(run_jobs);
        }
    });
    if let Some(why) = failed.into_inner().unwrap_or_else(|broken| broken.into_inner()) {
        return Err(why);
    }
    let mut cases = done.into_inner().unwrap_or_else(|broken| broken.into_inner());
    cases.sort_by_key(|(index, _)| *index);
    let cases = cases.into_iter().map(|(_, case)| case).collect();
    let (seconds, threads) = (start.elapsed().as_secs_f64(), settings.threads);
    Ok(Report { cases, diagnostics, orphans, seconds, threads })
}

/// The result of running all tests of graphs in a folder.
pub struct TestRun {
    /// The number of cases that passed.
    pub passed: usize,
    /// The graphs that were tested.
    pub graphs: Vec<PathBuf>,
    /// The failures. Each entry is a message about one case.
    pub failures: Vec<String>,
    report: Report,
}

impl TestRun {
    /// Returns the HTML page that `maquette test --report` writes. It shows the old value, the new value and the difference of each result
    /// that differs from its golden.
    pub fn html(&self) -> String {
        html::page(&self.report)
    }

    /// Returns the JUnit XML document that `maquette test --junit` writes for CI systems.
    pub fn junit(&self) -> String {
        junit::document(&self.report)
    }
}

/// Runs all tests of graphs in a folder without cached results, as `maquette test --cold` does. `threads` cases run in parallel.
///
/// # Errors
/// If threads cannot be started.
pub fn test_graphs(folder: &Path, catalog: &Catalog, threads: usize) -> Result<TestRun, String> {
    let catalog = &Arc::new(catalog.clone());
    let settings = Settings {
        catalog,
        filter: None,
        shard: None,
        graphs: &BTreeMap::new(),
        cold: true,
        locked: false,
        threads,
        session: &|| cold_session(catalog, None),
        finish: &Session::finish,
    };
    let report = run(&case::find(folder), &settings)?;
    let mut failures =
        report.diagnostics.iter().map(|diagnostic| diagnostic.message.clone()).collect::<Vec<_>>();
    for case in report.cases.iter().filter(|case| case.has_failed()) {
        failures.extend(case.reasons().iter().map(|why| format!("{}: {why}", case.title())));
    }
    let orphans = report.orphans.iter();
    failures.extend(orphans.map(|path| format!("{} belongs to no test", path.display())));
    let mut graphs: Vec<_> = report.cases.iter().map(|case| case.graph.clone()).collect();
    graphs.dedup();
    let passed = report.count(|case| case.state == State::Passed);
    Ok(TestRun { passed, graphs, failures, report })
}

/// Creates a session with one thread and a memory limit of `max_memory` bytes. Nothing is stored on disk.
///
/// # Errors
/// If the thread cannot be started.
pub fn cold_session(catalog: &Arc<Catalog>, max_memory: Option<u64>) -> Result<Session, String> {
    /// The maximum size of the results in memory, in bytes. Those of one case fit, because they are small.
    const MEMORY: usize = 1 << 30;
    let none = session::Settings::in_memory();
    let settings = session::Settings { threads: 1, memory: MEMORY, max_memory, ..none };
    Session::with_catalog(catalog.clone(), &settings).map_err(|error| error.to_string())
}

/// Returns the error that no case matches a filter. It lists titles that are similar to the filter.
fn no_case(filter: &str, jobs: &[Job<'_>]) -> String {
    const MAX_LISTED: usize = 10;
    let titles: Vec<_> = jobs.iter().map(Job::title).collect();
    let words = titles.iter().flat_map(|title| title.split([' ', '/', '.']));
    let help = maquette_syntax::nearest(filter, words);
    fn list_titles(titles: &[String]) -> String {
        let more = if titles.len() > MAX_LISTED { ", .." } else { "" };
        let some =
            titles.iter().take(MAX_LISTED).map(String::as_str).collect::<Vec<_>>().join(", ");
        format!("the cases: {some}{more}")
    }
    let help = if help.is_empty() { list_titles(&titles).into() } else { help };
    format!("no case of a graph has `{filter}` in its name; {help}")
}

fn next_job<'a, 'j>(next: &AtomicUsize, jobs: &'j [Job<'a>]) -> Option<(usize, &'j Job<'a>)> {
    let index = next.fetch_add(1, Ordering::Relaxed);
    jobs.get(index).map(|job| (index, job))
}

fn jobs_of(test: &TestFile) -> Vec<Job<'_>> {
    let beside = test_folder(test);
    let mut jobs = Vec::new();
    for graph in &test.graphs {
        // The goldens are always next to the test file, even if the graph is in a folder above the test file.
        let place = graph.strip_prefix(beside).unwrap_or(graph).with_extension("");
        let parts = place.components().filter_map(|part| match part {
            Component::Normal(name) => Some(name),
            Component::ParentDir => Some("__above".as_ref()),
            _ => None,
        });
        let goldens = beside.join(GOLDENS_FOLDER).join(PathBuf::from_iter(parts));
        for (case, (name, _)) in test.cases.iter().enumerate() {
            jobs.push(Job { test, graph: graph.clone(), case, folder: goldens.join(name) });
        }
    }
    jobs
}

/// Returns the folder that contains a test file.
fn test_folder(test: &TestFile) -> &Path {
    test.source.name.parent().unwrap_or(Path::new(""))
}
