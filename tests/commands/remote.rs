//! Machines share results through a cache server. Whatever the server does, the outputs are the same.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::{Mutex, MutexGuard, OnceLock};
use std::time::{Duration, Instant};

use serde_json::Value as Json;
use server::{Mode, Server};

use crate::output::{stderr_of, text_of};
use crate::project::GRAPHS;

mod server;
mod trouble;

/// The expected outputs of the example graph `doll.ron`, and the time that a run takes without a server.
struct Truth {
    outputs: BTreeMap<String, Vec<u8>>,
    seconds: Duration,
}

impl Truth {
    fn new(growth: &str) -> Self {
        let (start, machine) = (Instant::now(), Machine::new());
        let run = machine.run(growth, &["--cache", "."]);
        Self { outputs: run.outputs, seconds: start.elapsed() }
    }
}

/// A simulated machine: it has its own cache folder.
struct Machine(tempfile::TempDir);

/// The result of a run.
struct Run {
    json: Json,
    /// The text that the program printed to standard error during the run.
    words: String,
    outputs: BTreeMap<String, Vec<u8>>,
    seconds: Duration,
}

impl Machine {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("cache")).unwrap();
        Self(folder)
    }

    fn cache(&self) -> PathBuf {
        self.0.path().join("cache")
    }

    fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_maquette"));
        command.args(arguments).current_dir(GRAPHS).env("NO_COLOR", "1");
        command.env("MAQUETTE_CACHE", self.cache()).env_remove("MAQUETTE_CACHE_REMOTE");
        command.env("http_proxy", "http://127.0.0.1:9");
        command
    }

    /// Runs the example graph `doll.ron`.
    fn run(&self, growth: &str, more: &[&str]) -> Run {
        let (out, set) = (self.0.path().join("out"), format!("growth={growth}"));
        let arguments = [
            "run",
            "doll.ron",
            "--json",
            "--threads",
            "2",
            "--set",
            &set,
            "--out",
            out.to_str().unwrap(),
        ];
        let cache = self.cache();
        // The argument `.` is replaced by the path of the machine's cache folder.
        let more =
            more.iter().map(|word| if *word == "." { cache.to_str().unwrap() } else { word });
        let start = Instant::now();
        let output = self.command(&arguments).args(more).output().unwrap();
        let seconds = start.elapsed();
        let words = stderr_of(&output);
        assert!(output.status.success(), "{words}");
        let json = serde_json::from_slice(&output.stdout).unwrap();
        Run { json, words, outputs: files(&out), seconds }
    }

    /// Runs the example graph `doll.ron` with a cache server.
    fn share(&self, server: &Server) -> Run {
        self.run("12", &["--cache-remote", &server.address()])
    }

    /// Lists the cache files that machines may share.
    fn shared_files(&self) -> Vec<PathBuf> {
        let (mut files, mut folders) = (Vec::new(), vec![self.cache()]);
        while let Some(folder) = folders.pop() {
            for entry in std::fs::read_dir(&folder).unwrap() {
                let path = entry.unwrap().path();
                match path.is_dir() {
                    true => folders.push(path),
                    false if folder.ends_with("entries") || folder.ends_with("columns") => {
                        files.push(path);
                    }
                    false => {}
                }
            }
        }
        files
    }

    /// Returns the name under which the server stores a cache file: `BUILD/NAME`.
    fn name(&self, path: &Path) -> String {
        let path = path.strip_prefix(self.cache()).unwrap();
        let parts: Vec<_> = path.iter().map(|part| part.to_str().unwrap()).collect();
        [parts[0], parts[2]].join("/")
    }
}

impl Run {
    fn count(&self, state: &str) -> usize {
        let nodes = self.json["nodes"].as_array().unwrap();
        nodes.iter().filter(|node| node["state"] == state).count()
    }

    fn warnings(&self) -> usize {
        self.words.lines().filter(|line| line.starts_with("warning")).count()
    }
}

fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let paths = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    paths
        .map(|path: PathBuf| {
            (path.file_name().unwrap().to_string_lossy().into_owned(), std::fs::read(path).unwrap())
        })
        .collect()
}

/// Starts a cache server that has the results of the example graph `doll.ron`.
fn filled_server() -> Server {
    static FILES: OnceLock<BTreeMap<String, Vec<u8>>> = OnceLock::new();
    let files = FILES.get_or_init(|| {
        let machine = Machine::new();
        machine.run("12", &[]);
        machine
            .shared_files()
            .into_iter()
            .map(|path: PathBuf| (machine.name(&path), std::fs::read(path).unwrap()))
            .collect()
    });
    let server = Server::new();
    server.fill(files);
    server
}

