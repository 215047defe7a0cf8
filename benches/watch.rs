//! Measures the speed, processor load and memory of a watch (`maquette watch`). These limits must be met on a quiet machine:
//!
//! - after the parameter `growth` is saved, diagnostics appear within 30 ms (median) or 80 ms (95th percentile), and outputs within 60 or
//!   120 ms,
//! - a change of a comment causes no node to run,
//! - the processor time of an idle watch is not measurable,
//! - 10 000 saves of different values need no additional memory, once the maximum number of results is kept.
//!
//! `cargo bench -p maquette-program --bench watch` takes half a minute. With `-- 10000` it makes this number of additional saves, to
//! measure the memory.

use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use serde_json::Value as Json;

const GRAPHS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../graphs");
const SAVES: usize = 200;
const IDLE: Duration = Duration::from_secs(10);

fn main() {
    let saves = std::env::args().skip(1).find_map(|argument| argument.parse::<usize>().ok());
    let mut watch = Watch::start();
    latency(&mut watch);
    comments(&mut watch);
    idle(&watch);
    if let Some(saves) = saves {
        memory(&mut watch, saves);
    }
}

fn say(line: &str) {
    writeln!(std::io::stdout(), "{line}").expect("stdout is open");
}

/// A watch of a copy of the example graph `doll.ron`, with its events and their times of arrival.
struct Watch {
    folder: tempfile::TempDir,
    text: String,
    process: Child,
    events: Receiver<(Instant, Json)>,
}

impl Watch {
    fn start() -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        std::fs::create_dir(folder.path().join("doll")).expect("a folder");
        for name in ["doll.ron", "doll/color.png", "doll/range.pcd", "doll/camera.json"] {
            std::fs::copy(Path::new(GRAPHS).join(name), folder.path().join(name)).expect("a copy");
        }
        let text = std::fs::read_to_string(folder.path().join("doll.ron")).expect("the graph");
        let mut process = Command::new(env!("CARGO_BIN_EXE_maquette"))
            .args(["watch", "doll.ron", "--events", "--threads", "2"])
            .current_dir(folder.path())
            .env("MAQUETTE_CACHE", folder.path().join("cache"))
            .stdout(Stdio::piped())
            .spawn()
            .expect("the program runs");
        let lines = BufReader::new(process.stdout.take().expect("its stdout")).lines();
        let (sender, events) = channel();
        std::thread::spawn(move || {
            for line in lines.map_while(Result::ok) {
                let now = Instant::now();
                let event = serde_json::from_str(&line).expect("an event");
                if sender.send((now, event)).is_err() {
                    return;
                }
            }
        });
        let mut watch = Self { folder, text, process, events };
        watch.wait("done");
        watch
    }

    fn wait(&mut self, kind: &str) -> (Instant, Json) {
        loop {
            let (at, event) =
                self.events.recv_timeout(Duration::from_secs(60)).expect("an event in time");
            if event["event"] == kind {
                return (at, event);
            }
        }
    }

    /// Saves the graph as most editors do: writes a new file and renames it. Returns the time of the save.
    fn save(&self, text: &str) -> Instant {
        let graph = self.graph();
        let temporary = graph.with_extension("new");
        std::fs::write(&temporary, text).expect("a file");
        let now = Instant::now();
        std::fs::rename(temporary, graph).expect("a save");
        now
    }

    fn graph(&self) -> PathBuf {
        self.folder.path().join("doll.ron")
    }

    /// Returns the text of the example graph `doll.ron` in which `growth` has this default. A value above 40 is an error.
    fn with_growth(&self, growth: f64) -> String {
        self.text.replace("default: 12.0", &format!("default: {growth:.4}"))
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

fn latency(watch: &mut Watch) {
    let (mut checked, mut broken, mut written) = (Vec::new(), Vec::new(), Vec::new());
    for k in 0..SAVES {
        // Do not use the value 12 mm of the first run, whose results are cached.
        let saved = watch.save(&watch.with_growth(5.05 + k as f64 * 0.1));
        checked.push(watch.wait("problems").0 - saved);
        let (done, event) = watch.wait("done");
        assert!(event["ok"] == true && event["computed"] != 0, "{event}");
        written.push(done - saved);
        let saved = watch.save(&watch.with_growth(50.0 + k as f64 * 0.1));
        let (at, event) = watch.wait("problems");
        assert_ne!(event["problems"][0], Json::Null);
        broken.push(at - saved);
        watch.wait("done");
    }
    percentiles("save to check shown, good graph", checked);
    percentiles("save to problems shown, broken graph", broken);
    percentiles("save to outputs written", written);
}

fn percentiles(what: &str, mut times: Vec<Duration>) {
    times.sort_unstable();
    fn percentile(share: usize, times: &[Duration]) -> f64 {
        times[times.len() * share / 100].as_secs_f64() * 1e3
    }
    let most = times.last().map_or(0.0, Duration::as_secs_f64) * 1e3;
    say(&format!(
        "{what:<38} p50 {:6.1} ms  p95 {:6.1} ms  most {most:6.1} ms",
        percentile(50, &times),
        percentile(95, &times)
    ));
}

fn comments(watch: &mut Watch) {
    watch.save(&watch.text.clone());
    watch.wait("done");
    let mut computed = 0;
    for k in 0..20 {
        watch.save(&format!("// {k}\n{}", watch.text));
        computed += watch.wait("done").1["computed"].as_u64().expect("a number");
    }
    say(&format!("nodes run by 20 comments               {computed}"));
}

fn idle(watch: &Watch) {
    std::thread::sleep(Duration::from_millis(500));
    let before = processor_ticks(&watch.process);
    std::thread::sleep(IDLE);
    let ticks = before.zip(processor_ticks(&watch.process)).map(|(before, after)| after - before);
    let ticks = ticks.map_or("not known here".into(), |ticks| format!("{ticks} ticks of 10 ms"));
    say(&format!("processor time in {IDLE:?} without work     {ticks}"));
}

/// Returns the processor time of a process in user and system mode, in ticks (Linux: proc(5), fields 14 and 15 of `stat`).
fn processor_ticks(process: &Child) -> Option<u64> {
    let stat = std::fs::read_to_string(format!("/proc/{}/stat", process.id())).ok()?;
    let fields: Vec<&str> = stat.rsplit_once(')')?.1.split_whitespace().collect();
    Some(fields.get(11)?.parse::<u64>().ok()? + fields.get(12)?.parse::<u64>().ok()?)
}

fn memory(watch: &mut Watch, saves: usize) {
    for k in 0..saves {
        watch.save(&watch.with_growth(1.0 + 38.0 * k as f64 / saves as f64));
        watch.wait("done");
        if k % (saves / 10).max(1) == 0 || k + 1 == saves || k == 100 {
            let memory = resident(&watch.process).unwrap_or_default();
            say(&format!("memory after {:>5} saves of new values   {memory:.0} MB", k + 1));
        }
    }
}

/// Returns the resident memory of a process in megabytes (Linux).
fn resident(process: &Child) -> Option<f64> {
    let status = std::fs::read_to_string(format!("/proc/{}/status", process.id())).ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    line.trim().strip_suffix("kB")?.trim().parse::<f64>().ok().map(|kilobytes| kilobytes / 1e3)
}
