//! `maquette batch`: runs one graph many times, for different scans and parameter values.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use clap::Args;
use maquette_engine::eval::Observer;
use maquette_engine::session::Session;
use maquette_golden::sweep::Sweep;
use maquette_graph::catalog::Catalog;
use maquette_node::CancelToken;
use maquette_syntax::error::Diagnostic;
use maquette_syntax::{conflict_line, first_word};
use maquette_value::fs;
use serde_json::{Value as Json, json};

use super::cache_options::{self, CacheOptions};
use super::events::{EventFormat, Events, Listener};
use super::openjd::JobProgress;
use super::replay::ProvenanceOptions;
use super::{
    Exit, GraphOptions, eprint, format_count, interrupt, parse_assignment, print, print_json,
    put_problems, report,
};
use crate::DisplayPath;
use crate::tasks as batch;
use crate::tasks::{
    Batch as Tasks, ExecutionOptions, FinishedTask, Record, State, TaskObserver, default_folder,
    job_count, text_field,
};

mod farm;
mod summary;

use farm::FarmOptions;

/// Shared parts of the tasks are computed once. Each task writes a record to OUT/tasks; a task whose record is up to date does not run
/// again.
#[derive(Args)]
pub(crate) struct Batch {
    /// A file with a Sweep(..), or a graph, with --sweep and --scans.
    #[arg(value_name = "SWEEP")]
    file: PathBuf,
    /// Sweep a parameter or field of the graph over these values. May be repeated.
    #[arg(long = "sweep", value_name = "NAME=VALUE,VALUE..", value_parser = parse_assignment)]
    values: Vec<(String, String)>,
    /// Sweep the graph over these files or folders; quote the pattern: 'scans/*'. Each match replaces the files that the graph reads.
    #[arg(long, value_name = "PATTERN")]
    scans: Option<String>,
    /// The folder for the results [default: `out/SWEEP`; with --draft `out/SWEEP-draft`].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// The number of tasks to run at the same time; they divide --memory between them. With --emit, the number of jobs [default: 1, or the
    /// farm's own limit].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    jobs: Option<u16>,
    /// Run failed tasks again, even if nothing changed.
    #[arg(long)]
    retry: bool,
    /// Print which tasks would run, and why; run nothing.
    #[arg(short = 'n', long)]
    dry_run: bool,
    /// Run only these tasks, counted from 0. Jobs of a farm use this option; the job that finishes the last task writes the contact sheet.
    #[arg(long, value_name = "I|FIRST-LAST", value_parser = parse_range, conflicts_with_all = ["dry_run", "report", "emit"])]
    task: Option<(usize, usize)>,
    /// Run only if the tasks are those of the list with this hash. `--emit` writes the hash into each job.
    #[arg(long, value_name = "HASH", value_parser = parse_hash, conflicts_with_all = ["dry_run", "emit"])]
    handover: Option<String>,
    /// Run the first task to fill the cache for the others. The command succeeds even if the task fails.
    #[arg(long, conflicts_with_all = ["task", "dry_run", "report", "emit"])]
    warm: bool,
    /// Run nothing; write the contact sheet of the existing records. Fails unless all tasks are done.
    #[arg(long, conflicts_with_all = ["dry_run", "emit"])]
    report: bool,
    #[command(flatten)]
    farm: FarmOptions,
    /// The number of threads; 0 for all.
    #[arg(long, default_value_t = 0)]
    threads: usize,
    #[command(flatten)]
    options: GraphOptions,
    #[command(flatten)]
    cache: CacheOptions,
    #[command(flatten)]
    provenance: ProvenanceOptions,
    /// Print one JSON document.
    #[arg(long)]
    json: bool,
    /// Print events while the command runs: one JSON object per line, or with `openjd` the lines that an agent of Open Job Description
    /// reads.
    #[arg(long, value_name = "FORMAT", conflicts_with = "json", num_args = 0..=1, require_equals = true, default_missing_value = "json")]
    events: Option<EventFormat>,
}

fn parse_range(text: &str) -> Result<(usize, usize), String> {
    fn number(text: &str) -> Option<usize> {
        text.trim().parse::<usize>().ok()
    }
    let range = match text.split_once('-') {
        Some((first, last)) => number(first).zip(number(last)),
        None => number(text).map(|only| (only, only)),
    };
    range
        .filter(|(first, last)| first <= last)
        .ok_or_else(|| "expected I or FIRST-LAST, counted from 0".into())
}

