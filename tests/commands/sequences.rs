//! After any sequence of edits and commands, each command prints and writes the same as it would without a cache.
//!
//! Graphs of the gallery are edited at random as texts, and read by a sequence of processes. Each answer is compared with that of
//! `--no-cache`. A watch that keeps running must bring the outputs to those of the current graph.
//!
//! `SEQUENCES` is the number of sequences, and `SEED` selects them. A failure prints the steps.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant, SystemTime};

use maquette::rng::Random;

use crate::output::{stderr_of, stdout_of};
use crate::project::GRAPHS;

/// Graphs that take little time and together use all ways to refer to other graphs.
const NAMES: [&str; 10] =
    ["doll", "face", "pinocchio", "vase", "hull", "feature", "crowd", "tagged", "turned", "relief"];

/// Maximum time of a watch for an update, even on a busy machine; only a failing test waits this long.
const PATIENCE: Duration = Duration::from_secs(120);

fn number(name: &str, usual: u64) -> u64 {
    std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(usual)
}

#[test]
fn processes_one_after_the_other_say_what_is_true() {
    let (count, seed) = (number("SEQUENCES", 10), number("SEED", 20_070_115));
    for sequence in 0..count {
        let mut project = Project::new(seed + sequence);
        for _ in 0..6 {
            project.edit();
            project.ask();
        }
    }
}

#[test]
fn a_living_watch_comes_to_what_is_true() {
    let (count, seed) = (number("SEQUENCES", 10), number("SEED", 20_070_115));
    for sequence in 0..count.div_ceil(5) {
        let mut project = Project::new(seed + 1_000_000 + sequence);
        let watch = project.watch();
        for _ in 0..6 {
            project.edit();
            if project.random.next_below(4) == 0 {
                project.ask();
            }
            project.wait_for_watch();
        }
        drop(watch);
    }
}

/// Random choice of an item of a list.
trait Pick {
    fn pick<'a, T: ?Sized>(&mut self, among: &[&'a T]) -> &'a T;
}

impl Pick for Random {
    fn pick<'a, T: ?Sized>(&mut self, among: &[&'a T]) -> &'a T {
        among[self.next_below(among.len())]
    }
}

/// A copy of the gallery. The test edits one of its graphs.
struct Project {
    random: Random,
    folder: PathBuf,
    cache: PathBuf,
    name: &'static str,
    /// The text of the graph before any edit.
    original: String,
    /// The steps so far, for the message of a failure.
    story: String,
    _temporary: tempfile::TempDir,
}

impl Project {
    fn new(seed: u64) -> Self {
        let mut random = Random(seed);
        let temporary = tempfile::tempdir().unwrap();
        let folder = std::fs::canonicalize(temporary.path()).unwrap().join("graphs");
        for part in ["", "lib", "doll", "pictures"] {
            copy_files(&Path::new(GRAPHS).join(part), &folder.join(part));
        }
        let name = random.pick(&NAMES);
        let original = std::fs::read_to_string(folder.join(format!("{name}.ron"))).unwrap();
        let cache = temporary.path().join("cache");
        let story = format!("seed {seed}, {name}.ron\n");
        let project = Self { random, folder, cache, name, original, story, _temporary: temporary };
        // The program trusts the modification time of a file only if the file is old enough.
        project.make_older(60);
        project
    }

    fn graph(&self) -> PathBuf {
        self.folder.join(format!("{}.ron", self.name))
    }

    fn text(&self) -> String {
        std::fs::read_to_string(self.graph()).unwrap()
    }

    fn make_older(&self, seconds: u64) {
        let time = SystemTime::now() - Duration::from_secs(seconds);
        for file in files(&self.folder.join("doll")).into_values() {
            let file = std::fs::File::options().append(true).open(file).unwrap();
            file.set_modified(time).unwrap();
        }
    }

