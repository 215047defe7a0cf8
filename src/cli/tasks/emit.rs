//! Hands a batch over to a farm's engine: each job is one call of this program, `maquette batch SWEEP --handover HASH --task I`, so that there
//! is one way to run it. A first call, `--warm`, leaves in the cache what the tasks have in common.

mod openjd;

use std::time::Duration;

use maquette_syntax::shell;
use serde_json::json;

use super::job_parameters::JobParameter;

/// An engine that runs tasks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Engine {
    /// A job template of Open Job Description, as JSON, to be kept in the current folder.
    Openjd,
    /// A script that hands the tasks to Slurm as an array.
    Slurm,
    /// A Python script that hands the tasks to HyperQueue.
    Hq,
    /// A makefile, which runs the tasks and makes the contact sheet.
    Make,
    /// A command of a shell on each line, for GNU parallel, xargs or a shell.
    Lines,
}

/// Slurm's own limit of an array, unless somebody has changed it.
const LONGEST_ARRAY: usize = 1000;

/// An engine stops a job this much later than the program stops its tasks, so that the program can say why.
const GRACE: Duration = Duration::from_secs(60);

/// Resources and limits of each job.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Resources {
    /// The number of tasks that a job runs, one after the other.
    pub(crate) chunk: usize,
    /// The number of jobs that may run at a time.
    pub(crate) at_once: Option<usize>,
    /// The longest time for one task.
    pub(crate) time_limit: Option<Duration>,
    /// The number of threads; `None` if nothing was said.
    pub(crate) threads: Option<usize>,
    /// The limit of memory for results and nodes, in bytes.
    pub(crate) memory: Option<u64>,
}

impl Resources {
    /// The memory to ask for, in MiB: files that are read and the program itself come on top of the limit.
    fn mebibytes(self) -> Option<u64> {
        self.memory.map(|bytes| (bytes + bytes / 4).div_ceil(1 << 20))
    }

    /// The time after which an engine stops a job.
    fn job_limit(self) -> Option<Duration> {
        let tasks = u32::try_from(self.chunk.max(1)).unwrap_or(u32::MAX);
        self.time_limit.map(|limit| limit.saturating_mul(tasks).saturating_add(GRACE))
    }
}

/// What is handed over.
pub(crate) struct Handover<'a> {
    /// The name of the batch.
    pub(crate) name: &'a str,
    /// The program, and its words up to those that name a task.
    pub(crate) words: &'a [String],
    /// What who submits a job of Open Job Description may choose.
    pub(crate) parameters: &'a [JobParameter],
    /// How many tasks there are.
    pub(crate) tasks: usize,
    /// The current folder, that paths are relative to.
    pub(crate) folder: &'a str,
    /// The folder of logs, from the current one.
    pub(crate) logs: &'a str,
    pub(crate) resources: Resources,
}

