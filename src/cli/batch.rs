//! `maquette batch`: one graph over many scans and many values.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use clap::Args;
use maquette_engine::eval::Observer;
use maquette_engine::session::Session;
use maquette_golden::sweep::Sweep;
use maquette_graph::catalog::Catalog;
use maquette_node::CancelToken;
use maquette_syntax::error::Problem;
use maquette_syntax::{conflict_line, first_word};
use maquette_value::plain;
use serde_json::{Value as Json, json};

use super::caching::{self, CacheOptions};
use super::events::{EventFormat, Events, Listener};
use super::openjd::JobProgress;
use super::replay::ProvenanceOptions;
use super::{
    Exit, GraphOptions, assignment, counted, eprint, interrupt, print, print_json, put_problems,
    report,
};
use crate::Shown;
use crate::tasks as batch;
use crate::tasks::{
    Batch as Tasks, Ended, Hearer, Record, Running, State, at_a_time, default_folder,
};

mod farm;
mod summary;

use farm::FarmOptions;

/// What tasks have in common is computed once. Each leaves a record in OUT/tasks; a task whose record still holds is not run again.
#[derive(Args)]
pub(crate) struct Batch {
    /// A file with a Sweep(..), or a graph, with --sweep and --scans.
    #[arg(value_name = "SWEEP")]
    file: PathBuf,
    /// Sweep a parameter or field of the graph over these values; may be given several times.
    #[arg(long = "sweep", value_name = "NAME=VALUE,VALUE..", value_parser = assignment)]
    values: Vec<(String, String)>,
    /// Sweep the graph over these files or folders, in quotes: 'scans/*'. Each takes the place of the files that the graph reads.
    #[arg(long, value_name = "PATTERN")]
    scans: Option<String>,
    /// The folder of results; `out/SWEEP` if left out, `out/SWEEP-draft` with --draft.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// How many tasks to run at a time, each with its share of --memory; of a farm, how many jobs [default: 1, or as the farm has it].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    jobs: Option<u16>,
    /// Run what failed again, though nothing has changed.
    #[arg(long)]
    retry: bool,
    /// Only say what would run, and why.
    #[arg(short = 'n', long)]
    dry_run: bool,
    /// Run these tasks alone, counted from 0, as a farm does. The last one that was handed over makes the contact sheet.
    #[arg(long, value_name = "I|FIRST-LAST", value_parser = range, conflicts_with_all = ["dry_run", "report", "emit"])]
    task: Option<(usize, usize)>,
    /// Run only if the tasks are still those that were handed over under this hash, as `--emit` writes it into each job.
    #[arg(long, value_name = "HASH", value_parser = hash, conflicts_with_all = ["dry_run", "emit"])]
    handover: Option<String>,
    /// Run the first task, so that the others find in the cache what they share, and end well whatever comes of it.
    #[arg(long, conflicts_with_all = ["task", "dry_run", "report", "emit"])]
    warm: bool,
    /// Run nothing: make the contact sheet of the records that are there, and fail unless all tasks are done.
    #[arg(long, conflicts_with_all = ["dry_run", "emit"])]
    report: bool,
    #[command(flatten)]
    farm: FarmOptions,
    /// How many threads to use; 0 is all.
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
    /// Print what happens as it happens: one JSON object a line, or, by `openjd`, lines for an agent of Open Job Description.
    #[arg(long, value_name = "FORMAT", conflicts_with = "json", num_args = 0..=1, require_equals = true, default_missing_value = "json")]
    events: Option<EventFormat>,
}

fn range(text: &str) -> Result<(usize, usize), String> {
    fn number(text: &str) -> Option<usize> {
        text.trim().parse::<usize>().ok()
    }
    let range = match text.split_once('-') {
        Some((first, last)) => number(first).zip(number(last)),
        None => number(text).map(|only| (only, only)),
    };
    range
        .filter(|(first, last)| first <= last)
        .ok_or_else(|| "write I or FIRST-LAST, counted from 0".into())
}

fn hash(text: &str) -> Result<String, String> {
    // It becomes the name of a file.
    let is_hash = text.len() == batch::DIGITS
        && text.bytes().all(|c| c.is_ascii_hexdigit() && !c.is_ascii_uppercase());
    is_hash
        .then(|| text.to_owned())
        .ok_or_else(|| format!("use the {} digits that `--emit` wrote", batch::DIGITS))
}

