//! Tests that cached results are right. The tests run random sequences of edits and commands. They compare each evaluation with an
//! evaluation without a cache.
//!
//! After every evaluation, five things must agree with an evaluation without a cache: the values, the states in the trace, the reasons in
//! the trace, the forecast made before the evaluation, and the predicted hashes. If no result was dropped or damaged, a node must run
//! exactly if no process has computed its result before.
//!
//! The environment variable `LAW_SEQUENCES` sets the number of sequences, and `PROPTEST_RNG_SEED` sets the seed.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Mutex, Once, OnceLock};

use maquette_graph::catalog::Catalog;
use maquette_graph::{Files, Graph, Options};
use maquette_node::CancelToken;
use maquette_value::Hash;
use proptest::test_runner::{Config, RngAlgorithm, TestCaseError, TestRng, TestRunner};

use super::key::Parts;
use super::{Disk, Evaluation, Evaluator, Observer, lock};

mod pack;
mod plain;
mod project;
mod promises;
mod step;

use plain::Truth;
use project::Project;
use promises::{CompletedEvaluation, agree, promise};
use step::{Command, Step};

/// The default number of sequences, used if `LAW_SEQUENCES` is not set.
const SEQUENCES: u64 = 1000;

/// The number of threads that run sequences. More than the number of processors, because a sequence often waits for the disk or until files
/// are old enough.
const THREADS: usize = 16;

/// A memory limit for results, in bytes. It is large enough for all results of a sequence.
const AMPLE_MEMORY: usize = 1 << 24;

#[test]
fn cached_results_are_right_after_any_sequence_of_steps() {
    be_quiet_about_panics();
    fn number(name: &str) -> Option<u64> {
        std::env::var(name).ok()?.parse::<u64>().ok()
    }
    let cases = number("LAW_SEQUENCES").unwrap_or(SEQUENCES);
    let seed = number("PROPTEST_RNG_SEED").unwrap_or(20_070_115);
    let shards = cases.div_ceil(50);
    let (tried, broken) = (AtomicUsize::new(0), AtomicUsize::new(usize::MAX));
    let follow_shard = |shard: u64| {
        let mut bytes = [0; 32];
        bytes[..8].copy_from_slice(&(seed + shard).to_le_bytes());
        let rng = TestRng::from_seed(RngAlgorithm::ChaCha, &bytes);
        let cases = cases.div_ceil(shards) as u32;
        let config = Config { cases, failure_persistence: None, ..Config::default() };
        let mut runner = TestRunner::new_with_rng(config, rng);
        let failure = runner.run(&step::sequence(), |steps| {
            let before = tried.fetch_add(1, Ordering::Relaxed);
            let kept = follow(&steps);
            if kept.is_err() {
                broken.fetch_min(before, Ordering::Relaxed);
            }
            kept
        });
        failure.err()
    };
    // Use plain threads instead of tasks in the shared thread pool. A pool task that waits for its evaluation would start other tasks on
    // its thread, until all tasks have begun and none can end.
    let (next, failures) = (AtomicU64::new(0), Mutex::new(BTreeMap::new()));
    std::thread::scope(|scope| {
        (0..THREADS).for_each(|_| {
            drop(scope.spawn(|| {
                while let Some(shard) =
                    Some(next.fetch_add(1, Ordering::Relaxed)).filter(|it| *it < shards)
                {
                    if let Some(failure) = follow_shard(shard) {
                        // Do not start later shards, because this shard has failed. Earlier shards that are still running continue to their
                        // end.
                        next.store(shards, Ordering::Relaxed);
                        lock(&failures).insert(shard, failure);
                    }
                }
            }));
        });
    });
    if let Some((_, failure)) = lock(&failures).first_key_value() {
        panic!("after some {} sequences: {failure}", broken.into_inner());
    }
}

/// Suppresses the messages of the panics that the nodes in [`pack`] cause on purpose. They would hide other messages.
fn be_quiet_about_panics() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let usual = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |info| {
            if info.payload().downcast_ref::<&str>() != Some(&pack::PANIC) {
                usual(info);
            }
        }));
    });
}

/// Runs all steps of a sequence. The error names the first step after which the cache was wrong.
fn follow(steps: &[Step]) -> Result<(), TestCaseError> {
    let mut world = World::new();
    for (place, step) in steps.iter().enumerate() {
        let kept = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| world.step(step)));
        let broken = match kept {
            Ok(Ok(())) => continue,
            Ok(Err(broken)) => broken,
            Err(panic) => maquette_syntax::error::panic_message(&*panic),
        };
        return Err(TestCaseError::fail(format!("step {place}, {step:?}: {broken}")));
    }
    Ok(())
}

