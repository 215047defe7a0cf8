//! Batches on farms: each test is named after a guarantee of the jobs that `batch --emit` writes. Short scripts replace the job engines
//! here; `tests/farm/run` uses real ones.
#![cfg(unix)]

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value as Json;

use crate::output::{stderr_of, stdout_of};
use crate::project::Project;

mod expected;

const GRAPH: &str = r#"Graph(
    format: 1,
    params: { "up": Number(default: 1.0, doc: "How far it is moved.") },
    nodes: {
        "scan": ReadMesh(path: "ball.obj"),
        "moved": Transform(mesh: "scan", translate: (0, Param("up"), 0)),
    },
    outputs: { "a.ply": "moved" },
)
"#;

const SWEEP: &str = r#"Sweep(
    graph: "doll.ron",
    over: Files("scans/*.obj", set: "scan.path", name: "scan"),
    set: { "up": 2.0 },
    out: "{scan}",
)
"#;

const BALL: &str = "v 0 0 0\nv 9 0 0\nv 0 9 0\nv 0 0 9\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";

/// Makes a project with three scans, one of them with a name that a shell would split or expand.
fn project_with_scans() -> Project {
    let project = Project::new(GRAPH);
    fs::create_dir(project.folder().join("scans")).unwrap();
    for name in ["maquette.toml", "ball.obj"] {
        project.write(name, if name == "ball.obj" { BALL } else { "" });
    }
    project.write("s.sweep.ron", SWEEP);
    ["b", "c it's $HOME; {{d}}", "e"].iter().for_each(|name| scan(&project, name));
    project
}

fn scan(project: &Project, name: &str) {
    project.write(&format!("scans/{name}.obj"), BALL);
}

/// Emits a batch as a job for a job engine, and returns the job.
fn emit_job(project: &Project, engine: &str) -> String {
    let output = project.maquette(&["batch", "s.sweep.ron", "--emit", engine]);
    assert!(output.status.success(), "{}", stderr_of(&output));
    let text = stdout_of(&output);
    assert!(!text.contains("HOME"), "a scan's name is in the job: {text}");
    text
}

/// Runs a program in the project's folder with the project's cache.
fn run(project: &Project, program: &str, words: &[&str]) -> Output {
    let own = project.command(&[]);
    let set = own.get_envs().filter_map(|(name, value)| Some((name, value?)));
    Command::new(program).args(words).current_dir(project.folder()).envs(set).output().unwrap()
}

fn shell(project: &Project, command: &str) -> Output {
    run(project, "bash", &["-c", command])
}

/// Returns the names of the tasks for which a record file exists.
fn records(project: &Project) -> BTreeSet<String> {
    let files = fs::read_dir(project.folder().join("out/s.sweep/tasks")).unwrap();
    let names = files.map(|file| file.unwrap().file_name().to_string_lossy().into_owned());
    names.filter_map(|name| Some(name.strip_suffix(".json")?.to_owned())).collect()
}

/// Returns the commands of an Open Job Description template: those of the first step, of each task, and of the last step.
fn commands_of_openjd(project: &Project, job: &str) -> [Vec<Vec<String>>; 3] {
    let job: Json = serde_json::from_str(job).unwrap();
    let folder = project.folder().display().to_string();
    let steps = job["steps"].as_array().unwrap();
    fn command(step: &Json, task: usize, folder: &str) -> Vec<String> {
        let run = &step["script"]["actions"]["onRun"];
        let args = run["args"].as_array().unwrap().iter().map(|word| {
            let word = word.as_str().unwrap().replace("{{Param.Project}}", folder);
            word.replace("{{Task.Param.Task}}", &task.to_string())
        });
        [run["command"].as_str().unwrap().to_owned()].into_iter().chain(args).collect::<Vec<_>>()
    }
    let range = &steps[1]["parameterSpace"]["taskParameterDefinitions"][0]["range"];
    let (_, last) = range.as_str().unwrap().split_once('-').unwrap();
    let tasks = 0..=last.parse::<usize>().unwrap();
    [
        vec![command(&steps[0], 0, &folder)],
        tasks.map(|task| command(&steps[1], task, &folder)).collect(),
        vec![command(&steps[2], 0, &folder)],
    ]
}