fn parse_hash(text: &str) -> Result<String, String> {
    // Allow only hexadecimal digits, because the hash becomes a part of a file name.
    let is_hash = text.len() == batch::HASH_DIGITS
        && text.bytes().all(|c| c.is_ascii_hexdigit() && !c.is_ascii_uppercase());
    is_hash
        .then(|| text.to_owned())
        .ok_or_else(|| format!("expected the {} digits that `--emit` wrote", batch::HASH_DIGITS))
}

impl Batch {
    pub(super) fn run(&self, catalog: &Arc<Catalog>) -> Exit {
        let start = Instant::now();
        let (path, text) = match self.sweep_text() {
            Ok(found) => found,
            Err(why) => return Exit::Usage(why),
        };
        let options = self.options.to_options();
        // Check all values of the sweep only in a run of all tasks. A farm calls this program once for each task. If each call checked all
        // values, the total time would grow with the square of the number of tasks.
        let is_part = self.task.is_some() || self.warm || self.report;
        let read = if is_part {
            maquette_golden::sweep::read_without_trying
        } else {
            maquette_golden::sweep::read_text
        };
        let (sweep, diagnostics) = read(&path, &text, catalog, &options);
        let Some(sweep) = sweep else {
            self.print_problems(&diagnostics);
            return Exit::Failed;
        };
        if !self.json {
            report(&diagnostics);
        }
        let default = default_folder(&path, options.draft);
        let out = self.out.as_deref().unwrap_or(&default);
        let tasks = Tasks {
            sweep: &sweep,
            out,
            is_chosen_folder: self.out.is_some(),
            options: &options,
            has_provenance: self.provenance.signs(),
            retries_failures: self.retry,
            time_limit: self.farm.time_limit,
            handover: self.handover.as_deref(),
            is_forecast: self.dry_run,
        };
        if let Some(engine) = self.farm.emit {
            return self.emit(engine, &tasks, catalog);
        }
        // With --report the page is written even if the list of tasks has changed since it was handed over to the farm. The changes are
        // reported afterwards.
        let handover = self.handover.as_deref().map_or(Ok(()), |hash| tasks.check_handover(hash));
        if self.report {
            return self.report_records(&tasks, handover, &diagnostics);
        }
        if let Err(why) = handover {
            return Exit::Usage(why);
        }
        let task_indices = match self.task_indices(sweep.tasks.len()) {
            Ok(task_indices) => task_indices,
            Err(why) => return Exit::Usage(why),
        };
        if self.dry_run {
            return self.forecast(&tasks, &diagnostics, catalog);
        }
        self.run_tasks(&tasks, &task_indices, &diagnostics, catalog, start)
    }

    /// Returns the indices of the tasks that this command runs. `tasks` is the number of tasks in the sweep.
    fn task_indices(&self, tasks: usize) -> Result<Vec<usize>, String> {
        let Some((first, last)) = self.task.filter(|_| !self.warm) else {
            return Ok(Vec::from_iter(0..if self.warm { 1 } else { tasks }));
        };
        let chunk = self.farm.chunk();
        let most = tasks.div_ceil(chunk).saturating_sub(1);
        if most < last {
            let what = if chunk == 1 { "task" } else { "chunk" };
            return Err(format!("expected a {what} from 0 to {most}, found {last}"));
        }
        Ok(Vec::from_iter(first * chunk..tasks.min((last + 1) * chunk)))
    }

    /// Returns the path and the text of the sweep file. If the file is a graph, generates the text of a sweep from the options.
    fn sweep_text(&self) -> Result<(PathBuf, String), String> {
        let read = fs::read_text(&self.file);
        let text =
            read.map_err(|error| format!("cannot read {}: {error}", self.file.for_display()))?;
        let has_options = !self.values.is_empty() || self.scans.is_some();
        let is_sweep_name =
            self.file.to_string_lossy().ends_with(maquette_golden::sweep::EXTENSION);
        // Treat a file with syntax errors as a sweep if its name or a merge conflict in it says so: the user needs the errors of the sweep.
        let is_sweep = first_word(&text) == "Sweep"
            || (is_sweep_name && !has_options)
            || conflict_line(&text).is_some();
        match (is_sweep, has_options) {
            (true, false) => return Ok((self.file.clone(), text)),
            (true, true) => {
                return Err(
                    "--sweep and --scans need a graph, not a sweep; edit the sweep file instead"
                        .into(),
                );
            }
            (false, false) => {
                return Err(format!(
                    "{} is not a Sweep(..); add the values that differ between tasks: `--sweep growth=5,12,20` or `--scans 'scans/*'`",
                    self.file.for_display()
                ));
            }
            (false, true) => {}
        }
        let beside = self.file.with_extension("sweep.ron");
        Ok((beside, batch::generate_sweep(&self.file, self.scans.as_deref(), &self.values)?))
    }