/// Only one of these tests runs at a time: on a busy machine even a good server may seem slow.
fn lock_machine() -> MutexGuard<'static, ()> {
    static ALONE: Mutex<()> = Mutex::new(());
    ALONE.lock().unwrap_or_else(|broken| broken.into_inner())
}

#[test]
fn a_second_machine_computes_nothing() {
    let _alone = lock_machine();
    let (truth, server, first) = (Truth::new("12"), Server::new(), Machine::new());
    let run = first.share(&server);
    assert_eq!((run.count("computed"), &run.words[..]), (15, ""));
    // The server has no results. So the machine requests only the results of nodes without inputs, and does not ask for those of all other
    // nodes.
    let asked = server.count_requests("GET");
    assert!(0 < asked && asked <= 5, "{asked}");
    // Only results and their columns are uploaded, not cache files that refer to local paths.
    let mut names: Vec<_> = first.shared_files().iter().map(|path| first.name(path)).collect();
    names.sort();
    assert_eq!(server.names(), names);

    let second = Machine::new();
    let run = second.share(&server);
    assert_eq!((run.count("computed"), run.count("cached"), &run.words[..]), (0, 15, ""));
    assert_eq!((&run.outputs, &run.json["server"]["missing"]), (&truth.outputs, &Json::from(0)));
    // The second machine now has all results, so it no longer needs the server.
    server.set(Mode::Fails);
    assert_eq!(second.run("12", &[]).count("cached"), 15);
}

#[test]
fn what_hangs_on_an_edit_is_computed_once_by_all_machines() {
    let _alone = lock_machine();
    let (truth, server) = (Truth::new("20"), filled_server());
    let address = server.address();
    fn run_edited(machine: Machine, address: &str) -> Run {
        machine.run("20", &["--cache-remote", address])
    }
    let first = run_edited(Machine::new(), &address);
    assert_eq!((first.count("computed"), &first.outputs), (8, &truth.outputs));
    let second = run_edited(Machine::new(), &address);
    assert_eq!((second.count("computed"), &second.outputs), (0, &truth.outputs));
}

#[test]
fn a_flipped_byte_is_computed_again_and_mended() {
    let _alone = lock_machine();
    let (truth, server) = (Truth::new("12"), filled_server());
    server.flip_all();
    let run = Machine::new().share(&server);
    assert_eq!((run.count("computed"), run.warnings()), (15, 1), "{}", run.words);
    assert!(run.words.contains("a file differs from what was uploaded"), "{}", run.words);
    assert_eq!(run.outputs, truth.outputs);
    let run = Machine::new().share(&server);
    assert_eq!((run.count("computed"), run.words, run.outputs), (0, String::new(), truth.outputs));
}

#[test]
fn whatever_a_server_does_the_outputs_are_the_same_and_it_costs_a_warning_and_a_second() {
    let _alone = lock_machine();
    let truth = Truth::new("12");
    for mode in Mode::ALL {
        let server = filled_server();
        server.set(mode);
        let run = Machine::new().share(&server);
        assert!(run.outputs == truth.outputs, "{mode:?}");
        assert!(run.warnings() <= 1 && run.words.lines().count() <= 1, "{mode:?}: {}", run.words);
        // A useless server may delay a run by one second for downloads and one for uploads. The bound is larger, because other tests run at
        // the same time.
        let most = truth.seconds * 3 + Duration::from_secs(3);
        assert!(run.seconds < most, "{mode:?}: {:?} of {:?}", run.seconds, truth.seconds);
        if mode.is_failure() {
            assert_eq!(run.warnings(), 1, "{mode:?}");
            // Each of the two threads sends one request, and the upload sends one. After these failures the machine stops using the server.
            assert!(server.count_requests("") <= 3, "{mode:?}: {}", server.count_requests(""));
        }
    }
}

#[test]
fn a_server_that_may_only_be_read_is_read() {
    let _alone = lock_machine();
    let (truth, server) = (Truth::new("20"), filled_server());
    server.set(Mode::ReadOnly);
    let run = Machine::new().run("20", &["--cache-remote", &server.address()]);
    assert_eq!((run.count("computed"), run.count("cached")), (8, 7));
    assert_eq!((run.warnings(), server.count_requests("PUT"), run.outputs), (1, 1, truth.outputs));
    assert!(run.words.contains("it accepts no results: 403 Forbidden"), "{}", run.words);
}