impl Batch {
    pub(super) fn run(&self, catalog: &Arc<Catalog>) -> Exit {
        let start = Instant::now();
        let (path, text) = match self.text() {
            Ok(found) => found,
            Err(why) => return Exit::Usage(why),
        };
        let options = self.options.all();
        // A farm runs each task by itself: trying all values for each would take as long as all of them squared.
        let is_part = self.task.is_some() || self.warm || self.report;
        let read = if is_part {
            maquette_golden::sweep::read_untried
        } else {
            maquette_golden::sweep::read_text
        };
        let (sweep, problems) = read(&path, &text, catalog, &options);
        let Some(sweep) = sweep else {
            self.tell_problems(&problems);
            return Exit::Failed;
        };
        if !self.json {
            report(&problems);
        }
        let default = default_folder(&path, options.draft);
        let out = self.out.as_deref().unwrap_or(&default);
        let tasks = Tasks {
            sweep: &sweep,
            out,
            is_named: self.out.is_some(),
            options: &options,
            signs: self.provenance.signs(),
            retries: self.retry,
            time_limit: self.farm.time_limit,
            handover: self.handover.as_deref(),
            is_forecast: self.dry_run,
        };
        if let Some(engine) = self.farm.emit {
            return self.emit(engine, &tasks, catalog);
        }
        // The page is made of a changed list, too, and its changes are reported then.
        let handover = self.handover.as_deref().map_or(Ok(()), |hash| tasks.check_handover(hash));
        if self.report {
            return self.report_records(&tasks, handover, &problems);
        }
        if let Err(why) = handover {
            return Exit::Usage(why);
        }
        let wanted = match self.wanted(sweep.tasks.len()) {
            Ok(wanted) => wanted,
            Err(why) => return Exit::Usage(why),
        };
        if self.dry_run {
            return self.forecast(&tasks, &problems, catalog);
        }
        self.work(&tasks, &wanted, &problems, catalog, start)
    }

    /// The numbers of the tasks to run, of all that there are.
    fn wanted(&self, tasks: usize) -> Result<Vec<usize>, String> {
        let Some((first, last)) = self.task.filter(|_| !self.warm) else {
            return Ok(Vec::from_iter(0..if self.warm { 1 } else { tasks }));
        };
        let chunk = self.farm.chunk();
        let most = tasks.div_ceil(chunk).saturating_sub(1);
        if most < last {
            let what = if chunk == 1 { "task" } else { "chunk" };
            return Err(format!("there is no {what} {last}: they are counted from 0 to {most}"));
        }
        Ok(Vec::from_iter(first * chunk..tasks.min((last + 1) * chunk)))
    }

    /// The text of the sweep, and where it stands: for a graph it is made of the options.
    fn text(&self) -> Result<(PathBuf, String), String> {
        let read = plain::read_text(&self.file);
        let text = read.map_err(|error| format!("cannot read {}: {error}", self.file.shown()))?;
        let has_options = !self.values.is_empty() || self.scans.is_some();
        fn is_named_so(has_options: bool, file: &std::path::Path) -> bool {
            let name = file.to_string_lossy();
            !has_options && name.ends_with(maquette_golden::sweep::ENDING)
        }
        // What is wrong with a sweep is said as of any other file.
        let is_sweep = first_word(&text) == "Sweep"
            || is_named_so(has_options, &self.file)
            || conflict_line(&text).is_some();
        match (is_sweep, has_options) {
            (true, false) => return Ok((self.file.clone(), text)),
            (true, true) => {
                return Err("--sweep and --scans are for graphs: change the sweep's file".into());
            }
            (false, false) => {
                return Err(format!(
                    "{} is no Sweep(..): name what differs from task to task, `--sweep growth=5,12,20` or `--scans 'scans/*'`",
                    self.file.shown()
                ));
            }
            (false, true) => {}
        }
        let beside = self.file.with_extension("sweep.ron");
        Ok((beside, batch::text_of(&self.file, self.scans.as_deref(), &self.values)?))
    }

    /// One of so many sessions that work at the same time.
    fn session(&self, jobs: usize, catalog: &Arc<Catalog>) -> Result<Session, String> {
        let threads = match (self.threads, jobs) {
            (0, 2..) => {
                std::thread::available_parallelism().map_or(1, |all| (all.get() / jobs).max(1))
            }
            (threads, _) => threads,
        };
        self.cache.session_of(jobs, threads, catalog)
    }

    fn tell_problems(&self, problems: &[Problem]) {
        match self.json {
            true => {
                let mut document = json!({ "tasks": [] });
                put_problems(&mut document, problems);
                print_json(&document);
            }
            false => report(problems),
        }
    }