    /// Creates one of `jobs` sessions that run at the same time. Threads and memory are divided equally between them.
    fn session(&self, jobs: usize, catalog: &Arc<Catalog>) -> Result<Session, String> {
        let threads = match (self.threads, jobs) {
            (0, 2..) => {
                std::thread::available_parallelism().map_or(1, |all| (all.get() / jobs).max(1))
            }
            (threads, _) => threads,
        };
        self.cache.session_of(jobs, threads, catalog)
    }

    fn print_problems(&self, diagnostics: &[Diagnostic]) {
        match self.json {
            true => {
                let mut document = json!({ "tasks": [] });
                put_problems(&mut document, diagnostics);
                print_json(&document);
            }
            false => report(diagnostics),
        }
    }

    fn run_tasks(
        &self,
        tasks: &Tasks<'_>,
        task_indices: &[usize],
        diagnostics: &[Diagnostic],
        catalog: &Arc<Catalog>,
        start: Instant,
    ) -> Exit {
        let cancel = CancelToken::default();
        interrupt::cancel_on_interrupt(&cancel);
        let events = Events::new(Listener::of_stdout(), cancel.clone());
        let job = JobProgress::new(task_indices.len(), cancel.clone());
        let observer: &(dyn Observer + Sync) = match self.events {
            Some(EventFormat::Json) => &events,
            Some(EventFormat::Openjd) => &job,
            None => &(),
        };
        let is_openjd = self.events == Some(EventFormat::Openjd);
        let teller =
            TaskReporter::new(tasks.sweep, self.json, self.events, is_openjd.then_some(&job));
        let jobs = job_count(self.jobs.map_or(1, usize::from), task_indices.len());
        let ended = tasks.run_all(
            task_indices,
            &ExecutionOptions {
                jobs,
                session: &|| self.session(jobs, catalog),
                finish: &cache_options::finish,
                observer,
                task_observer: &teller,
                cancel: &cancel,
            },
        );
        let Counts { done, failed, run_now: ran, records } = teller.into_counts();
        if let Err(why) = ended {
            return Exit::Usage(why);
        }
        if cancel.is_cancelled() {
            return Exit::Interrupted;
        }
        // If the contact sheet cannot be written, only warn: the task itself succeeded.
        if self.task.is_some()
            && self.handover.is_some()
            && tasks.have_all_ended()
            && let Err(why) = tasks.write_sheet()
        {
            eprint(&format!("warning: {why}\n"));
        }
        let is_whole = self.task.is_none() && !self.warm;
        let sheet = if is_whole { Some(tasks.write_sheet()) } else { None };
        let sheet = match sheet.transpose() {
            Ok(sheet) => sheet,
            Err(why) => return Exit::Usage(why),
        };
        let seconds = start.elapsed().as_secs_f64();
        let sheet_path = sheet.as_deref().map(|path| path.display().to_string());
        if self.json {
            let mut document = json!({ "tasks": records, "sheet": sheet_path, "seconds": seconds });
            put_problems(&mut document, diagnostics);
            print_json(&document);
        } else if self.events == Some(EventFormat::Json) {
            let fields = json!({ "done": done, "failed": failed, "ran": ran, "sheet": sheet_path, "seconds": seconds });
            Listener::of_stdout().send("batch", fields);
        } else if is_openjd {
            let all = format_count(task_indices.len(), "task");
            job.status(&format!("{all}: {done} done, {failed} failed, {ran} run now"));
        } else {
            let failed = if failed == 0 { String::new() } else { format!(", {failed} failed") };
            print(&format!(
                "{}: {done} done{failed}; {ran} run now; {seconds:.2} s\n{}",
                format_count(task_indices.len(), "task"),
                sheet_path.map_or(String::new(), |sheet_path| format!("{sheet_path}\n")),
            ));
        }
        if failed == 0 || self.warm { Exit::Done } else { Exit::Failed }
    }
}

