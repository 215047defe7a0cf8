//! What users expect of a batch on a farm: a log of each task, limits, resources, and a page at the end, with every engine.

use std::os::unix::fs::symlink;
use std::path::PathBuf;

use super::*;

/// Makes a project with three scans, the second of which is invalid.
fn with_a_broken_scan() -> Project {
    let project = project_with_scans();
    project.write("scans/c it's $HOME; {{d}}.obj", "no mesh\n");
    project
}

/// Emits the batch with these options and returns the job.
fn emitted_with(project: &Project, engine: &str, options: &[&str]) -> String {
    let words = [&["batch", "s.sweep.ron", "--emit", engine], options].concat();
    let output = project.maquette(&words);
    assert!(output.status.success(), "{}", stderr_of(&output));
    stdout_of(&output)
}

fn is_installed(program: &str) -> bool {
    Command::new(program).arg("--version").output().is_ok()
}

/// Checks that each task has a log that ends with its status, and that the page exists.
fn check_logs(project: &Project, engine: &str) {
    let lists = project.folder().join("out/s.sweep/tasks/@handovers");
    let lists = fs::read_dir(lists).unwrap().map(|entry| entry.unwrap().path());
    let logs = lists.filter(|path| path.is_dir()).collect::<Vec<_>>();
    let [logs] = &logs[..] else { panic!("{engine}: {logs:?}") };
    fn log(name: &str, logs: &PathBuf, engine: &str) -> String {
        let files = fs::read_dir(logs).unwrap().map(|file| file.unwrap().path());
        let path: Vec<_> = files
            .filter(|path| {
                let file = path.file_name().unwrap().to_string_lossy();
                file.starts_with(name) && file.ends_with(".log")
            })
            .collect();
        let [path] = &path[..] else { panic!("{engine}: no log of {name}") };
        fs::read_to_string(path).unwrap()
    }
    for name in ["b", "e"] {
        let text = log(name, logs, engine);
        assert!(text.starts_with(&format!("task {name}, process ")), "{engine}: {text}");
        assert!(text.contains("a.ply"), "{engine}: {text}");
        // The scans `b` and `e` are equal: `b` is computed, and `e` uses the results of `b`.
        assert!(name == "e" || text.contains("s  computed moved ("), "{engine}: {text}");
        let last = text.lines().last().unwrap();
        let is_done = last.starts_with("done in ") || last.starts_with("not run: done");
        assert!(is_done, "{engine}: {text}");
    }
    // The log of `c it's ..` is found by the beginning of its name, because the rest has characters that some file systems reject.
    let text = log("c", logs, engine);
    assert!(text.contains("error: ") && text.contains("doll.ron:5:"), "{engine}: {text}");
    assert!(text.lines().last().unwrap().starts_with("failed after "), "{engine}: {text}");
    assert!(project.folder().join("out/s.sweep/index.html").is_file(), "{engine}: no page");
    assert_eq!(records(project).len(), 3, "{engine}");
}

#[test]
fn every_engine_leaves_a_log_of_each_task_and_the_page_behind_a_failure() {
    for engine in ["lines", "openjd", "slurm"] {
        let project = with_a_broken_scan();
        let job = emit_job(&project, engine);
        let tasks = match engine {
            "lines" => {
                job.lines().map(|line| vec!["bash".into(), "-c".into(), line.into()]).collect()
            }
            "openjd" => commands_of_openjd(&project, &job)[1].clone(),
            _ => commands_of_slurm(&project, &job)[1].clone(),
        };
        let codes = tasks.iter().map(|command: &Vec<String>| {
            let words = Vec::from_iter(command[1..].iter().map(String::as_str));
            run(&project, &command[0], &words).status.code()
        });
        assert_eq!(Vec::from_iter(codes), [Some(0), Some(1), Some(0)], "{engine}");
        check_logs(&project, engine);
    }
}

#[test]
fn lines_are_a_script_that_goes_on_behind_a_failure_and_fails() {
    for shell in ["bash", "bash -e", "sh"] {
        let project = with_a_broken_scan();
        project.write("jobs", emit_job(&project, "lines"));
        let output = super::shell(&project, &format!("{shell} jobs"));
        assert_eq!(output.status.code(), Some(1), "{shell}: {}", stderr_of(&output));
        check_logs(&project, shell);
        // The invalid scan has been replaced by a valid one, so no task fails.
        scan(&project, "c it's $HOME; {{d}}");
        assert_eq!(super::shell(&project, &format!("{shell} jobs")).status.code(), Some(0));
    }
}

