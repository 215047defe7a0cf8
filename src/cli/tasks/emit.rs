//! Hands a batch over to a farm's engine: each task is one call of this program, `maquette batch SWEEP --handover HASH --task I`, so that there
//! is one way to run it. A first call, `--warm`, leaves in the cache what the tasks have in common.

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
    /// A command a line, for GNU parallel, xargs or a makefile.
    Lines,
}

/// Slurm's own limit of an array, unless somebody has changed it.
const LONGEST_ARRAY: usize = 1000;

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
}

impl Handover<'_> {
    pub(crate) fn to(&self, engine: Engine) -> String {
        match engine {
            Engine::Openjd => self.openjd(),
            Engine::Slurm => self.slurm(),
            Engine::Hq => self.hq(),
            Engine::Lines => {
                (0..self.tasks).map(|task| format!("{} --task {task}\n", self.command())).collect()
            }
        }
    }

    fn command(&self) -> String {
        Vec::from_iter(self.words.iter().map(|word| shell(word))).join(" ")
    }

    /// The template of a job. Its tasks run in folders of their own, so that the current one is a parameter.
    fn openjd(&self) -> String {
        let run = |inside: &str, last: &[&str]| {
            let words = ["-c", inside, "{{Param.Project}}"].into_iter().map(str::to_owned);
            // Braces would be taken for parameters.
            let own = self.words.iter().map(|word| word.replace("{{", "{ {").replace("}}", "} }"));
            let assignments = self.parameters.iter().map(|it| it.assignment.clone());
            let set = assignments.flat_map(|assignment| ["--set".to_owned(), assignment]);
            let last = last.iter().map(|&word| word.to_owned());
            let args = Vec::from_iter(words.chain(own).chain(set).chain(last));
            json!({ "command": "bash", "args": args })
        };
        let on_run = |last: &[&str]| json!({ "actions": { "onRun": run("cd \"$0\" && exec \"$@\"", last) } });
        // A step that depends on tasks does not run where one of them fails, but an environment ends in any case.
        let page = json!({ "onExit": run("cd \"$0\" && \"$@\" || true", &["--report"]) });
        let page = json!({ "name": "Page", "script": { "actions": page } });
        let tasks = json!({ "name": "Task", "type": "INT", "range": format!("0-{}", self.tasks.saturating_sub(1)) });
        let project = json!({
            "name": "Project",
            "type": "PATH",
            "objectType": "DIRECTORY",
            "dataFlow": "INOUT",
            "default": ".",
            "description": "The folder that the paths of the sweep and its results are relative to.",
        });
        let own = self.parameters.iter().map(|parameter| parameter.definition.clone());
        let definitions = Vec::from_iter([project].into_iter().chain(own));
        let job = json!({
            "specificationVersion": "jobtemplate-2023-09",
            "name": job_name(self.name),
            "parameterDefinitions": definitions,
            "steps": [
                { "name": "Warm", "script": on_run(&["--warm", "--events=openjd"]) },
                {
                    "name": "Tasks",
                    "dependencies": [{ "dependsOn": "Warm" }],
                    "parameterSpace": { "taskParameterDefinitions": [tasks] },
                    "stepEnvironments": [page],
                    "script": on_run(&["--events=openjd", "--task", "{{Task.Param.Task}}"]),
                },
                { "name": "Sheet", "dependencies": [{ "dependsOn": "Tasks" }], "script": on_run(&["--report"]) },
            ],
        });
        format!("{job:#}\n")
    }

    /// A script that submits an array. Its tasks take several in a row if there would be too many.
    fn slurm(&self) -> String {
        let each = self.tasks.div_ceil(LONGEST_ARRAY).max(1);
        filled(
            SLURM,
            &[
                ("NAME", &shell(self.name)),
                ("FOLDER", &shell(self.folder)),
                ("COMMAND", &self.command()),
                ("TASKS", &self.tasks.to_string()),
                ("LAST", &self.tasks.div_ceil(each).saturating_sub(1).to_string()),
                ("EACH", &each.to_string()),
                ("END", &self.tasks.saturating_sub(1).to_string()),
            ],
        )
    }

    fn hq(&self) -> String {
        // Texts of JSON are texts of Python.
        filled(
            HQ,
            &[
                ("NAME", &json!(self.name).to_string()),
                ("FOLDER", &json!(self.folder).to_string()),
                ("COMMAND", &json!(self.words).to_string()),
                ("TASKS", &self.tasks.to_string()),
            ],
        )
    }
}

