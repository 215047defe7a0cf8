//! Writes job files for the engines of render farms. Each job is one call of this program: `maquette batch SWEEP --handover HASH --task I`.
//! Before the jobs, one call with `--warm` fills the cache with the results that tasks share.

mod openjd;

use std::time::Duration;

use maquette_syntax::quote_for_shell;
use serde_json::json;

use super::job_parameters::JobParameter;

/// An engine that runs tasks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Engine {
    /// A job template of Open Job Description as JSON; keep the file in the current folder.
    Openjd,
    /// A script that submits the tasks to Slurm as a job array.
    Slurm,
    /// A Python script that submits the tasks to HyperQueue.
    Hq,
    /// A makefile that runs the tasks and writes the contact sheet.
    Make,
    /// One shell command per line, for GNU parallel, xargs or a shell.
    Lines,
}

/// The default maximum number of jobs in a Slurm job array.
const MAX_ARRAY: usize = 1000;

/// The time between the program's own time limit and the later time limit of the engine. It allows the program to report that its own limit
/// is exceeded.
const GRACE_PERIOD: Duration = Duration::from_secs(60);

/// The resources and limits of each job.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Resources {
    /// The number of tasks that a job runs in sequence.
    pub(crate) chunk: usize,
    /// The maximum number of jobs that run at the same time.
    pub(crate) at_once: Option<usize>,
    /// The maximum time for one task.
    pub(crate) time_limit: Option<Duration>,
    /// The number of threads of a job, or `None` if the user has not given it.
    pub(crate) threads: Option<usize>,
    /// The limit for the memory of results and running nodes together, in bytes. `None` if the user has not given it.
    pub(crate) memory: Option<u64>,
}

impl Resources {
    /// Returns the memory that a job requests from the engine, in MiB. This is the memory limit plus a quarter, for input files and the
    /// program itself.
    fn mebibytes(self) -> Option<u64> {
        self.memory.map(|bytes| (bytes + bytes / 4).div_ceil(1 << 20))
    }

    /// Returns the time after which the engine stops a job, or `None` without a limit.
    fn job_limit(self) -> Option<Duration> {
        let tasks = u32::try_from(self.chunk.max(1)).unwrap_or(u32::MAX);
        self.time_limit.map(|limit| limit.saturating_mul(tasks).saturating_add(GRACE_PERIOD))
    }
}

/// A batch whose tasks are handed over to an engine.
pub(crate) struct Handover<'a> {
    /// The name of the batch.
    pub(crate) name: &'a str,
    /// The command line of a job, without the arguments that select the task.
    pub(crate) words: &'a [String],
    /// The parameters of the graph that the submitter of an Open Job Description job can set.
    pub(crate) parameters: &'a [JobParameter],
    /// The number of tasks.
    pub(crate) tasks: usize,
    /// The current folder. Paths in the command line are relative to it.
    pub(crate) folder: &'a str,
    /// The folder for logs, relative to the current folder.
    pub(crate) logs: &'a str,
    pub(crate) resources: Resources,
}

