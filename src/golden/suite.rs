//! Runs tests: every case of every graph, in parallel, and what became of each.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Component, Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Instant;

use maquette_engine::eval::{RunTrace, ThreadsError};
use maquette_engine::expect::Violation;
use maquette_engine::session;
use maquette_engine::session::Session;
use maquette_engine::writing::{Destination, Refused, Sources};
use maquette_graph::catalog::Catalog;
use maquette_node::pack::NewFile;
use maquette_syntax::error::{Problem, Severity};
use maquette_value::AnyValue;
use maquette_value::plain;

use crate::case;
use crate::case::TestFile;
use crate::store;
use crate::store::{Golden, NoGolden, Written, because};
use crate::{Comparison, Tolerance};

mod file;
pub mod html;
mod job;
pub mod junit;
mod misfits;
mod nodes;
mod orphans;
mod picture;
mod shard;
mod shared;

pub use file::{FileKind, of_file};
use job::Job;
use nodes::{changed_lines, changed_warnings};
pub use shard::Shard;
pub use shared::shared;

/// The folder of goldens beside a test file.
const FOLDER: &str = "goldens";

/// The file of a case's golden that says what its nodes were.
const NODES: &str = "nodes.txt";

/// The files of a golden, by what follows its name.
const SUFFIXES: [&str; 4] = [".txt", ".bin", ".png", ".view.png"];

/// What became of a case.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum State {
    Passed,
    Failed,
    /// The graph or its test is wrong.
    Broken,
    /// Why it was not run.
    Skipped(String),
}

/// One case of one graph, and what became of it.
pub struct Case {
    pub graph: PathBuf,
    pub name: String,
    /// Where its goldens are.
    pub folder: PathBuf,
    /// Where its test is.
    beside: PathBuf,
    /// What it is made of and reads.
    pub sources: Sources,
    pub state: State,
    pub outputs: Vec<Compared>,
    pub problems: Vec<Problem>,
    pub violations: Vec<Violation>,
    /// Warnings of nodes that came or went.
    pub warnings: Vec<String>,
    /// Goldens that nothing asks for.
    pub orphans: Vec<PathBuf>,
    /// What is worth a word although it is no failure.
    pub notes: Vec<String>,
    pub trace: RunTrace,
    pub seconds: f64,
    /// How much of it writing the outputs took.
    pub(crate) file_seconds: f64,
    /// The nodes as they are now; none if the graph could not be read.
    nodes: Option<String>,
}

/// A value that outputs give, beside its golden.
pub struct Compared {
    /// `node` or `node.output`: the golden's name.
    pub name: String,
    /// The files that it is written to.
    pub files: Vec<String>,
    pub comparison: Comparison,
    pub golden: Result<Golden, NoGolden>,
    /// Why the golden would be kept otherwise now, even if the value is the same.
    pub outdated: Option<&'static str>,
    pub value: AnyValue,
    /// Whether the golden would be another one.
    pub(crate) changed: bool,
    /// What the golden would tell beside the value.
    written: Vec<Written>,
    needed: Vec<(String, f64)>,
    tolerance: Tolerance,
}

impl Compared {
    /// The golden that would be written; of a large value it takes a while.
    fn new_files(&self) -> Vec<NewFile> {
        store::files(&self.value, &self.written, &self.needed, &self.tolerance)
    }
}

impl Case {
    pub fn title(&self) -> String {
        format!("{} {}", self.graph.display(), self.name)
    }

    pub fn failed(&self) -> bool {
        matches!(self.state, State::Failed | State::Broken)
    }