#[test]
#[expect(clippy::print_stdout, reason = "says what is not there to be tested")]
fn make_goes_on_behind_a_failure_and_makes_the_page() {
    if !is_installed("make") {
        return println!("skipped: there is no make here");
    }
    let project = with_a_broken_scan();
    project.write("jobs.mk", emitted_with(&project, "make", &["--jobs", "2"]));
    let output = shell(&project, "make -f jobs.mk");
    assert_eq!(output.status.code(), Some(2), "{}", stderr_of(&output));
    check_logs(&project, "make");
    assert!(
        stderr_of(&output).contains("3 tasks: 2 done, 1 failed, 0 missing"),
        "{}",
        stderr_of(&output)
    );
    assert!(
        stderr_of(&output).contains("@handovers/"),
        "the logs are named: {}",
        stderr_of(&output)
    );
    scan(&project, "c it's $HOME; {{d}}");
    let output = shell(&project, "make -f jobs.mk");
    assert_eq!(output.status.code(), Some(0), "{}", stderr_of(&output));
    scan(&project, "a");
    let output = shell(&project, "make -f jobs.mk");
    assert!(
        !output.status.success() && stderr_of(&output).contains("1 added (`a`)"),
        "{}",
        stderr_of(&output)
    );
    assert_eq!(records(&project).len(), 3);
}

#[test]
#[expect(clippy::print_stdout, reason = "says what is not there to be tested")]
fn hyperqueue_keeps_what_jobs_print_and_is_asked_for_resources() {
    if !is_installed("python3") {
        return println!("skipped: there is no python3 here");
    }
    const RUN: &str = "if subprocess.run(words).returncode:";
    const LOGGED: &str = "if subprocess.run(words[0], stdout=open(words[1], 'w'), stderr=open(words[2], 'w')).returncode:";
    let fake = HYPERQUEUE.replace(RUN, LOGGED);
    let fake = fake.replace("def program(self, words, **_):", "def program(self, words, stdout, stderr, resources):\n        ASKED.append(repr(resources))");
    let fake =
        fake.replace("self.calls.append(words)", "self.calls.append((words, stdout, stderr))");
    let fake = fake.replace("\"--task\" in words", "\"--task\" in words[0]") + "\nASKED = []\n";
    let request = "\nclass ResourceRequest:\n    def __init__(self, **asked):\n        self.asked = asked\n    def __repr__(self):\n        return repr(self.asked)\n";
    let project = with_a_broken_scan();
    fs::create_dir_all(project.folder().join("hyperqueue/ffi")).unwrap();
    project.write("hyperqueue/__init__.py", &fake);
    project.write("hyperqueue/ffi/__init__.py", "");
    project.write("hyperqueue/ffi/protocol.py", request);
    let options = ["--threads", "2", "--max-memory", "1GB", "--jobs", "2", "--time-limit", "1h"];
    let job = emitted_with(&project, "hq", &options);
    assert!(job.contains("\"--time-limit\",\"1h\""), "{job}");
    project.write(
        "job.py",
        job.replace("sys.exit(run(Client", "code = run(Client").replace(
            "argv[1:])))\n",
            "argv[1:]))\nimport hyperqueue\nprint(hyperqueue.ASKED)\nsys.exit(code)\n",
        ),
    );
    let output = shell(&project, "python3 job.py server");
    assert_eq!(output.status.code(), Some(1), "{}", stderr_of(&output));
    let told = stdout_of(&output);
    assert!(told.contains("'cpus': 2") && told.contains("'mem': 1193"), "{told}");
    check_logs(&project, "hq");
    let logs = shell(&project, "cat out/s.sweep/tasks/@handovers/*/@1.err.log");
    assert!(stdout_of(&logs).contains("doll.ron:5:"), "{logs:?}");
}

#[test]
fn slurm_is_asked_for_resources_logs_and_limits() {
    let project = project_with_scans();
    let options = ["--threads", "4", "--max-memory", "8GB", "--jobs", "2", "--time-limit", "90min"];
    let script = emitted_with(&project, "slurm", &[&options[..], &["--chunk", "2"]].concat());
    project.write("submit.sh", &script);
    fs::create_dir_all(project.folder().join("slurm")).unwrap();
    project.write(
        "slurm/sbatch",
        "#!/usr/bin/env bash\ncat > /dev/null\nprintf '%s\\n' \"$@\" >> words\necho 1\n",
    );
    let run =
        shell(&project, "chmod +x slurm/sbatch && PATH=$PWD/slurm:$PATH bash submit.sh --time=5");
    assert!(run.status.success(), "{}", stderr_of(&run));
    let words = project.read("words");
    for wanted in ["--array=0-1%2", "--cpus-per-task=4", "--mem=9537M", "--time=181", "--time=5"] {
        assert!(words.lines().any(|line| line == wanted), "{wanted} in {words}");
    }
    let logs = words.lines().filter_map(|line| line.strip_prefix("--output="));
    for (log, name) in logs.zip(["/@warm.log", "/@%a.log", "/@sheet.log"]) {
        assert!(log.ends_with(name), "{log}");
        assert!(project.folder().join(log).parent().unwrap().is_dir(), "{log}");
    }
}