    /// Changes the graph, a graph that it uses, or a file. A change that the check refuses is undone.
    fn edit(&mut self) {
        let (path, before) = match self.random.next_below(8) {
            0 => {
                let lib = self.folder.join("lib");
                let path = files(&lib).into_values().collect::<Vec<_>>();
                let path = path[self.random.next_below(path.len())].clone();
                (path.clone(), std::fs::read_to_string(path).unwrap())
            }
            _ => (self.graph(), self.text()),
        };
        let after = match self.random.next_below(9) {
            0 => self.rename_node(&before),
            1 => format!("{before}\n// {}\n", self.random.next_below(100)),
            2 => self.with_another_output(&before),
            3 => self.with_an_output_less(&before),
            4 if path == self.graph() => self.original.clone(),
            5 => {
                self.story += "files touched\n";
                self.make_older(30);
                before.clone()
            }
            6 => {
                self.story += "a file replaced by itself\n";
                let file = self.folder.join("doll/color.png");
                let new = self.folder.join("doll/new");
                std::fs::copy(&file, &new).unwrap();
                std::fs::rename(new, file).unwrap();
                before.clone()
            }
            _ => self.with_another_number(&before),
        };
        if after == before {
            return;
        }
        save(&path, &after);
        if self.run(&["check", &self.graph().to_string_lossy()]).status.success() {
            let _ = writeln!(self.story, "{} becomes\n{after}", path.display());
        } else {
            save(&path, &before);
        }
    }

    /// Returns the text with one number slightly increased or decreased.
    fn with_another_number(&mut self, text: &str) -> String {
        let body = text.find("nodes:").unwrap_or(0);
        let starts = Vec::from_iter(text.char_indices().filter_map(|(at, _)| {
            fn is_digit(at: usize, text: &str) -> bool {
                text.as_bytes()[at].is_ascii_digit()
            }
            let inside = at > 0 && matches!(text.as_bytes()[at - 1], b' ' | b'(' | b'-');
            (body < at && is_digit(at, text) && inside).then_some(at)
        }));
        if starts.is_empty() {
            return text.to_owned();
        }
        let start = starts[self.random.next_below(starts.len())];
        let rest = &text[start..];
        let length = rest.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(rest.len());
        let Ok(number) = rest[..length].parse::<f64>() else { return text.to_owned() };
        let new = if rest[..length].contains('.') {
            format!("{:?}", number * [0.9, 1.1, 2.0][self.random.next_below(3)])
        } else {
            format!("{}", number as u64 + 1 - (self.random.next_below(3) as u64).min(number as u64))
        };
        format!("{}{new}{}", &text[..start], &rest[length..])
    }

    /// Returns the names of the nodes: strings in `nodes` that are followed by `: ` and a capital letter.
    fn node_names(text: &str) -> Vec<String> {
        let body = &text[text.find("nodes:").unwrap_or(text.len())..];
        body.lines()
            .filter_map(|line| {
                let (name, rest) = line.trim().strip_prefix('"')?.split_once("\": ")?;
                rest.starts_with(char::is_uppercase).then(|| name.to_owned())
            })
            .collect()
    }

    fn rename_node(&mut self, text: &str) -> String {
        let names = Self::node_names(text);
        if names.is_empty() {
            return text.to_owned();
        }
        let name = &names[self.random.next_below(names.len())];
        let new = format!("{name}-{}", self.random.next_below(3));
        text.replace(&format!("\"{name}\""), &format!("\"{new}\""))
            .replace(&format!("\"{name}."), &format!("\"{new}."))
            .replace(&format!("\"{name}/"), &format!("\"{new}/"))
    }

    fn with_another_output(&mut self, text: &str) -> String {
        let names = Self::node_names(text);
        if names.is_empty() {
            return text.to_owned();
        }
        let name = &names[self.random.next_below(names.len())];
        let ending = self.random.pick(&["json", "png", "ply", "pcd"]);
        let file =
            format!("outputs: {{ \"more-{}.{ending}\": \"{name}\", ", self.random.next_below(9));
        text.replacen("outputs: {", &file, 1)
    }