    /// Everything that is wrong, one thing a line.
    pub fn reasons(&self) -> Vec<String> {
        let problems = self.problems.iter().filter(|p| p.severity == Severity::Error);
        let mut reasons: Vec<String> = problems.map(|problem| problem.message.clone()).collect();
        reasons.extend(self.violations.iter().map(|violation| violation.problem.message.clone()));
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

    /// Which nodes are not what they were when the golden was accepted, in words.
    pub fn changed_nodes(&self) -> Vec<String> {
        match (self.nodes_before(), &self.nodes) {
            (Some(before), Some(now)) => changed_lines(&before, now),
            _ => Vec::new(),
        }
    }

    fn nodes_before(&self) -> Option<String> {
        plain::read_text(&self.folder.join(NODES)).ok()
    }

    /// Finds the warnings that came or went since the golden was accepted.
    fn judge_warnings(&mut self) {
        if let (Some(before), Some(now)) = (self.nodes_before(), &self.nodes) {
            self.warnings = changed_warnings(&before, now);
        }
    }

    /// The outputs whose goldens would be others.
    pub fn changed_outputs(&self) -> impl Iterator<Item = &Compared> {
        self.outputs.iter().filter(|output| output.changed)
    }

    /// Makes an output, as it is now, its golden, which says why it was accepted. Gives how many bytes it has.
    pub fn bless(&self, output: &Compared, why: &[String]) -> Result<usize, Refused> {
        let destination = Destination::own(&self.beside, &self.sources);
        destination.judge_folder(&self.folder)?;
        destination.sweep(&self.folder);
        let new = output.new_files();
        let before = orphans::goldens(&self.folder).remove(&output.name).unwrap_or_default();
        for suffix in SUFFIXES {
            let path = self.folder.join(format!("{}{suffix}", output.name));
            match new.iter().find(|file| file.name == suffix) {
                Some(file) if suffix == ".txt" => {
                    let because = because(why);
                    write(&destination, &path, &[&file.bytes[..], because.as_bytes()].concat())?;
                }
                Some(file) => write(&destination, &path, &file.bytes)?,
                None if before.contains(&path) => destination.remove(&path)?,
                None => {}
            }
        }
        Ok(new.iter().map(|file| file.bytes.len()).sum())
    }

    /// Accepts what is no output: the nodes as they are, their warnings, and that orphans go.
    pub fn bless_rest(&self) -> Result<(), Refused> {
        let destination = Destination::own(&self.beside, &self.sources);
        if let Some(nodes) = self.nodes.as_ref().filter(|_| !self.outputs.is_empty()) {
            write(&destination, &self.folder.join(NODES), nodes.as_bytes())?;
        }
        self.orphans.iter().try_for_each(|orphan| destination.remove(orphan))
    }
}

fn write(destination: &Destination<'_>, path: &Path, bytes: &[u8]) -> Result<(), Refused> {
    if plain::read_own(path).is_ok_and(|before| before == bytes) {
        return Ok(());
    }
    destination.write(path, bytes).map(|_| ())
}

/// What shapes a run of tests.
pub struct Settings<'a> {
    pub catalog: &'a Catalog,
    /// Only cases whose title holds this.
    pub filter: Option<&'a str>,
    /// Only this part of the cases that are left.
    pub shard: Option<Shard>,
    /// Of these test files only the cases of these graphs.
    pub graphs: &'a BTreeMap<PathBuf, BTreeSet<PathBuf>>,
    /// Nothing may come from the cache.
    pub cold: bool,
    /// Used graphs must be what lock files say.
    pub locked: bool,
    pub threads: usize,
    /// Makes a session of one thread: each case is run by one, and each that runs beside others needs its own.
    pub session: &'a (dyn Fn() -> Result<Session, String> + Sync),
    /// Is called with each session when there is nothing more to do for it.
    pub finish: &'a (dyn Fn(&Session) + Sync),
}

/// What came out of all tests.
pub struct Report {
    pub cases: Vec<Case>,
    /// What is wrong with test files and folders of goldens.
    pub problems: Vec<Problem>,
    pub orphans: Vec<PathBuf>,
    pub seconds: f64,
    /// How many cases were run at once.
    pub threads: usize,
}

impl Report {
    /// The time of all nodes that ran.
    pub fn node_seconds(&self) -> f64 {
        self.cases.iter().flat_map(|case| &case.trace.0).map(|node| node.seconds).sum()
    }

    /// The time of all outputs that were written.
    pub fn file_seconds(&self) -> f64 {
        self.cases.iter().map(|case| case.file_seconds).sum()
    }

    /// How many test files could not be run.
    pub fn broken_files(&self) -> usize {
        let files = self.problems.iter().map(|problem| &problem.source.name);
        BTreeSet::from_iter(files).len()
    }

    pub fn count(&self, wanted: impl Fn(&Case) -> bool) -> usize {
        self.cases.iter().filter(|case| wanted(case)).count()
    }
}

/// Runs the tests of these files.
pub fn run(paths: &[PathBuf], settings: &Settings<'_>) -> Result<Report, String> {
    let start = Instant::now();
    let mut problems = Vec::new();
    let mut tests = Vec::new();
    for path in paths {
        match case::read(path, settings.catalog) {
            Ok(test) => tests.push(test),
            Err(found) => problems.extend(found),
        }
    }
    let (found, files) = shared(&tests);
    problems.extend(found);
    tests.retain(|test| !files.contains(&test.source.name));
    let jobs: Vec<Job<'_>> = tests.iter().flat_map(jobs_of).collect();
    let mut orphans = match settings.filter {
        None if settings.graphs.is_empty() => orphans::unclaimed(&tests),
        _ => Vec::new(),
    };
    ThreadsError::judge(settings.threads).map_err(|error| error.to_string())?;
    let wanted = |job: &&Job<'_>| {
        let graphs = settings.graphs.get(&job.test.source.name);
        graphs.is_none_or(|graphs| graphs.contains(&job.graph))
            && settings.filter.is_none_or(|filter| job.title().contains(filter))
    };
    if let Some(filter) =
        settings.filter.filter(|_| problems.is_empty() && !jobs.iter().any(|job| wanted(&job)))
    {
        return Err(no_case(filter, &jobs));
    }
    let mut jobs: Vec<Job<'_>> = jobs.iter().filter(wanted).cloned().collect();
    if let Some(shard) = settings.shard {
        let mut is_in =
            shard.contains(&jobs.iter().map(Job::title).collect::<Vec<_>>()).into_iter();
        jobs.retain(|_| is_in.next().unwrap_or(false));
        if !shard.is_first() {
            problems.clear();
            orphans.clear();
        }
    }
    let next = AtomicUsize::new(0);
    let done: Mutex<Vec<(usize, Case)>> = Mutex::new(Vec::new());
    let failed: Mutex<Option<String>> = Mutex::new(None);
    let work = || match (settings.session)() {
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
            scope.spawn(work);
        }
    });
    if let Some(why) = failed.into_inner().unwrap_or_else(|broken| broken.into_inner()) {
        return Err(why);
    }
    let mut cases = done.into_inner().unwrap_or_else(|broken| broken.into_inner());
    cases.sort_by_key(|(index, _)| *index);
    let cases = cases.into_iter().map(|(_, case)| case).collect();
    let (seconds, threads) = (start.elapsed().as_secs_f64(), settings.threads);
    Ok(Report { cases, problems, orphans, seconds, threads })
}