impl Handover<'_> {
    pub(crate) fn to(&self, engine: Engine) -> String {
        match engine {
            Engine::Openjd => self.openjd(),
            Engine::Slurm => self.slurm(),
            Engine::Hq => self.hq(),
            Engine::Make => self.make(),
            Engine::Lines => self.lines(),
        }
    }

    fn command(&self) -> String {
        self.words.iter().map(|word| shell(word)).collect::<Vec<_>>().join(" ")
    }

    /// The number of jobs, and the words that say how many tasks each has.
    fn jobs(&self) -> (usize, String) {
        match self.resources.chunk {
            0 | 1 => (self.tasks, String::new()),
            chunk => (self.tasks.div_ceil(chunk), format!("--chunk {chunk} ")),
        }
    }

    /// Commands that also a shell may run one after the other: it goes on behind one that fails, and ends as the last of those did.
    fn lines(&self) -> String {
        let (command, (jobs, chunk)) = (self.command(), self.jobs());
        (0..jobs)
            .map(|job| format!("{command} {chunk}--task {job} || trap \"exit $?\" 0\n"))
            .collect()
    }

    /// A makefile whose jobs make goes on behind, whatever comes of them: the contact sheet's command fails if one of them did.
    fn make(&self) -> String {
        let (jobs, chunk) = self.jobs();
        let names = (0..jobs).map(|job| job.to_string()).collect::<Vec<_>>().join(" ");
        let at_once = self.resources.at_once;
        let at_once = at_once.map_or(String::new(), |jobs| format!("MAKEFLAGS += -j{jobs}\n"));
        filled(
            include_str!("emit/make.mk"),
            &[
                ("TASKS", &self.tasks.to_string()),
                ("JOBS", &names),
                ("AT-ONCE", &at_once),
                ("CHUNK", &chunk),
                ("FOLDER", &shell(self.folder).replace('$', "$$")),
                ("COMMAND", &self.command().replace('$', "$$")),
            ],
        )
    }

    /// A script that submits an array. Its jobs take several tasks if there would be too many.
    fn slurm(&self) -> String {
        let chunk = self.resources.chunk.max(self.tasks.div_ceil(LONGEST_ARRAY)).max(1);
        let resources = Resources { chunk, ..self.resources };
        let (jobs, chunk) = Handover { resources, ..*self }.jobs();
        let Resources { at_once, threads, .. } = resources;
        let options = [
            threads.map(|threads| format!("--cpus-per-task={threads}")),
            resources.mebibytes().map(|memory| format!("--mem={memory}M")),
            resources.job_limit().map(|limit| format!("--time={}", limit.as_secs().div_ceil(60))),
        ];
        // A job has the processors that Slurm gives it.
        let threads = if threads.is_none() { "--threads ${SLURM_CPUS_ON_NODE:-0}" } else { "" };
        filled(
            include_str!("emit/slurm.sh"),
            &[
                ("NAME", &shell(self.name)),
                ("FOLDER", &shell(self.folder)),
                ("LOGS", &shell(self.logs)),
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
        // A job has one processor there, unless it asks for more.
        let mut words = self.words.to_vec();
        if threads.is_none() {
            words.extend(["--threads", "1"].map(str::to_owned));
        }
        let (import, asked) = match (threads, memory) {
            (None, None) => ("", "None".to_owned()),
            (threads, memory) => {
                let memory = memory.map_or(json!({}), |memory| json!({ "mem": memory }));
                let threads = threads.unwrap_or(1);
                // A worker that is started here has processors alone.
                let memory = format!("{{}} if HERE else {memory}");
                let asked = format!("ResourceRequest(cpus={threads}, resources={memory})");
                ("from hyperqueue.ffi.protocol import ResourceRequest\n", asked)
            }
        };
        let chunk: Vec<_> = chunk.split_whitespace().collect();
        // Texts of JSON are texts of Python.
        filled(
            include_str!("emit/hq.py"),
            &[
                ("NAME", &json!(self.name).to_string()),
                ("FOLDER", &json!(self.folder).to_string()),
                ("LOGS", &json!(self.logs).to_string()),
                ("COMMAND", &json!(words).to_string()),
                ("CHUNK", &json!(chunk).to_string()),
                ("IMPORT", import),
                ("RESOURCES", &asked),
                ("TASKS", &self.tasks.to_string()),
                ("JOBS", &jobs.to_string()),
                ("AT-ONCE", &at_once.unwrap_or(jobs).max(1).to_string()),
            ],
        )
    }
}

/// A text with something in the place of each mark, `@NAME@`, that is in the text itself.
fn filled(text: &str, values: &[(&str, &str)]) -> String {
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

    fn handed(engine: Engine, tasks: usize, resources: Resources) -> String {
        let words = ["maquette", "batch", "it's.ron", "--set", "a=$x"].map(str::to_owned);
        let (name, folder, logs) = ("it's", "/a b", "out/100%");
        let parameters = &[];
        Handover { name, words: &words, parameters, tasks, folder, logs, resources }.to(engine)
    }

    #[test]
    fn lines_are_commands_whatever_the_words() {
        fn line(task: &str) -> String {
            format!(
                "maquette batch 'it'\\''s.ron' --set 'a=$x' --task {task} || trap \"exit $?\" 0\n"
            )
        }
        let lines = handed(Engine::Lines, 2, Resources::default());
        assert_eq!(lines, line("0") + &line("1"));
    }

    #[test]
    fn a_long_array_takes_several_tasks_at_a_time() {
        let script = handed(Engine::Slurm, 2500, Resources::default());
        assert!(script.contains(" 0-833 ") && script.contains("--chunk 3 "), "{script}");
        let script = handed(Engine::Slurm, 6, Resources::default());
        assert!(script.contains(" 0-5 ") && !script.contains("--chunk"), "{script}");
    }

    #[test]
    fn each_engine_is_asked_for_what_a_job_needs() {
        let resources = Resources {
            chunk: 4,
            at_once: Some(3),
            time_limit: Some(Duration::from_secs(90)),
            threads: Some(8),
            memory: Some(4_000_000_000),
        };
        fn has(engine: Engine, wanted: &[&str], resources: &Resources) {
            let job = handed(engine, 10, *resources);
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
    fn a_job_template_is_json_with_a_task_for_each() {
        let job = handed(Engine::Openjd, 6, Resources::default());
        let job: serde_json::Value = serde_json::from_str(&job).unwrap();
        let step = &job["steps"][1];
        assert_eq!(step["parameterSpace"]["taskParameterDefinitions"][0]["range"], "0-5");
        let args = step["script"]["actions"]["onRun"]["args"].as_array().unwrap();
        assert_eq!(args.last().unwrap(), "{{Task.Param.Task}}");
    }
}