#[test]
fn a_lost_server_is_one_warning() {
    let _alone = lock_machine();
    let truth = Truth::new("12");
    // The first address refuses connections, the second one does not answer, and the third one has no DNS entry.
    for address in ["http://127.0.0.1:9/x", "http://192.0.2.1/x", "http://nowhere.invalid/x"] {
        let run = Machine::new().run("12", &["--cache-remote", address]);
        assert_eq!((run.warnings(), &run.outputs), (1, &truth.outputs), "{}", run.words);
        assert!(
            run.words.contains(address) && run.words.contains("not used any more"),
            "{}",
            run.words
        );
        assert!(run.seconds < truth.seconds * 3 + Duration::from_secs(3), "{:?}", run.seconds);
    }
}

#[test]
fn no_sequence_of_faults_changes_an_output() {
    let _alone = lock_machine();
    let truths = ["12", "20"].map(|growth| (growth, Truth::new(growth)));
    let seeds = std::env::var("SERVER_SEQUENCES").ok().and_then(|seeds| seeds.parse().ok());
    for seed in 0..seeds.unwrap_or(6_u64) {
        let server = Server::new();
        server.set(Mode::Any(seed));
        for step in 0..4 {
            let (growth, truth) = &truths[(seed >> step & 1) as usize];
            let run = Machine::new().run(growth, &["--cache-remote", &server.address()]);
            assert!(run.outputs == truth.outputs, "seed {seed}, step {step}");
            assert!(run.warnings() <= 1, "seed {seed}, step {step}: {}", run.words);
        }
    }
}

#[test]
fn who_one_is_is_shown_to_the_server_and_to_nobody_else() {
    let _alone = lock_machine();
    let server = Server::new();
    let address = server.address().replace("//", "//me:secret@");
    let run = Machine::new().run("12", &["--cache-remote", &address]);
    assert_eq!((server.authorizations(), &run.words[..]), (vec!["Basic bWU6c2VjcmV0".into()], ""));

    let server = Server::new();
    server.set(Mode::ReadOnly);
    let machine = Machine::new();
    let mut command = machine.command(&["run", "doll.ron", "--out"]);
    command.arg(machine.0.path().join("out")).env("MAQUETTE_CACHE_REMOTE", server.address());
    let output = command.env("MAQUETTE_CACHE_REMOTE_TOKEN", "hidden").output().unwrap();
    assert_eq!(server.authorizations(), ["Bearer hidden"]);
    assert!(stderr_of(&output).contains("403") && !stderr_of(&output).contains("hidden"));

    for address in ["http://me:secret@127.0.0.1:9", "https://me:secret@host", "me:secret@host"] {
        let output = machine.command(&["cache", "ls", "--cache-remote", address]).output().unwrap();
        let told = text_of(&output);
        assert!(!told.contains("secret"), "{told}");
    }
}

#[test]
fn whether_the_server_answers_is_told() {
    let _alone = lock_machine();
    let (server, machine) = (Server::new(), Machine::new());
    fn ls(address: &str, machine: &Machine) -> Json {
        let arguments = ["cache", "ls", "--json", "--cache-remote", address];
        let output = machine.command(&arguments).output().unwrap();
        serde_json::from_slice::<Json>(&output.stdout).unwrap()["server"].clone()
    }
    assert_eq!(ls(&server.address(), &machine)["answers"], true);
    server.set(Mode::Fails);
    assert_eq!(ls(&server.address(), &machine)["why"], "500 Internal Server Error");
    let lost = ls("http://127.0.0.1:9/", &machine);
    assert_eq!((&lost["answers"], &lost["address"]), (&false.into(), &"http://127.0.0.1:9".into()));
}

#[test]
fn what_this_build_does_not_speak_is_said_with_the_feature_that_does() {
    let machine = Machine::new();
    for (address, spoken, told) in [
        (
            "https://h",
            maquette_remote::HTTPS,
            "https is not supported by this build: build with the feature `tls`",
        ),
        (
            "s3://b",
            maquette_remote::BUCKETS,
            "buckets are not supported by this build: build with the feature `s3`",
        ),
    ] {
        let output = machine.command(&["cache", "ls", "--cache-remote", address]).output().unwrap();
        let words = stderr_of(&output);
        let is_told = words.contains(&format!("--cache-remote: {told}"));
        assert_eq!(is_told, !spoken, "{words}");
        assert!(!is_told || output.status.code() == Some(2), "{words}");
    }
}