/// What came out of the tests of a folder.
pub struct TestRun {
    /// How many cases passed.
    pub passed: usize,
    /// The graphs that were tested.
    pub graphs: Vec<PathBuf>,
    /// What is wrong, one thing each.
    pub failures: Vec<String>,
    report: Report,
}

impl TestRun {
    /// The page of `maquette test --report`: old, new and difference of each result that is not its golden.
    pub fn html(&self) -> String {
        html::page(&self.report)
    }

    /// The document of `maquette test --junit`, for CI systems.
    pub fn junit(&self) -> String {
        junit::document(&self.report)
    }
}

/// Runs all tests of graphs in a folder, as `maquette test --cold` does, so many at once.
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
        report.problems.iter().map(|problem| problem.message.clone()).collect::<Vec<_>>();
    for case in report.cases.iter().filter(|case| case.failed()) {
        failures.extend(case.reasons().iter().map(|why| format!("{}: {why}", case.title())));
    }
    let orphans = report.orphans.iter();
    failures.extend(orphans.map(|path| format!("{} belongs to no test", path.display())));
    let mut graphs: Vec<_> = report.cases.iter().map(|case| case.graph.clone()).collect();
    graphs.dedup();
    let passed = report.count(|case| case.state == State::Passed);
    Ok(TestRun { passed, graphs, failures, report })
}

/// A session of one thread that keeps nothing from one process to the next, and holds at most so much memory.
///
/// # Errors
/// If the thread cannot be started.
pub fn cold_session(catalog: &Arc<Catalog>, max_memory: Option<u64>) -> Result<Session, String> {
    /// Results of one case are small; this is plenty.
    const MEMORY: usize = 1 << 30;
    let none = session::Settings::in_memory();
    let settings = session::Settings { threads: 1, memory: MEMORY, max_memory, ..none };
    Session::with_catalog(catalog.clone(), &settings).map_err(|error| error.to_string())
}

/// What is said where no case is meant, with those that may have been.
fn no_case(filter: &str, jobs: &[Job<'_>]) -> String {
    const SOME: usize = 10;
    let titles: Vec<_> = jobs.iter().map(Job::title).collect();
    let words = titles.iter().flat_map(|title| title.split([' ', '/', '.']));
    let help = maquette_syntax::nearest(filter, words);
    fn some(titles: &[String]) -> String {
        let more = if titles.len() > SOME { ", .." } else { "" };
        let some = titles.iter().take(SOME).map(String::as_str).collect::<Vec<_>>().join(", ");
        format!("the cases: {some}{more}")
    }
    let help = if help.is_empty() { some(&titles).into() } else { help };
    format!("no case of a graph holds `{filter}` in its name; {help}")
}

fn next_job<'a, 'j>(next: &AtomicUsize, jobs: &'j [Job<'a>]) -> Option<(usize, &'j Job<'a>)> {
    let index = next.fetch_add(1, Ordering::Relaxed);
    jobs.get(index).map(|job| (index, job))
}

fn jobs_of(test: &TestFile) -> Vec<Job<'_>> {
    let beside = beside(test);
    let mut jobs = Vec::new();
    for graph in &test.graphs {
        // A graph in a folder above the test's has its goldens beside the test all the same.
        let place = graph.strip_prefix(beside).unwrap_or(graph).with_extension("");
        let parts = place.components().filter_map(|part| match part {
            Component::Normal(name) => Some(name),
            Component::ParentDir => Some("__above".as_ref()),
            _ => None,
        });
        let goldens = beside.join(FOLDER).join(PathBuf::from_iter(parts));
        for (case, (name, _)) in test.cases.iter().enumerate() {
            jobs.push(Job { test, graph: graph.clone(), case, folder: goldens.join(name) });
        }
    }
    jobs
}

/// The folder of a test.
fn beside(test: &TestFile) -> &Path {
    test.source.name.parent().unwrap_or(Path::new(""))
}