/// The parts (inputs of the key) from which each node was last computed, by the name of the node.
type LastParts = HashMap<String, Parts>;

/// A simulated process that evaluates the graph.
struct Process {
    evaluator: Evaluator,
    /// The keys of all results that the process has computed or read.
    keys: HashSet<Hash>,
    last: Option<LastParts>,
}

struct World {
    project: Project,
    catalog: Catalog,
    /// The running processes. Commands are sent to the last process in this list.
    processes: Vec<Process>,
    cache: PathBuf,
    /// The keys of the results that are on disk.
    kept: HashSet<Hash>,
    /// The parts of each node, as the record of the last evaluation on disk contains them; `None` if there is no record.
    last: Option<LastParts>,
    /// True if the test knows exactly which results each process still has.
    is_exact: bool,
    /// True if the test knows, for each process, which evaluation that process remembers as the last one.
    is_record_known: bool,
    _folder: tempfile::TempDir,
}

impl World {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let project = folder.path().join("project");
        std::fs::create_dir(&project).unwrap();
        let mut world = Self {
            project: Project::new(&project),
            catalog: Catalog::new(&[&pack::PACK]),
            processes: Vec::new(),
            cache: folder.path().join("cache"),
            kept: HashSet::new(),
            last: None,
            is_exact: true,
            is_record_known: true,
            _folder: folder,
        };
        world.start(true);
        world
    }

    fn start(&mut self, disk: bool) {
        let mut evaluator = Evaluator::new(2, AMPLE_MEMORY).unwrap();
        if disk {
            share_fingerprint(&self.cache);
            let disk = Disk::open(&self.cache, u64::MAX, &self.catalog).unwrap();
            evaluator = evaluator.with_disk(disk);
        }
        self.processes.push(Process { evaluator, keys: HashSet::new(), last: None });
    }

    fn step(&mut self, step: &Step) -> Result<(), String> {
        match step {
            Step::Edit(edit) => self.project.edit(edit),
            Step::Command(command) => return self.command(command),
        }
        Ok(())
    }

    fn command(&mut self, command: &Command) -> Result<(), String> {
        match command {
            Command::Evaluate { wanted, values } => {
                return self.evaluate(wanted, *values, usize::MAX);
            }
            Command::Cancel { wanted, after } => return self.evaluate(wanted, true, *after),
            Command::Process { keep, disk } => {
                self.flush();
                if *keep {
                    // From here on the reasons are not checked: the test does not track which process was the last to write the record on
                    // disk.
                    self.is_record_known = false;
                    self.processes.rotate_left(1);
                }
                if !keep || self.processes.len() < 2 {
                    if !keep {
                        self.processes.pop();
                    }
                    self.start(*disk);
                }
            }
            Command::Memory { kilobytes } => {
                self.is_exact = false;
                self.process().evaluator.set_memory(kilobytes << 10);
            }
            Command::Clear => {
                self.flush();
                Disk::gc(&self.cache, 0).unwrap();
                self.kept.clear();
                self.last = None;
                // From here on the test does not know which results exist. A result may exist only in memory, or nowhere if only its hashes
                // were read.
                self.is_exact = false;
            }
            Command::Damage { file, at } => {
                self.flush();
                self.is_exact = false;
                self.is_record_known = false;
                damage(&self.cache, *file, *at);
            }
            Command::Forget => {
                self.is_exact = false;
                let process = self.process();
                process.evaluator.forget();
                process.last = Some(LastParts::new());
            }
            Command::Verify { fraction } => {
                self.is_exact = false;
                self.process().evaluator.verified_fraction = f64::from(*fraction) / 255.0;
            }
        }
        Ok(())
    }

    fn process(&mut self) -> &mut Process {
        self.processes.last_mut().expect("there is always one")
    }

    /// Waits until all processes have written their results to disk.
    fn flush(&self) {
        for disk in self.processes.iter().filter_map(|process| process.evaluator.disk()) {
            disk.finish();
        }
    }

    fn evaluate(&mut self, wanted: &[u8], values: bool, after: usize) -> Result<(), String> {
        let options = Options { files: Files::Ignored, ..Options::default() };
        let checked = Graph::load(&self.project.path(), &self.catalog, &options);
        let diagnostics = checked.diagnostics.first().map(|diagnostic| diagnostic.message.clone());
        let graph =
            checked.graph.ok_or_else(|| format!("the graph is refused: {diagnostics:?}"))?;
        let roots = match wanted {
            _ if self.project.is_empty() => Vec::new(),
            [] => Vec::from_iter(0..graph.nodes().len()),
            picks => picks
                .iter()
                .flat_map(|pick| graph.nodes_of(self.project.name(*pick)))
                .collect::<Vec<_>>(),
        };
        let truths = plain::evaluate(&graph, &roots);
        let on_disk = (self.last.clone().unwrap_or_default(), self.kept.clone());
        let process = self.process();
        let evaluator = &mut process.evaluator;
        // Use the present state of the disk: the process reads the disk only when it first needs results.
        let (recorded, kept) =
            if evaluator.disk().is_some() { on_disk } else { Default::default() };
        let last = process.last.get_or_insert(recorded).clone();
        let known: HashSet<Hash> = process.keys.union(&kept).copied().collect();

        let foreseen = evaluator.predict(&graph, &roots);
        for root in &roots {
            let hash = foreseen.hash(*root, 0);
            let (name, truth) = (&graph.nodes()[*root].name, truths[*root].hash(0));
            promise!(
                hash.is_none() || hash == truth,
                "`{name}` has changed, but the prediction says that it has not"
            );
        }
        let forecasts = evaluator.forecast(&graph, &roots, &[]);
        let cancel = CancelToken::default();
        let seen = CancellingObserver { after, cancel: cancel.clone(), started: Mutex::default() };
        let values = if values { &roots[..] } else { &[] };
        let evaluation = evaluator.evaluate(&graph, &roots, values, &seen, &cancel);
        let started = lock(&seen.started).clone();
        let cancelled = cancel.is_cancelled();

        agree(&graph, &truths, &evaluation, values, cancelled)?;
        let found = CompletedEvaluation { graph: &graph, truths: &truths, evaluation: &evaluation };
        if !cancelled {
            found.states(&started)?;
            if self.is_exact {
                found.runs(&known, &started)?;
                found.forecast(&forecasts)?;
            }
            if self.is_exact && self.is_record_known {
                found.reasons(&last)?;
            }
        }
        self.remember(&graph, &truths, &evaluation);
        Ok(())
    }

    /// Updates the expected state of the process and of the disk after an evaluation.
    fn remember(&mut self, graph: &Graph, truths: &[Truth], evaluation: &Evaluation) {
        let process = self.processes.last_mut().expect("there is always one");
        let disk = process.evaluator.disk().is_some();
        let last = process.last.get_or_insert_default();
        last.retain(|name, _| graph.nodes().iter().any(|node| node.name == *name));
        for (index, node) in graph.nodes().iter().enumerate() {
            if let (Truth::Given { parts, .. }, Some(_)) =
                (&truths[index], evaluation.hash(index, 0))
            {
                last.insert(node.name.clone(), parts.clone());
                process.keys.insert(parts.key());
                self.kept.extend(disk.then(|| parts.key()));
            }
        }
        if disk {
            self.last = Some(last.clone());
        }
    }
}