/// Returns the commands of a Slurm script: those of the first step, of each task, and of the last step. A replacement for `sbatch` records
/// the submitted scripts.
fn commands_of_slurm(project: &Project, script: &str) -> [Vec<Vec<String>>; 3] {
    project.write("submit.sh", script);
    fs::create_dir_all(project.folder().join("slurm")).unwrap();
    let sbatch = "#!/usr/bin/env bash\nid=$(ls slurm | grep -c job)\ncat > slurm/job$id\necho \"$@\" > slurm/words$id\necho $id\n";
    project.write("slurm/sbatch", sbatch);
    let submitted = shell(project, "chmod +x slurm/sbatch && PATH=$PWD/slurm:$PATH bash submit.sh");
    assert_eq!(stdout_of(&submitted), "0 1 2\n", "{}", stderr_of(&submitted));
    fn read(name: &str, project: &Project) -> String {
        fs::read_to_string(project.folder().join("slurm").join(name)).unwrap()
    }
    [0, 1, 2].map(|id| {
        assert!(!read(&format!("job{id}"), project).contains("HOME"));
        let words = read(&format!("words{id}"), project);
        let (_, array) = words.split_once("--array=").unwrap();
        let array = array.split_whitespace().next().unwrap();
        let last = array.rsplit('-').next().unwrap().parse::<usize>().unwrap();
        fn element(element: usize, id: i32) -> String {
            format!("SLURM_ARRAY_TASK_ID={element} bash slurm/job{id}")
        }
        (0..=last)
            .map(|task| ["bash", "-c", &element(task, id)].map(str::to_owned).to_vec())
            .collect()
    })
}

fn succeeds(project: &Project, commands: &[Vec<String>]) {
    for command in commands {
        let words = Vec::from_iter(command[1..].iter().map(String::as_str));
        let output = run(project, &command[0], &words);
        assert!(output.status.success(), "{command:?}: {}", stderr_of(&output));
    }
}

/// Runs commands of an outdated job: a scan was added after the job was emitted. Checks that each command fails and reports the added scan.
fn refuse(project: &Project, commands: &[Vec<String>]) {
    for command in commands {
        let words = Vec::from_iter(command[1..].iter().map(String::as_str));
        let output = run(project, &command[0], &words);
        assert!(!output.status.success(), "{command:?}");
        let told = stderr_of(&output);
        assert!(told.contains("1 added (`a`)") && told.contains("hand them over again"), "{told}");
    }
}

#[test]
fn a_scan_that_arrives_between_handover_and_run_is_told_and_no_job_runs_another_task() {
    for engine in ["lines", "openjd", "slurm"] {
        let project = project_with_scans();
        fn commands(project: &Project, engine: &str) -> [Vec<Vec<String>>; 3] {
            let job = emit_job(project, engine);
            match engine {
                "lines" => {
                    let lines =
                        job.lines().map(|line| ["bash", "-c", line].map(str::to_owned).to_vec());
                    [Vec::new(), lines.collect(), Vec::new()]
                }
                "openjd" => commands_of_openjd(project, &job),
                _ => commands_of_slurm(project, &job),
            }
        }
        let [warm, tasks, sheet] = commands(&project, engine);
        assert_eq!(tasks.len(), 3, "{engine}");
        succeeds(&project, &warm);
        succeeds(&project, &tasks[..1]);
        let before = records(&project);
        assert_eq!(before, BTreeSet::from(["b".to_owned()]), "{engine}");
        scan(&project, "a");
        refuse(&project, &tasks);
        refuse(&project, &warm);
        refuse(&project, &sheet);
        assert_eq!(records(&project), before, "{engine}: what was refused is no result");
        // A command that a user types also reports the added scan.
        let report = project.maquette(&["batch", "s.sweep.ron", "--report"]);
        assert_eq!(report.status.code(), Some(1));
        assert!(
            stderr_of(&report).contains("1 of 4 tasks never handed over: `a`"),
            "{}",
            stderr_of(&report)
        );
        // A job that is emitted again, after the scan was added, runs all tasks.
        if engine == "slurm" {
            fs::remove_dir_all(project.folder().join("slurm")).unwrap();
        }
        let [warm, tasks, sheet] = commands(&project, engine);
        assert_eq!(tasks.len(), 4, "{engine}");
        [warm, tasks, sheet].iter().for_each(|commands| succeeds(&project, commands));
        assert_eq!(records(&project).len(), 4, "{engine}");
        let report = project.maquette(&["batch", "s.sweep.ron", "--report"]);
        assert_eq!(
            (report.status.code(), stderr_of(&report)),
            (Some(0), String::new()),
            "{engine}"
        );
    }
}

/// A replacement for HyperQueue in a few lines: it runs submitted programs at once, and adds a scan after the first task.
const HYPERQUEUE: &str = r#"
import os, shutil, subprocess

class Job:
    def __init__(self, **_):
        self.calls, self.failed = [], {}
    def program(self, words, **_):
        assert "HOME" not in " ".join(words), words
        self.calls.append(words)

class Client:
    def __init__(self, *_):
        pass
    def submit(self, job):
        for number, words in enumerate(job.calls):
            if subprocess.run(words).returncode:
                job.failed[number] = words
            if "--task" in words and os.environ.get("ARRIVES"):
                shutil.copy("ball.obj", "scans/a.obj")
        return job
    def wait_for_jobs(self, jobs, **_):
        return not any(job.failed for job in jobs)
    def get_failed_tasks(self, job):
        return job.failed

LocalCluster = None
"#;

