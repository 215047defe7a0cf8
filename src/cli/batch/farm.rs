//! `maquette batch --emit`: writes job files for render farms and job schedulers.

use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::Args;
use maquette_golden::sweep::Sweep;
use maquette_graph::Graph;
use maquette_graph::catalog::Catalog;
use maquette_syntax::paths::{folder_of_new, without_dots};

use super::Batch;
use crate::tasks::{
    Batch as Tasks, Engine, Handover, JobParameter, Resources, format_time, parse_time,
};
use crate::{Exit, eprint, print_document};

#[derive(Args)]
pub(super) struct FarmOptions {
    /// Print a job file that submits the tasks to this engine, and write the list of tasks to OUT/tasks/@handovers. A job runs only while
    /// its task is unchanged in the list. Each job requests --threads, 1.25 times --max-memory and --time-limit; --jobs of them run at a
    /// time.
    #[arg(long, value_name = "ENGINE", conflicts_with = "dry_run")]
    pub(super) emit: Option<Engine>,
    /// The number of tasks that each job of a farm runs in sequence. `--task I` then selects the I-th job.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    chunk: u32,
    /// Stop a task that takes longer than this: 90s, 30min, 2h. The task has failed; the next run tries it again.
    #[arg(long, value_name = "TIME", value_parser = parse_time)]
    pub(super) time_limit: Option<Duration>,
}

impl FarmOptions {
    pub(super) fn chunk(&self) -> usize {
        self.chunk as usize
    }
}

impl Batch {
    pub(super) fn emit(&self, engine: Engine, tasks: &Tasks<'_>, catalog: &Catalog) -> Exit {
        let folder = match std::env::current_dir() {
            Ok(folder) => folder.display().to_string(),
            Err(error) => {
                return Exit::Usage(format!("cannot determine the current folder: {error}"));
            }
        };
        if let (Some(_), Engine::Openjd | Engine::Lines) = (self.jobs, engine) {
            let help = match engine {
                Engine::Openjd => "set it where the job is submitted",
                _ => "use `parallel --jobs N`",
            };
            return Exit::Usage(format!(
                "{} cannot limit the number of simultaneous jobs; {help}",
                engine_name(engine)
            ));
        }
        let mut words = self.arguments();
        if let (Some(word), Engine::Lines | Engine::Make) =
            (words.iter().find(|it| it.contains('\n')), engine)
        {
            return Exit::Usage(format!(
                "expected arguments without line breaks for {}, found {word:?}",
                engine_name(engine)
            ));
        }
        let hash = match tasks.hand_over() {
            Ok(hash) => hash,
            Err(why) => return Exit::Usage(why),
        };
        if self.cache.hides_server() {
            eprint(
                "warning: --cache-remote contains a name or a password and is left out of the jobs\n  = help: set MAQUETTE_CACHE_REMOTE on the machines that run them\n",
            );
        }
        let logs = in_project(&tasks.logs(&hash));
        words.extend(["--handover".into(), hash]);
        let sweep = tasks.sweep;
        let name = sweep.source.name.file_stem().unwrap_or_default().to_string_lossy();
        let parameters = match engine {
            Engine::Openjd => self.job_parameters(sweep, catalog),
            Engine::Slurm | Engine::Hq | Engine::Make | Engine::Lines => Vec::new(),
        };
        let resources = Resources {
            chunk: self.farm.chunk(),
            at_once: self.jobs.map(usize::from),
            time_limit: self.farm.time_limit,
            threads: Some(self.threads).filter(|&threads| threads != 0),
            memory: self.cache.max_memory,
        };
        let (words, parameters, tasks) = (&words[..], &parameters[..], sweep.tasks.len());
        let (name, folder, logs) = (&name[..], &folder[..], &logs[..]);
        let handover = Handover { name, words, parameters, tasks, folder, logs, resources };
        print_document(&handover.to_text(engine));
        Exit::Done
    }

    /// Returns the parameters of the graph that neither this command nor the sweep sets.
    fn job_parameters(&self, sweep: &Sweep, catalog: &Catalog) -> Vec<JobParameter> {
        let options = self.options.to_options();
        let checked = Graph::load(&sweep.graph, catalog, &options);
        let Some(graph) = checked.graph.or(checked.partial) else { return Vec::new() };
        let swept = sweep.tasks.iter().flat_map(|task| &task.row.set).map(|set| &set.target[..]);
        let set = options.set.iter().map(|(name, _)| &name[..]).chain(swept).collect();
        JobParameter::from_graph(&graph, &set, options.draft)
    }

    /// Returns the arguments of this command without those that select tasks.
    fn arguments(&self) -> Vec<String> {
        let program = std::env::args().next().unwrap_or_else(|| "maquette".into());
        let mut words = vec![program, "batch".into(), in_project(&self.file)];
        fn add(name: &str, value: &str, words: &mut Vec<String>) {
            words.extend([name.to_owned(), value.to_owned()]);
        }
        for (name, values) in &self.values {
            add("--sweep", &format!("{name}={values}"), &mut words);
        }
        if let Some(scans) = &self.scans {
            add("--scans", &in_project(scans.as_ref()), &mut words);
        }
        if let Some(out) = &self.out {
            add("--out", &in_project(out), &mut words);
        }
        if self.threads != 0 {
            add("--threads", &self.threads.to_string(), &mut words);
        }
        if let Some(limit) = self.farm.time_limit {
            add("--time-limit", &format_time(limit), &mut words);
        }
        if self.retry {
            words.push("--retry".into());
        }
        let mut options = self.options.to_options();
        options.roots = options.roots.iter().map(|root| in_project(root).into()).collect();
        words.extend(options.words());
        words.extend(self.options.no_pins.then(|| "--no-pins".to_owned()));
        words.extend(self.cache.arguments_with(in_project));
        words.extend(self.provenance.arguments());
        words
    }
}

fn engine_name(engine: Engine) -> &'static str {
    match engine {
        Engine::Openjd => "a job of Open Job Description",
        Engine::Slurm => "Slurm",
        Engine::Hq => "HyperQueue",
        Engine::Make => "a makefile",
        Engine::Lines => "commands on lines",
    }
}

/// Returns a path in the form for job files. A path inside of the current folder becomes relative to it, because the folder may have
/// another path on other machines. The result never begins with `-`, so it cannot be mistaken for an option.
fn in_project(path: &Path) -> String {
    let folder = std::env::current_dir().unwrap_or_default();
    let inner = path_inside(path, &folder);
    let path = inner.as_deref().unwrap_or(path).display().to_string();
    if path.starts_with('-') { format!("./{path}") } else { path }
}

/// Returns `path` relative to `folder`, or `None` if `path` is already relative or outside of `folder`.
fn path_inside(path: &Path, folder: &Path) -> Option<PathBuf> {
    if path.is_relative() && !path.starts_with("..") {
        return None;
    }
    let whole = without_dots(&folder.join(path));
    // Compare both forms of the path with the folder: as given, and with symbolic links resolved. In a pattern such as `scans/*.obj` only
    // the folders before the first `*` exist.
    let real = folder_of_new(&whole).join(whole.file_name()?);
    let ways = [(&whole, folder.to_owned()), (&real, std::fs::canonicalize(folder).ok()?)];
    let inner = ways.iter().find_map(|(path, folder)| path.strip_prefix(folder).ok())?;
    Some(if inner.as_os_str().is_empty() { ".".into() } else { inner.to_owned() })
}