/// A name that Open Job Description takes: up to 128 characters, without control characters and `{{`, which would begin a parameter.
fn job_name(name: &str) -> String {
    let name = name.replace("{{", "{ {").replace("}}", "} }");
    let name = name.chars().map(|c| if c.is_control() { '-' } else { c }).take(128);
    let name = String::from_iter(name);
    if name.trim().is_empty() { "batch".into() } else { name }
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

const SLURM: &str = r#"#!/usr/bin/env bash
# @TASKS@ tasks for Slurm: `bash THIS [OPTIONS OF SBATCH]`. The first job leaves in the cache what the tasks have in common, and the last one
# makes the contact sheet, whatever came of the tasks.
set -euo pipefail
cd @FOLDER@
command=(@COMMAND@)
options=("$@")

# Submits the command with more words, which may be worked out before, as an array, behind another job.
submit() {
    {
        printf '#!/usr/bin/env bash\ncd %q || exit\n%s\nexec' "$PWD" "${4:-}"
        printf ' %q' "${command[@]}"
        printf ' %s\n' "$3"
    } | sbatch --parsable --job-name=@NAME@ --array="$2" ${1:+--dependency="afterany:$1"} "${options[@]}"
}

warm=$(submit "" 0 --warm)
tasks=$(submit "$warm" 0-@LAST@ '--task "$first-$last"' \
    'first=$((SLURM_ARRAY_TASK_ID * @EACH@)); last=$((first + @EACH@ - 1)); [ $last -le @END@ ] || last=@END@')
sheet=$(submit "$tasks" 0 --report)
echo "$warm $tasks $sheet"
"#;

const HQ: &str = r#"#!/usr/bin/env python3
"""@TASKS@ tasks for HyperQueue: `python3 THIS [SERVER DIRECTORY]`, or `python3 THIS --here` without a server. It waits for them and makes the
contact sheet, whatever came of them. The first task leaves in the cache what the others have in common."""
import os
import subprocess
import sys

from hyperqueue import Client, Job, LocalCluster

COMMAND = @COMMAND@
FOLDER = @FOLDER@


def submitted(client, *calls):
    """Runs the command with each of these words. Returns how many failed."""
    job = Job(default_workdir=FOLDER, max_fails=None, name=@NAME@)
    for words in calls:
        job.program([*COMMAND, *words], stdout=os.devnull, stderr=os.devnull)
    job = client.submit(job)
    is_done = client.wait_for_jobs([job], raise_on_error=False)
    return 0 if is_done else len(client.get_failed_tasks(job))


def run(client):
    # Without the first call none of the others can run: the tasks are not those that were handed over.
    failed = @TASKS@ if submitted(client, ["--warm"]) else submitted(client, *(["--task", str(task)] for task in range(@TASKS@)))
    # It runs here, so that what it reports is seen.
    is_complete = subprocess.run([*COMMAND, "--report"], cwd=FOLDER).returncode == 0
    print(f"{@TASKS@ - failed} done, {failed} failed")
    return 0 if is_complete and not failed else 1


if sys.argv[1:] == ["--here"]:
    with LocalCluster() as cluster:
        cluster.start_worker()
        sys.exit(run(cluster.client()))
sys.exit(run(Client(*sys.argv[1:])))
"#;

#[cfg(test)]
mod tests {
    use super::*;

    fn handed(engine: Engine, tasks: usize) -> String {
        let words = ["maquette", "batch", "it's.ron", "--set", "a=$x"].map(str::to_owned);
        let (words, parameters) = (&words[..], &[][..]);
        Handover { name: "it's", words, parameters, tasks, folder: "/a b" }.to(engine)
    }

    #[test]
    fn any_name_is_one_of_a_job() {
        assert_eq!(job_name("a{{{b}}\n"), "a{ {{b} }-");
        assert_eq!(job_name(""), "batch");
        assert_eq!(job_name(&"\u{e4}".repeat(300)).chars().count(), 128);
    }

    #[test]
    fn lines_are_commands_whatever_the_words() {
        assert_eq!(
            handed(Engine::Lines, 2),
            "maquette batch 'it'\\''s.ron' --set 'a=$x' --task 0\nmaquette batch 'it'\\''s.ron' --set 'a=$x' --task 1\n"
        );
    }

    #[test]
    fn a_long_array_takes_several_tasks_at_a_time() {
        let script = handed(Engine::Slurm, 2500);
        assert!(
            script.contains(" 0-833 ") && script.contains("* 3)") && script.contains("last=2499"),
            "{script}"
        );
        let script = handed(Engine::Slurm, 6);
        assert!(script.contains(" 0-5 ") && script.contains("* 1)"), "{script}");
    }

    #[test]
    fn a_job_template_is_json_with_a_task_for_each() {
        let job: serde_json::Value = serde_json::from_str(&handed(Engine::Openjd, 6)).unwrap();
        let step = &job["steps"][1];
        assert_eq!(step["parameterSpace"]["taskParameterDefinitions"][0]["range"], "0-5");
        let args = step["script"]["actions"]["onRun"]["args"].as_array().unwrap();
        assert_eq!(args.last().unwrap(), "{{Task.Param.Task}}");
    }
}