#[test]
fn chunks_run_all_tasks_and_go_on_behind_a_failure() {
    let project = with_a_broken_scan();
    let lines = emitted_with(&project, "lines", &["--chunk", "2"]);
    let codes = lines.lines().map(|line| shell(&project, line).status.code());
    assert_eq!(Vec::from_iter(codes), [Some(1), Some(0)]);
    check_logs(&project, "chunks");
    let refused = project.maquette(&["batch", "s.sweep.ron", "--chunk", "2", "--task", "2"]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(
        stderr_of(&refused).contains("expected a chunk from 0 to 1, found 2"),
        "{}",
        stderr_of(&refused)
    );
    let job = emitted_with(&project, "openjd", &["--chunk", "2", "--time-limit", "1min"]);
    let [_, tasks, _] = commands_of_openjd(&project, &job);
    assert_eq!(tasks.len(), 2);
    let words = Vec::from_iter(tasks[0][1..].iter().map(String::as_str));
    let output = run(&project, "bash", &words);
    let told = stdout_of(&output);
    let last = told.lines().rev().find_map(|line| line.strip_prefix("openjd_progress: "));
    assert_eq!(last, Some("100"), "{told}");
}

/// Tests file names that a shell, a template or an option parser would misread.
#[test]
fn files_have_any_names() {
    for name in
        ["-x it's \"so\"", "{{Param.Project}}\ttab", "gr\u{f6}\u{df}er $PWD `id` @NAME@ a\\x41%d"]
    {
        for engine in ["lines", "openjd", "slurm", "make"] {
            let project = project_with_scans();
            let file = format!("{name}.sweep.ron");
            let out = format!("{name} out");
            fs::rename(project.folder().join("s.sweep.ron"), project.folder().join(&file)).unwrap();
            let out_word = format!("--out={out}");
            let emit = ["--emit", engine, &out_word];
            let output = project.maquette(&[&["batch"], &emit[..], &["--", &file]].concat());
            assert!(output.status.success(), "{name}, {engine}: {}", stderr_of(&output));
            let job = stdout_of(&output);
            match engine {
                "lines" => project.write("jobs", &job),
                "make" if !is_installed("make") => continue,
                "make" => project.write("jobs.mk", &job),
                "openjd" => {
                    let commands = commands_of_openjd(&project, &job);
                    commands.iter().for_each(|commands| succeeds(&project, commands));
                }
                _ => {
                    let commands = commands_of_slurm(&project, &job);
                    commands.iter().for_each(|commands| succeeds(&project, commands));
                }
            }
            let run = match engine {
                "lines" => shell(&project, "bash jobs"),
                "make" => shell(&project, "make -f jobs.mk"),
                _ => shell(&project, "true"),
            };
            assert!(run.status.success(), "{name}, {engine}: {}", stderr_of(&run));
            let page = project.folder().join(&out).join("index.html");
            assert!(page.is_file(), "{name}, {engine}: no {}", page.display());
        }
    }
}

#[test]
fn paths_in_the_project_are_written_from_there() {
    let project = project_with_scans();
    let folder = project.folder().display().to_string();
    let link = project
        .folder()
        .parent()
        .unwrap()
        .join(format!("{}-link", project.folder().file_name().unwrap().display()));
    symlink(project.folder(), &link).unwrap();
    let linked = link.display().to_string();
    for from in [&folder, &linked] {
        let sweep = format!("{from}/scans/../s.sweep.ron");
        let (out, cache) = (format!("{from}/out/x"), format!("{from}/results"));
        let words =
            ["batch", &sweep, "--emit", "openjd", "--out", &out, "--cache", &cache, "--root", from];
        let output = project.maquette(&words);
        let job = stdout_of(&output);
        assert!(output.status.success(), "{}", stderr_of(&output));
        let args = commands_of_openjd(&project, &job)[1][0].clone();
        let words = args[4..].join(" ");
        assert!(
            words.contains(" batch s.sweep.ron --out out/x ") && words.contains(" --cache results"),
            "{words}"
        );
        let graph = format!("{from}/doll.ron");
        let scans = format!("{from}/scans/*.obj");
        let output = project.maquette(&["batch", &graph, "--scans", &scans, "--emit", "lines"]);
        let job = stdout_of(&output);
        assert!(
            job.contains(" batch doll.ron --scans 'scans/*.obj' "),
            "{job}{}",
            stderr_of(&output)
        );
    }
    fs::remove_file(link).unwrap();
}