    fn work(
        &self,
        tasks: &Tasks<'_>,
        wanted: &[usize],
        problems: &[Problem],
        catalog: &Arc<Catalog>,
        start: Instant,
    ) -> Exit {
        let cancel = CancelToken::default();
        interrupt::cancels(&cancel);
        let events = Events::new(Listener::of_stdout(), cancel.clone());
        let job = JobProgress::new(wanted.len(), cancel.clone());
        let observer: &(dyn Observer + Sync) = match self.events {
            Some(EventFormat::Json) => &events,
            Some(EventFormat::Openjd) => &job,
            None => &(),
        };
        let is_openjd = self.events == Some(EventFormat::Openjd);
        let teller = Teller::new(tasks.sweep, self.json, self.events, is_openjd.then_some(&job));
        let jobs = at_a_time(self.jobs.map_or(1, usize::from), wanted.len());
        let ended = tasks.run_all(
            wanted,
            &Running {
                jobs,
                session: &|| self.session(jobs, catalog),
                finish: &caching::finish,
                observer,
                hearer: &teller,
                cancel: &cancel,
            },
        );
        let Counts { done, failed, ran, ended: records } = teller.into_counts();
        if let Err(why) = ended {
            return Exit::Usage(why);
        }
        if cancel.is_cancelled() {
            return Exit::Interrupted;
        }
        // The page is not what a job was asked for.
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
        let place = sheet.as_deref().map(|path| path.display().to_string());
        if self.json {
            let mut document = json!({ "tasks": records, "sheet": place, "seconds": seconds });
            put_problems(&mut document, problems);
            print_json(&document);
        } else if self.events == Some(EventFormat::Json) {
            let fields = json!({ "done": done, "failed": failed, "ran": ran, "sheet": place, "seconds": seconds });
            Listener::of_stdout().tell("batch", fields);
        } else if is_openjd {
            let all = counted(wanted.len(), "task");
            job.status(&format!("{all}: {done} done, {failed} failed, {ran} run now"));
        } else {
            let failed = if failed == 0 { String::new() } else { format!(", {failed} failed") };
            print(&format!(
                "{}: {done} done{failed}; {ran} run now; {seconds:.2} s\n{}",
                counted(wanted.len(), "task"),
                place.map_or(String::new(), |place| format!("{place}\n")),
            ));
        }
        if failed == 0 || self.warm { Exit::Done } else { Exit::Failed }
    }
}

/// A task that came to its end, as `--json` and `--events` have it.
fn record_fields(index: usize, record: &Record, was_run: bool) -> Json {
    let output = |it: &batch::Output| json!({ "name": it.name, "path": it.path, "bytes": it.bytes, "hash": it.hash.to_string() });
    let values = record.values.iter().map(|(name, value)| (name.clone(), value.clone().into()));
    json!({
        "task": index,
        "name": record.name,
        "state": record.state.word(),
        "ran": was_run,
        "values": values.collect::<serde_json::Map<_, _>>(),
        "seconds": record.seconds,
        "nodes": record.nodes,
        "outputs": record.outputs.iter().map(output).collect::<Vec<_>>(),
        "problems": record.problems,
    })
}

/// Why a task is not run.
fn unchanged_in_words(state: State) -> &'static str {
    match state {
        State::Done => "nothing has changed",
        State::Failed => "nothing has changed: --retry runs it again",
    }
}

/// What became of tasks.
#[derive(Default)]
struct Counts {
    done: usize,
    failed: usize,
    ran: usize,
    /// As `--json` has them.
    ended: Vec<Json>,
}

/// Tells what happens to tasks.
struct Teller<'a> {
    sweep: &'a Sweep,
    json: bool,
    events: Option<EventFormat>,
    job: Option<&'a JobProgress>,
    longest: usize,
    counts: Mutex<Counts>,
}

impl<'a> Teller<'a> {
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
        counts.ended.sort_by_key(|task| task["task"].as_u64());
        counts
    }
}

impl Hearer for Teller<'_> {
    fn begins(&self, index: usize) {
        if let Some(job) = self.job {
            job.task_begins(&self.sweep.tasks[index].name);
        } else if self.events.is_some() {
            let fields = json!({ "task": index, "name": self.sweep.tasks[index].name });
            Listener::of_stdout().tell("task-started", fields);
        }
    }

    fn ended(&self, Ended { index, record, was_run }: Ended) {
        let mut counts = self.counts.lock().unwrap_or_else(PoisonError::into_inner);
        match record.state {
            State::Done => counts.done += 1,
            State::Failed => counts.failed += 1,
        }
        counts.ran += usize::from(was_run);
        let problems = record.problems.iter().filter(|problem| problem["severity"] == "error");
        if self.json || self.events == Some(EventFormat::Json) {
            let fields = record_fields(index, &record, was_run);
            match self.json {
                true => counts.ended.push(fields),
                false => Listener::of_stdout().tell("task", fields),
            }
            return;
        }
        let nodes = record.nodes.iter().map(|(word, count)| format!("{count} {word}"));
        let rest = match was_run {
            true => format!("{:7.2} s  {}", record.seconds, Vec::from_iter(nodes).join(", ")),
            false => unchanged_in_words(record.state).to_owned(),
        };
        let longest = self.longest;
        match self.job {
            Some(job) => {
                job.task_ended();
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
            fn text(name: &str, problem: &Json) -> String {
                problem[name].as_str().unwrap_or_default().to_owned()
            }
            let help = if text("help", problem).is_empty() {
                String::new()
            } else {
                format!("; {}", text("help", problem))
            };
            let (line, column) = (&problem["line"], &problem["column"]);
            eprint(&format!(
                "error: {}:{line}:{column}: {}{help}\n",
                text("file", problem),
                text("message", problem)
            ));
        }
    }
}