impl Handover<'_> {
    pub(crate) fn to_text(&self, engine: Engine) -> String {
        match engine {
            Engine::Openjd => self.openjd(),
            Engine::Slurm => self.slurm(),
            Engine::Hq => self.hq(),
            Engine::Make => self.make(),
            Engine::Lines => self.lines(),
        }
    }

    fn command(&self) -> String {
        self.words.iter().map(|word| quote_for_shell(word)).collect::<Vec<_>>().join(" ")
    }

    /// Returns the number of jobs, and the argument that sets the number of tasks of each job. The argument is empty if each job runs one
    /// task.
    fn jobs(&self) -> (usize, String) {
        match self.resources.chunk {
            0 | 1 => (self.tasks, String::new()),
            chunk => (self.tasks.div_ceil(chunk), format!("--chunk {chunk} ")),
        }
    }

    /// Returns the jobs as one command per line. A shell that runs the lines continues after a failed command, and its exit code is that of
    /// the last command that failed.
    fn lines(&self) -> String {
        let (command, (jobs, chunk)) = (self.command(), self.jobs());
        (0..jobs)
            .map(|job| format!("{command} {chunk}--task {job} || trap \"exit $?\" 0\n"))
            .collect()
    }

    /// Returns a makefile that runs the jobs. make continues after failed jobs. The last command, which writes the contact sheet, fails if
    /// a job has failed.
    fn make(&self) -> String {
        let (jobs, chunk) = self.jobs();
        let names = (0..jobs).map(|job| job.to_string()).collect::<Vec<_>>().join(" ");
        let at_once = self.resources.at_once;
        let at_once = at_once.map_or(String::new(), |jobs| format!("MAKEFLAGS += -j{jobs}\n"));
        fill_template(
            include_str!("emit/make.mk"),
            &[
                ("TASKS", &self.tasks.to_string()),
                ("JOBS", &names),
                ("AT-ONCE", &at_once),
                ("CHUNK", &chunk),
                ("FOLDER", &quote_for_shell(self.folder).replace('$', "$$")),
                ("COMMAND", &self.command().replace('$', "$$")),
            ],
        )
    }

    /// Returns a shell script that submits a Slurm job array. If there are more tasks than allowed jobs, each job runs several tasks.
    fn slurm(&self) -> String {
        let chunk = self.resources.chunk.max(self.tasks.div_ceil(MAX_ARRAY)).max(1);
        let resources = Resources { chunk, ..self.resources };
        let (jobs, chunk) = Handover { resources, ..*self }.jobs();
        let Resources { at_once, threads, .. } = resources;
        let options = [
            threads.map(|threads| format!("--cpus-per-task={threads}")),
            resources.mebibytes().map(|memory| format!("--mem={memory}M")),
            resources.job_limit().map(|limit| format!("--time={}", limit.as_secs().div_ceil(60))),
        ];
        // Without --threads, let a job use the processors that Slurm allocates to it.
        let threads = if threads.is_none() { "--threads ${SLURM_CPUS_ON_NODE:-0}" } else { "" };
        fill_template(
            include_str!("emit/slurm.sh"),
            &[
                ("NAME", &quote_for_shell(self.name)),
                ("FOLDER", &quote_for_shell(self.folder)),
                ("LOGS", &quote_for_shell(self.logs)),
                ("COMMAND", &self.command()),
                ("TASKS", &self.tasks.to_string()),
                ("LAST", &jobs.saturating_sub(1).to_string()),
                ("AT-ONCE", &at_once.map_or(String::new(), |jobs| format!("%{jobs}"))),
                ("RESOURCES", &options.into_iter().flatten().collect::<Vec<_>>().join(" ")),
                ("THREADS", threads),
                ("CHUNK", &chunk),
            ],
        )
    }

    fn hq(&self) -> String {
        let (jobs, chunk) = self.jobs();
        let Resources { at_once, threads, .. } = self.resources;
        let memory = self.resources.mebibytes();
        // Without --threads, use one thread, because HyperQueue allocates one processor to a job by default.
        let mut words = self.words.to_vec();
        if threads.is_none() {
            words.extend(["--threads", "1"].map(str::to_owned));
        }
        let (import, request) = match (threads, memory) {
            (None, None) => ("", "None".to_owned()),
            (threads, memory) => {
                let memory = memory.map_or(json!({}), |memory| json!({ "mem": memory }));
                let threads = threads.unwrap_or(1);
                // Do not request memory from a worker that the script starts locally (`HERE`), because such a worker declares no memory.
                let memory = format!("{{}} if HERE else {memory}");
                let request = format!("ResourceRequest(cpus={threads}, resources={memory})");
                ("from hyperqueue.ffi.protocol import ResourceRequest\n", request)
            }
        };
        let chunk: Vec<_> = chunk.split_whitespace().collect();
        // Insert texts as JSON strings, which are also valid Python strings.
        fill_template(
            include_str!("emit/hq.py"),
            &[
                ("NAME", &json!(self.name).to_string()),
                ("FOLDER", &json!(self.folder).to_string()),
                ("LOGS", &json!(self.logs).to_string()),
                ("COMMAND", &json!(words).to_string()),
                ("CHUNK", &json!(chunk).to_string()),
                ("IMPORT", import),
                ("RESOURCES", &request),
                ("TASKS", &self.tasks.to_string()),
                ("JOBS", &jobs.to_string()),
                ("AT-ONCE", &at_once.unwrap_or(jobs).max(1).to_string()),
            ],
        )
    }
}