/// Returns the JSON fields that `--json` and `--events` print for a finished task.
fn record_fields(index: usize, record: &Record, was_run: bool) -> Json {
    let outputs = record.outputs.iter().map(|it| json!({ "name": it.name, "path": it.path, "bytes": it.bytes, "hash": it.hash.to_string() }));
    let values = record.values.iter().map(|(name, value)| (name.clone(), value.clone().into()));
    json!({
        "task": index,
        "name": record.name,
        "state": record.state.word(),
        "ran": was_run,
        "values": values.collect::<serde_json::Map<_, _>>(),
        "seconds": record.seconds,
        "nodes": record.nodes,
        "outputs": outputs.collect::<Vec<_>>(),
        "problems": record.problems,
    })
}

/// Returns the reason why a task with an up-to-date record is not run.
fn unchanged_reason(state: State) -> &'static str {
    match state {
        State::Done => "nothing has changed",
        State::Failed => "nothing has changed; use --retry to run it again",
    }
}

/// The number of finished tasks by result, and their records.
#[derive(Default)]
struct Counts {
    done: usize,
    failed: usize,
    run_now: usize,
    /// The records of the finished tasks as JSON, in the form that `--json` prints.
    records: Vec<Json>,
}

/// Prints the progress of tasks.
struct TaskReporter<'a> {
    sweep: &'a Sweep,
    json: bool,
    events: Option<EventFormat>,
    job: Option<&'a JobProgress>,
    longest: usize,
    counts: Mutex<Counts>,
}

impl<'a> TaskReporter<'a> {
    fn new(
        sweep: &'a Sweep,
        json: bool,
        events: Option<EventFormat>,
        job: Option<&'a JobProgress>,
    ) -> Self {
        let longest = sweep.tasks.iter().map(|task| task.name.len()).max().unwrap_or(0);
        Self { sweep, json, events, job, longest, counts: Mutex::default() }
    }

    fn into_counts(self) -> Counts {
        let mut counts = self.counts.into_inner().unwrap_or_else(PoisonError::into_inner);
        counts.records.sort_by_key(|task| task["task"].as_u64());
        counts
    }
}

impl TaskObserver for TaskReporter<'_> {
    fn on_begin(&self, index: usize) {
        if let Some(job) = self.job {
            job.begin_task(&self.sweep.tasks[index].name);
        } else if self.events.is_some() {
            let fields = json!({ "task": index, "name": self.sweep.tasks[index].name });
            Listener::of_stdout().send("task-started", fields);
        }
    }

    fn on_end(&self, FinishedTask { index, record, was_run }: FinishedTask) {
        let mut counts = self.counts.lock().unwrap_or_else(PoisonError::into_inner);
        match record.state {
            State::Done => counts.done += 1,
            State::Failed => counts.failed += 1,
        }
        counts.run_now += usize::from(was_run);
        let problems = record.problems.iter().filter(|problem| problem["severity"] == "error");
        if self.json || self.events == Some(EventFormat::Json) {
            let fields = record_fields(index, &record, was_run);
            match self.json {
                true => counts.records.push(fields),
                false => Listener::of_stdout().send("task", fields),
            }
            return;
        }
        let nodes = record.nodes.iter().map(|(word, count)| format!("{count} {word}"));
        let rest = match was_run {
            true => format!("{:7.2} s  {}", record.seconds, Vec::from_iter(nodes).join(", ")),
            false => unchanged_reason(record.state).to_owned(),
        };
        let longest = self.longest;
        match self.job {
            Some(job) => {
                job.end_task();
                let mut messages = problems.clone().filter_map(|it| it["message"].as_str());
                messages.next().into_iter().for_each(|why| job.fail(why));
            }
            None => print(&format!(
                "{:<6}  {index:>4}  {:<longest$}  {rest}\n",
                record.state.word(),
                record.name
            )),
        }
        for problem in problems {
            let help = match text_field(problem, "help") {
                "" => String::new(),
                help => format!("; {help}"),
            };
            let (line, column) = (&problem["line"], &problem["column"]);
            eprint(&format!(
                "error: {}:{line}:{column}: {}{help}\n",
                text_field(problem, "file"),
                text_field(problem, "message")
            ));
        }
    }
}