#[expect(clippy::print_stdout, reason = "says what is not there to be tested")]
#[test]
fn hyperqueue_tells_of_a_scan_that_arrives() {
    if let Err(why) = Command::new("python3").arg("--version").output() {
        return println!("skipped: there is no python3 here ({why})");
    }
    let project = project_with_scans();
    project.write("hyperqueue.py", HYPERQUEUE);
    project.write("job.py", emit_job(&project, "hq"));
    let output = shell(&project, "ARRIVES=1 python3 job.py server");
    assert_eq!(output.status.code(), Some(1), "{}", stderr_of(&output));
    let told = stdout_of(&output);
    assert!(told.ends_with("1 done, 2 failed\n"), "{told}");
    assert!(stderr_of(&output).contains("1 added (`a`)"), "{}", stderr_of(&output));
    assert_eq!(records(&project), BTreeSet::from(["b".to_owned()]));
    // The server has added a scan, so all tasks of the old job are refused. A new job runs all tasks.
    let output = shell(&project, "python3 job.py server");
    assert!(stdout_of(&output).ends_with("0 done, 3 failed\n"));
    project.write("job.py", emit_job(&project, "hq"));
    let output = shell(&project, "python3 job.py server");
    assert_eq!(output.status.code(), Some(0), "{}", stderr_of(&output));
    assert_eq!(records(&project).len(), 4);
}

/// Runs a job that must be refused without writing anything, and returns its messages.
fn run_refused_job(project: &Project, job: &str) -> String {
    let output = shell(project, job);
    assert_eq!(output.status.code(), Some(2), "{}", stderr_of(&output));
    let tasks = project.folder().join("out/s.sweep/tasks");
    assert!(records(project).is_empty() && !tasks.join("b.jpg").exists());
    stderr_of(&output)
}

#[test]
fn a_job_says_what_has_changed_since_it_was_handed_over() {
    fn check(change: &dyn Fn(&Project, &Path), told: &str) {
        let project = project_with_scans();
        let jobs = emit_job(&project, "lines");
        change(&project, &project.folder().join("scans"));
        for job in jobs.lines() {
            let found = run_refused_job(&project, job);
            assert!(found.contains(told), "`{told}` in {found}");
        }
    }
    let sweep = |from: &'static str, to: &'static str| {
        move |project: &Project, _: &Path| project.write("s.sweep.ron", SWEEP.replace(from, to))
    };
    check(&|_, scans| fs::remove_file(scans.join("b.obj")).unwrap(), "1 removed (`b`)");
    check(
        &|_, scans| fs::rename(scans.join("b.obj"), scans.join("f.obj")).unwrap(),
        "1 added (`f`), 1 removed (`b`)",
    );
    check(&sweep("{scan}", "of-{scan}"), "3 renamed (`b` is `of-b`");
    check(&sweep("2.0", "3.0"), "3 changed (`b`: up was 2.0, is 3.0");
    check(&sweep("    set: { \"up\": 2.0 },\n", ""), "`b`: up was 2.0, is not set");
    check(
        &|project, _| {
            project.write("other.ron", GRAPH);
            project.write("s.sweep.ron", SWEEP.replace("doll.ron", "other.ron"));
        },
        "the graph is `other.ron` instead of `doll.ron`",
    );
}

#[test]
fn what_changes_no_task_stops_no_job() {
    let project = project_with_scans();
    let jobs = emit_job(&project, "lines");
    // Three changes that affect no task: the text of the sweep, the size of the page's pictures, and a deleted task list.
    project.write(
        "s.sweep.ron",
        format!("// A note.\n{}", SWEEP.replace("out:", "picture: (size: (64, 48)),\n out:")),
    );
    fs::remove_dir_all(project.folder().join("out")).unwrap();
    for job in jobs.lines() {
        let output = shell(&project, job);
        assert!(output.status.success(), "{}", stderr_of(&output));
    }
    assert_eq!(records(&project).len(), 3);
}

#[test]
fn a_list_that_is_missing_or_damaged_is_told_if_it_is_needed() {
    let project = project_with_scans();
    let jobs = emit_job(&project, "lines");
    let folder = project.folder().join("out/s.sweep/tasks/@handovers");
    let list = fs::read_dir(&folder).unwrap().next().unwrap().unwrap().path();
    let text = fs::read_to_string(&list).unwrap();
    scan(&project, "a");
    for damaged in [text.replace("2.0", "2.5"), text[..text.len() / 2].to_owned()] {
        fs::write(&list, damaged).unwrap();
        let told = run_refused_job(&project, jobs.lines().next().unwrap());
        assert!(
            told.contains("is missing or damaged") && told.contains("hand them over again"),
            "{told}"
        );
    }
    fs::remove_dir_all(&folder).unwrap();
    assert!(
        run_refused_job(&project, jobs.lines().next().unwrap()).contains("is missing or damaged")
    );
    for hash in ["", "../../../etc/passwd", "0123456789ABCDEF", "0123456789abcde"] {
        let output = project.maquette(&["batch", "s.sweep.ron", "--handover", hash, "--task", "0"]);
        assert_eq!(output.status.code(), Some(2), "{hash}");
    }
}