/// Replaces each placeholder `@NAME@` in a template by its value. Placeholders that occur in values are not replaced.
fn fill_template(text: &str, values: &[(&str, &str)]) -> String {
    let mut full = String::with_capacity(text.len());
    let mut rest = text;
    while let Some((before, behind)) = rest.split_once('@') {
        full += before;
        let value = behind.split_once('@').and_then(|(mark, behind)| {
            let (_, value) = values.iter().find(|(name, _)| *name == mark)?;
            Some((value, behind))
        });
        rest = match value {
            Some((value, behind)) => {
                full += value;
                behind
            }
            None => {
                full.push('@');
                behind
            }
        };
    }
    full + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    fn handover_text(engine: Engine, tasks: usize, resources: Resources) -> String {
        let words = ["maquette", "batch", "it's.ron", "--set", "a=$x"].map(str::to_owned);
        let (name, folder, logs) = ("it's", "/a b", "out/100%");
        let parameters = &[];
        Handover { name, words: &words, parameters, tasks, folder, logs, resources }.to_text(engine)
    }

    #[test]
    fn lines_are_shell_commands_for_any_arguments() {
        fn line(task: &str) -> String {
            format!(
                "maquette batch 'it'\\''s.ron' --set 'a=$x' --task {task} || trap \"exit $?\" 0\n"
            )
        }
        let lines = handover_text(Engine::Lines, 2, Resources::default());
        assert_eq!(lines, line("0") + &line("1"));
    }

    #[test]
    fn jobs_of_a_long_array_run_several_tasks() {
        let script = handover_text(Engine::Slurm, 2500, Resources::default());
        assert!(script.contains(" 0-833 ") && script.contains("--chunk 3 "), "{script}");
        let script = handover_text(Engine::Slurm, 6, Resources::default());
        assert!(script.contains(" 0-5 ") && !script.contains("--chunk"), "{script}");
    }

    #[test]
    fn each_engine_gets_the_resources_of_a_job() {
        let resources = Resources {
            chunk: 4,
            at_once: Some(3),
            time_limit: Some(Duration::from_secs(90)),
            threads: Some(8),
            memory: Some(4_000_000_000),
        };
        fn has(engine: Engine, wanted: &[&str], resources: &Resources) {
            let job = handover_text(engine, 10, *resources);
            for wanted in wanted {
                assert!(job.contains(wanted), "`{wanted}` in {job}");
            }
        }
        has(
            Engine::Slurm,
            &[" 0-2%3 ", "--chunk 4 ", "--cpus-per-task=8 --mem=4769M --time=7 ", "out/100%"],
            &resources,
        );
        has(
            Engine::Hq,
            &["cpus=8", "\"mem\":4769", "[\"--chunk\",\"4\"]", "range(3)", ", 3)"],
            &resources,
        );
        has(
            Engine::Openjd,
            &["\"0-2\"", "\"4\"", "\"timeout\": 420", "\"min\": 8", "\"min\": 4769"],
            &resources,
        );
        has(Engine::Make, &["-j3\n", "--chunk 4 --task", "a=$$x", "0 1 2: warm"], &resources);
        has(Engine::Lines, &["--chunk 4 --task 2 "], &resources);
    }

    #[test]
    fn a_job_template_is_json_with_all_tasks() {
        let job = handover_text(Engine::Openjd, 6, Resources::default());
        let job: serde_json::Value = serde_json::from_str(&job).unwrap();
        let step = &job["steps"][1];
        assert_eq!(step["parameterSpace"]["taskParameterDefinitions"][0]["range"], "0-5");
        let args = step["script"]["actions"]["onRun"]["args"].as_array().unwrap();
        assert_eq!(args.last().unwrap(), "{{Task.Param.Task}}");
    }
}