    fn with_an_output_less(&self, text: &str) -> String {
        let Some(start) = text.find("outputs: {").map(|at| at + "outputs: {".len()) else {
            return text.to_owned();
        };
        match text[start..].find(',') {
            Some(comma) => format!("{}{}", &text[..start], &text[start + comma + 1..]),
            None => text.to_owned(),
        }
    }

    fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_maquette"));
        command.args(arguments).current_dir(self.folder.parent().unwrap()).stdin(Stdio::null());
        command.env("MAQUETTE_CACHE", &self.cache);
        command
    }

    fn run(&self, arguments: &[&str]) -> Output {
        self.command(arguments).output().unwrap()
    }

    /// Runs a random command, and then the graph with and without the cache; the results must be equal.
    fn ask(&mut self) {
        let graph = self.graph().to_string_lossy().into_owned();
        let names = Self::node_names(&self.text());
        let node = names.get(self.random.next_below(names.len().max(1))).cloned();
        let value = format!("{}", 1 + self.random.next_below(9));
        let set = match self.random.next_below(4) {
            0 => vec!["--set".to_owned(), format!("growth={value}")],
            _ => Vec::new(),
        };
        match (self.random.next_below(8), node) {
            (0, Some(node)) => self.compare("inspect", &[&graph, &node, "--json"], &set),
            (1, Some(node)) => {
                self.compare("inspect", &[&graph, &node, "--out", "TO/a.png"], &set);
            }
            (2, Some(node)) => drop(self.run_command("why", &[&graph, &node])),
            (3, _) => drop(self.run_command("run", &[&graph, "-n"])),
            (4, _) => {
                let only = self.outputs_in_text();
                let only = only.get(self.random.next_below(only.len().max(1))).cloned();
                let only = only.unwrap_or_default();
                self.compare("run", &[&graph, "--only", &only, "--out", "TO"], &set);
            }
            (5, _) => drop(self.run_command("cache", &["gc", "--limit", "100kB"])),
            (6, _) => self.kill_a_run(&graph),
            _ => {}
        }
        self.compare("run", &[&graph, "--out", "TO"], &set);
    }

    /// Kills a run at a random moment. Later runs must not trust anything incomplete that it has left.
    fn kill_a_run(&mut self, graph: &str) {
        let milliseconds = self.random.next_below(120) as u64;
        let _ = writeln!(
            self.story,
            "$ maquette run {graph} --out out, killed after {milliseconds} ms"
        );
        let mut command = self.command(&["run", graph, "--out", "out"]);
        command.stdout(Stdio::null()).stderr(Stdio::null());
        let mut run = command.spawn().unwrap();
        std::thread::sleep(Duration::from_millis(milliseconds));
        let _ = run.kill();
        run.wait().unwrap();
    }

    fn outputs_in_text(&self) -> Vec<String> {
        let text = self.text();
        let Some(start) = text.find("outputs: {") else { return Vec::new() };
        let mut parts = text[start..].split('"').skip(1).step_by(2);
        let mut names = Vec::new();
        while let (Some(name), Some(_)) = (parts.next(), parts.next()) {
            names.push(name.to_owned());
        }
        names
    }

    /// Runs the program, which must not crash.
    fn run_command(&mut self, command: &str, arguments: &[&str]) -> Output {
        let said = self.run(&[&[command], arguments].concat());
        let _ = writeln!(self.story, "$ maquette {command} {}", arguments.join(" "));
        assert!(said.status.code().is_some_and(|code| code <= 2), "{}{said:?}", self.story);
        assert!(!stderr_of(&said).contains("panicked"), "{}{said:?}", self.story);
        said
    }

    /// Runs a command twice and compares the results: with the cache, writing to `out`, and without the cache, writing to a new folder.
    fn compare(&mut self, command: &str, arguments: &[&str], set: &[String]) {
        let home = self.folder.parent().unwrap().to_owned();
        let fresh = home.join("fresh");
        let _ = std::fs::remove_dir_all(&fresh);
        for folder in ["fresh", "out"] {
            std::fs::create_dir_all(home.join(folder)).unwrap();
        }
        fn in_folder(folder: &str, arguments: &[&str], set: &[String]) -> Vec<String> {
            let arguments = arguments.iter().map(|argument| argument.replace("TO", folder));
            arguments.chain(set.iter().cloned()).collect::<Vec<_>>()
        }
        let with = in_folder("out", arguments, set);
        let with = self.run_command(command, &with.iter().map(String::as_str).collect::<Vec<_>>());
        let mut without = in_folder("fresh", arguments, set);
        without.push("--no-cache".into());
        without.insert(0, command.into());
        let without = self.run(&without.iter().map(String::as_str).collect::<Vec<_>>());
        let both = format!("{}with memory {with:?}\nwithout {without:?}", self.story);
        assert_eq!(with.status.code(), without.status.code(), "{both}");
        if command == "inspect" {
            let [with, without] = [&with, &without].map(stdout_of);
            assert_eq!(with, without.replace("fresh/", "out/"), "{both}");
        }
        self.outputs_are_those_of(&fresh, "out");
    }

    fn outputs_are_those_of(&self, fresh: &Path, folder: &str) {
        let out = files(&fresh.with_file_name(folder));
        for (name, path) in files(fresh) {
            let there = out.get(&name).map(|path| std::fs::read(path).unwrap());
            assert!(there == Some(std::fs::read(path).unwrap()), "{}{name} is stale", self.story);
        }
    }

    fn watch(&mut self) -> Watch {
        let mut command = self.command(&["watch", "--events", "--out", "watched"]);
        command.arg(self.graph()).stdout(Stdio::null()).stderr(Stdio::null());
        let watch = Watch(command.spawn().unwrap());
        self.wait_for_watch();
        watch
    }

    /// Waits until the watched outputs equal those of the current graph.
    fn wait_for_watch(&mut self) {
        let fresh = self.folder.with_file_name("fresh");
        let _ = std::fs::remove_dir_all(&fresh);
        let graph = self.graph().to_string_lossy().into_owned();
        self.run_command("run", &[&graph, "--no-cache", "--out", "fresh"]);
        let end = Instant::now() + PATIENCE;
        fn is_right(fresh: &Path) -> bool {
            let watched = files(&fresh.with_file_name("watched"));
            files(fresh).into_iter().all(|(name, path)| {
                let there = watched.get(&name).and_then(|path| std::fs::read(path).ok());
                there == std::fs::read(path).ok()
            })
        }
        while !is_right(&fresh) && Instant::now() < end {
            std::thread::sleep(Duration::from_millis(20));
        }
        self.outputs_are_those_of(&fresh, "watched");
    }
}

/// A process `maquette watch`, which is killed when this value is dropped.
struct Watch(Child);

impl Drop for Watch {
    fn drop(&mut self) {
        assert!(self.0.try_wait().unwrap().is_none(), "the watch has ended by itself");
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn save(path: &Path, text: &str) {
    let new = path.with_extension("new");
    std::fs::write(&new, text).unwrap();
    std::fs::rename(new, path).unwrap();
}

/// Returns the files of a folder by name, except for hidden files.
fn files(folder: &Path) -> BTreeMap<String, PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let files = entries.map(|entry| entry.path()).filter(|path| path.is_file());
    let named = files.map(|path| (path.file_name().unwrap().to_string_lossy().into_owned(), path));
    named.filter(|(name, _)| !name.starts_with('.')).collect()
}

fn copy_files(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).unwrap();
    for (name, path) in files(from) {
        std::fs::copy(path, to.join(name)).unwrap();
    }
}
