//! What is remembered is true: random sequences of edits and commands, each compared with an evaluation without memory.
//!
//! After every evaluation the values, the states of the trace, its reasons, the forecast made before it and what was said to be
//! known must be those that follow from what an evaluation without memory finds. Where nothing is ever dropped or damaged, a
//! node runs exactly if nobody has computed the same before.
//!
//! `LAW_SEQUENCES` says how many sequences are tried, `PROPTEST_RNG_SEED` which.

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
use promises::{Found, agree, promise};
use step::{Command, Step};

/// How many sequences are tried, unless `LAW_SEQUENCES` says otherwise.
const SEQUENCES: u64 = 1000;

/// More than cores: sequences often wait, for files to become older and for the disk.
const THREADS: usize = 16;

/// Enough for all results of a sequence.
const AMPLE: usize = 1 << 24;

#[test]
fn whatever_is_done_in_whatever_order_what_is_remembered_is_true() {
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
    // No tasks of a common pool: while one waits for its evaluation it would begin others, until all have their own threads and none ends.
    let (next, failures) = (AtomicU64::new(0), Mutex::new(BTreeMap::new()));
    std::thread::scope(|scope| {
        (0..THREADS).for_each(|_| {
            drop(scope.spawn(|| {
                while let Some(shard) =
                    Some(next.fetch_add(1, Ordering::Relaxed)).filter(|it| *it < shards)
                {
                    if let Some(failure) = follow_shard(shard) {
                        // Those before it are followed to their end.
                        next.store(shards, Ordering::Relaxed);
                        lock(&failures).insert(shard, failure);
                    }
                }
            }))
        });
    });
    if let Some((_, failure)) = lock(&failures).first_key_value() {
        panic!("after some {} sequences: {failure}", broken.into_inner());
    }
}

/// The panics of [`pack`] are part of the law; their messages would only hide others.
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

/// Takes all steps; says which promise was broken.
fn follow(steps: &[Step]) -> Result<(), TestCaseError> {
    let mut world = World::new();
    for (place, step) in steps.iter().enumerate() {
        let kept = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| world.step(step)));
        let broken = match kept {
            Ok(Ok(())) => continue,
            Ok(Err(broken)) => broken,
            Err(panic) => maquette_syntax::error::in_words(&*panic),
        };
        return Err(TestCaseError::fail(format!("step {place}, {step:?}: {broken}")));
    }
    Ok(())
}

/// What is known of the nodes of a graph, by name: what each was last computed from.
type Last = HashMap<String, Parts>;

/// A process that evaluates the graph.
struct Process {
    evaluator: Evaluator,
    /// The keys of what it has computed or met.
    keys: HashSet<Hash>,
    last: Option<Last>,
}

struct World {
    project: Project,
    catalog: Catalog,
    /// Those that live; the last one is asked.
    processes: Vec<Process>,
    cache: PathBuf,
    /// The keys of what is on disk.
    kept: HashSet<Hash>,
    /// What the last evaluation on disk knew.
    last: Option<Last>,
    /// Whether it is known which results the processes still have.
    exact: bool,
    /// Whether it is known what the processes remember of the last evaluation.
    told: bool,
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
            exact: true,
            told: true,
            _folder: folder,
        };
        world.start(true);
        world
    }

    fn start(&mut self, disk: bool) {
        let mut evaluator = Evaluator::new(2, AMPLE).unwrap();
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
                    // Which of them wrote last what is on disk is not followed here.
                    self.told = false;
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
                self.exact = false;
                self.process().evaluator.set_memory(kilobytes << 10);
            }
            Command::Clear => {
                self.flush();
                Disk::gc(&self.cache, 0).unwrap();
                self.kept.clear();
                self.last = None;
                // Results may now be in memory alone, or, if they were read as hashes, nowhere.
                self.exact = false;
            }
            Command::Damage { file, at } => {
                self.flush();
                self.exact = false;
                self.told = false;
                damage(&self.cache, *file, *at);
            }
            Command::Forget => {
                self.exact = false;
                let process = self.process();
                process.evaluator.forget();
                process.last = Some(Last::new());
            }
            Command::Verify { share } => {
                self.exact = false;
                self.process().evaluator.verify = f64::from(*share) / 255.0;
            }
        }
        Ok(())
    }

    fn process(&mut self) -> &mut Process {
        self.processes.last_mut().expect("there is always one")
    }

    /// Waits until everything is on disk.
    fn flush(&self) {
        for disk in self.processes.iter().filter_map(|process| process.evaluator.disk()) {
            disk.finish();
        }
    }

    fn evaluate(&mut self, wanted: &[u8], values: bool, after: usize) -> Result<(), String> {
        let options = Options { files: Files::Ignored, ..Options::default() };
        let checked = Graph::load(&self.project.path(), &self.catalog, &options);
        let problems = checked.problems.first().map(|problem| problem.message.clone());
        let graph = checked.graph.ok_or_else(|| format!("the graph is refused: {problems:?}"))?;
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
        // What a process finds on disk when it first needs it.
        let (told, kept) = if evaluator.disk().is_some() { on_disk } else { Default::default() };
        let last = process.last.get_or_insert(told).clone();
        let known: HashSet<Hash> = process.keys.union(&kept).copied().collect();

        let foreseen = evaluator.foreseen(&graph, &roots);
        for root in &roots {
            let hash = foreseen.hash(*root, 0);
            let (name, truth) = (&graph.nodes()[*root].name, truths[*root].hash(0));
            promise!(
                hash.is_none() || hash == truth,
                "`{name}` is said to be as it was, and is not"
            );
        }
        let forecasts = evaluator.forecast(&graph, &roots, &[]);
        let cancel = CancelToken::default();
        let seen = Seen { after, cancel: cancel.clone(), started: Mutex::default() };
        let values = if values { &roots[..] } else { &[] };
        let evaluation = evaluator.evaluate(&graph, &roots, values, &seen, &cancel);
        let started = lock(&seen.started).clone();
        let cancelled = cancel.is_cancelled();

        agree(&graph, &truths, &evaluation, values, cancelled)?;
        let found = Found { graph: &graph, truths: &truths, evaluation: &evaluation };
        if !cancelled {
            found.states(&started)?;
            if self.exact {
                found.runs(&known, &started)?;
                found.forecast(&forecasts)?;
            }
            if self.exact && self.told {
                found.reasons(&last)?;
            }
        }
        self.remember(&graph, &truths, &evaluation);
        Ok(())
    }

    /// What the process knows after an evaluation, and what the next one finds on disk.
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

/// Tells a new cache folder which program this is: finding it out takes longer than a sequence.
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

/// Damages a file of the cache.
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

/// Notes which nodes begin, and cancels when enough have.
struct Seen {
    after: usize,
    cancel: CancelToken,
    started: Mutex<Vec<String>>,
}

impl Observer for Seen {
    fn started(&self, node: &str) {
        let mut started = lock(&self.started);
        started.push(node.to_owned());
        if started.len() > self.after {
            self.cancel.cancel();
        }
    }
}