/// Copies the stored hash of this test's executable to a new cache folder. Computing the hash takes longer than a sequence.
fn share_fingerprint(cache: &Path) {
    static KNOWN: OnceLock<tempfile::TempDir> = OnceLock::new();
    let known = KNOWN.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        Disk::open(folder.path(), u64::MAX, &Catalog::new(&[&pack::PACK])).unwrap();
        folder
    });
    let programs = cache.join("programs");
    std::fs::create_dir_all(&programs).unwrap();
    for memo in std::fs::read_dir(known.path().join("programs")).unwrap().flatten() {
        std::fs::copy(memo.path(), programs.join(memo.file_name())).unwrap();
    }
}

/// Damages one file of the cache. `file` selects the file and `at` the position of the damage.
fn damage(cache: &Path, file: u16, at: u16) {
    let mut files = Vec::new();
    let mut folders = vec![cache.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
            let path = entry.path();
            if path.is_dir() { folders.push(path) } else { files.push(path) }
        }
    }
    files.retain(|path| {
        !path.ends_with("CACHEDIR.TAG") && !path.to_string_lossy().contains("programs")
    });
    files.sort();
    if files.is_empty() {
        return;
    }
    let path = &files[usize::from(file) % files.len()];
    let mut bytes = std::fs::read(path).unwrap();
    match usize::from(at) % (bytes.len() + 8) {
        place if place < bytes.len() => bytes[place] ^= 1 << (at % 8),
        rest => bytes.truncate(rest),
    }
    std::fs::write(path, bytes).unwrap();
}

/// An observer that records which nodes start. It cancels the evaluation after a given number of nodes.
struct CancellingObserver {
    after: usize,
    cancel: CancelToken,
    started: Mutex<Vec<String>>,
}

impl Observer for CancellingObserver {
    fn on_start(&self, node: &str) {
        let mut started = lock(&self.started);
        started.push(node.to_owned());
        if started.len() > self.after {
            self.cancel.cancel();
        }
    }
}
