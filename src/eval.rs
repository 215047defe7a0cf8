//! Evaluates a graph: on demand, in parallel, each key once.
//!
//! A node's key is known before the node is run ([`key`]), so a result that is in the cache is never computed again. Nodes that
//! do not hang on each other run in parallel; a node that fails takes with it only what hangs on it.

use std::any::Any;
use std::collections::{BTreeMap, HashMap};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock};
use std::time::Instant;

use crate::error::{Cancelled, Error, Problem, Severity, code};
use crate::graph::{Graph, GraphNode, GraphOutput};
use crate::node::{CancelToken, Context, File, Progress, ReadError};
use crate::pack::NewFile;
use crate::value::{AnyValue, Hash};

mod cache;
mod key;
mod trace;

use cache::{Cache, Outcome};
use key::KeyParts;
pub use trace::{NodeTrace, State, Trace};

/// Watches an evaluation from outside. All methods may be called from any thread.
pub trait Observer: Sync {
    /// A node is being computed.
    fn started(&self, node: &str) {
        let _ = node;
    }

    /// A node has done this share (0 to 1) of its work.
    fn progress(&self, node: &str, share: f64) {
        let _ = (node, share);
    }

    /// A node is done, in whatever way.
    fn finished(&self, node: &NodeTrace) {
        let _ = node;
    }
}

impl Observer for () {}

/// Evaluates graphs and remembers results between evaluations.
pub struct Evaluator {
    pool: rayon::ThreadPool,
    cache: Cache,
    /// What each node, by name, was computed from last time, and the hashes of its outputs.
    last: HashMap<String, Last>,
}

struct Last {
    parts: KeyParts,
    hashes: Vec<Hash>,
}

/// No threads could be started.
#[derive(Debug, thiserror::Error)]
#[error("cannot start threads: {0}")]
pub struct ThreadsError(String);

/// The result of one evaluation.
pub struct Evaluation {
    /// What happened to each node that a wanted output needs, in the graph's order.
    pub trace: Trace,
    /// What failed, and what nodes have doubts about, at the nodes' places.
    pub problems: Vec<Problem>,
    values: Vec<Option<Arc<Outcome>>>,
}

impl Evaluation {
    /// The value of a node's output, if it was computed; both by their place in the graph.
    pub(crate) fn value(&self, node: usize, output: usize) -> Option<&AnyValue> {
        self.values.get(node)?.as_ref()?.values.get(output)
    }

    /// The value of a node's output by their names; the first output if `output` is empty.
    pub fn find(&self, graph: &Graph, node: &str, output: &str) -> Option<&AnyValue> {
        let index = graph.find(node)?;
        let names = &graph.nodes[index].outputs;
        let output =
            if output.is_empty() { Some(0) } else { names.iter().position(|name| *name == output) };
        self.value(index, output?)
    }

    /// The files of one of the graph's outputs; none if its node failed.
    pub(crate) fn files(&self, output: &GraphOutput) -> Option<Result<Vec<NewFile>, Error>> {
        let value = self.value(output.node, output.output)?;
        let name = Path::new(&output.name).file_name()?.to_string_lossy().into_owned();
        let write = AssertUnwindSafe(|| output.format.write(value, &name));
        Some(catch_unwind(write).unwrap_or_else(|panic| Err(Panic(in_words(&*panic)).into())))
    }
}

/// A panic that was caught: our bug, or a plugin's.
#[derive(Clone, Debug, thiserror::Error)]
#[error("it panicked: {0}")]
struct Panic(String);

/// What a panic said.
pub(crate) fn in_words(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
    text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_else(|| "no message".into())
}

impl Evaluator {
    /// An evaluator with this many threads (0: as many as the machine has) and this many bytes of memory for results.
    ///
    /// # Errors
    /// If the threads cannot be started.
    pub fn new(threads: usize, memory: usize) -> Result<Self, ThreadsError> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        let pool = pool.map_err(|error| ThreadsError(error.to_string()))?;
        Ok(Self { pool, cache: Cache::new(memory), last: HashMap::new() })
    }

    /// Runs something on the evaluator's threads.
    pub fn install<R: Send>(&self, work: impl FnOnce() -> R + Send) -> R {
        self.pool.install(work)
    }

    /// Evaluates what these nodes, by their place in the graph, need.
    pub(crate) fn evaluate(
        &mut self,
        graph: &Graph,
        wanted: &[usize],
        observer: &dyn Observer,
        cancel: &CancelToken,
    ) -> Evaluation {
        let run = Run::new(self, graph, wanted, observer, cancel);
        self.pool.install(|| rayon::scope(|scope| run.start(scope)));
        let done = run.done;
        self.finish(graph, done.into_iter().map(OnceLock::into_inner).collect())
    }

    /// Evaluates all outputs of a graph.
    pub fn evaluate_all(&mut self, graph: &Graph) -> Evaluation {
        let wanted: Vec<usize> = graph.outputs.iter().map(|output| output.node).collect();
        self.evaluate(graph, &wanted, &(), &CancelToken::default())
    }

    /// Evaluates every node of a graph, those that no output needs included.
    pub fn evaluate_all_nodes(
        &mut self,
        graph: &Graph,
        observer: &dyn Observer,
        cancel: &CancelToken,
    ) -> Evaluation {
        let all: Vec<usize> = (0..graph.nodes.len()).collect();
        self.evaluate(graph, &all, observer, cancel)
    }

    fn finish(&mut self, graph: &Graph, done: Vec<Option<Done>>) -> Evaluation {
        let mut trace = Vec::new();
        let mut problems = Vec::new();
        let mut values = Vec::with_capacity(done.len());
        for (node, done) in graph.nodes.iter().zip(done) {
            let Some(done) = done else {
                values.push(None);
                continue;
            };
            let problem = |severity, code, message: String, help: &str| Problem {
                severity,
                code,
                source: graph.source.clone(),
                span: node.span,
                message,
                help: help.into(),
                note: None,
            };
            if let Some(error) = &done.error {
                let panicked = error.downcast::<Panic>().is_some();
                let message = format!("`{}` cannot be computed: {error}", node.name);
                problems.push(match panicked {
                    true => problem(
                        Severity::Error,
                        code::PANIC,
                        message,
                        "this is a bug of the node; please report it with the graph",
                    ),
                    false => problem(Severity::Error, code::FAILED, message, ""),
                });
            }
            for warning in &done.trace.warnings {
                let message = format!("`{}`: {warning}", node.name);
                problems.push(problem(Severity::Warning, code::WARNING, message, ""));
            }
            if let (Some(outcome), Some(parts)) = (&done.outcome, done.parts) {
                let hashes = outcome.values.iter().map(AnyValue::hash).collect();
                self.last.insert(node.name.clone(), Last { parts, hashes });
            }
            trace.push(done.trace);
            values.push(done.outcome);
        }
        Evaluation { trace: Trace(trace), problems, values }
    }
}

/// What became of a node.
struct Done {
    outcome: Option<Arc<Outcome>>,
    error: Option<Error>,
    parts: Option<KeyParts>,
    trace: NodeTrace,
    /// Whether this node, or one that it hangs on, ran.
    ran: bool,
}

/// One evaluation under way.
struct Run<'a> {
    graph: &'a Graph,
    cache: &'a Cache,
    last: &'a HashMap<String, Last>,
    observer: &'a dyn Observer,
    cancel: &'a CancelToken,
    wanted: Vec<bool>,
    /// How many links of each node wait for their node.
    waiting: Vec<AtomicUsize>,
    /// The nodes that are linked to each node, once per link.
    users: Vec<Vec<usize>>,
    done: Vec<OnceLock<Done>>,
    /// Nodes that wait for another one with the same key.
    in_flight: Mutex<HashMap<Hash, Vec<usize>>>,
    files: Mutex<BTreeMap<PathBuf, Arc<OnceLock<Option<File>>>>>,
}

impl<'a> Run<'a> {
    fn new(
        evaluator: &'a Evaluator,
        graph: &'a Graph,
        roots: &[usize],
        observer: &'a dyn Observer,
        cancel: &'a CancelToken,
    ) -> Self {
        let count = graph.nodes.len();
        let mut wanted = vec![false; count];
        roots.iter().for_each(|&root| wanted[root] = true);
        let mut users = vec![Vec::new(); count];
        // Each node comes after those that it hangs on, so backwards every user is met before what it uses.
        for index in (0..count).rev() {
            if wanted[index] {
                for link in &graph.nodes[index].links {
                    wanted[link.node] = true;
                    users[link.node].push(index);
                }
            }
        }
        let waiting = graph.nodes.iter().map(|node| AtomicUsize::new(node.links.len())).collect();
        Self {
            graph,
            cache: &evaluator.cache,
            last: &evaluator.last,
            observer,
            cancel,
            wanted,
            waiting,
            users,
            done: (0..count).map(|_| OnceLock::new()).collect(),
            in_flight: Mutex::default(),
            files: Mutex::default(),
        }
    }

    fn start<'s>(&'s self, scope: &rayon::Scope<'s>) {
        for index in 0..self.graph.nodes.len() {
            if self.wanted[index] && self.graph.nodes[index].links.is_empty() {
                scope.spawn(move |scope| self.visit(index, scope));
            }
        }
    }

    /// Brings a node to its end, and then those that waited for it alone.
    fn visit<'s>(&'s self, index: usize, scope: &rayon::Scope<'s>) {
        let mut next = Some(index);
        // One of the nodes that become ready goes on here, without the cost of a task: long chains are common.
        while let Some(index) = next.take() {
            let Some((done, waiters)) = self.node(index) else { return };
            let _ = self.done[index].set(done);
            let mut ready: Vec<usize> = waiters;
            for &user in &self.users[index] {
                if self.waiting[user].fetch_sub(1, Ordering::AcqRel) == 1 {
                    ready.push(user);
                }
            }
            next = ready.pop();
            for other in ready {
                scope.spawn(move |scope| self.visit(other, scope));
            }
        }
    }

    /// What becomes of a node, and the nodes of the same key that waited for it; none if it waits itself.
    fn node(&self, index: usize) -> Option<(Done, Vec<usize>)> {
        let node = &self.graph.nodes[index];
        let inputs: Vec<&Done> =
            node.links.iter().filter_map(|link| self.done[link.node].get()).collect();
        let ran_above = inputs.iter().any(|input| input.ran);
        if let Some(failed) =
            node.links.iter().find(|link| self.value(link.node, link.output).is_none())
        {
            let reason = format!("hangs on `{}`", self.graph.nodes[failed.node].name);
            return Some((
                self.without_value(node, State::Skipped, reason, None, ran_above),
                Vec::new(),
            ));
        }
        let values: Vec<AnyValue> = node
            .links
            .iter()
            .filter_map(|link| self.value(link.node, link.output).cloned())
            .collect();
        let files = match self.read_files(node) {
            Ok(files) => files,
            Err(error) => {
                let reason = error.to_string();
                return Some((
                    self.without_value(node, State::Failed, reason, Some(error), ran_above),
                    Vec::new(),
                ));
            }
        };
        let parts = KeyParts::new(node, &values, &files);
        let key = parts.key();
        let mut flight = lock(&self.in_flight);
        if let Some(outcome) = self.cache.find(key) {
            drop(flight);
            return Some((self.not_run(node, outcome, parts, ran_above), Vec::new()));
        }
        match flight.get_mut(&key) {
            Some(waiters) => {
                waiters.push(index);
                return None;
            }
            None => drop(flight.insert(key, Vec::new())),
        }
        drop(flight);
        let done = self.compute(node, &values, &files, parts, key);
        // After the result is in the cache: whoever comes now finds it there.
        let waiters = lock(&self.in_flight).remove(&key).unwrap_or_default();
        Some((done, waiters))
    }

    fn value(&self, node: usize, output: usize) -> Option<&AnyValue> {
        self.done[node].get()?.outcome.as_ref()?.values.get(output)
    }

    /// Every file that the node reads, each path read once an evaluation; none for one that is not there.
    fn read_files(&self, node: &GraphNode) -> Result<BTreeMap<PathBuf, Option<File>>, Error> {
        let optional = node.node.files();
        let mut files = BTreeMap::new();
        for path in &node.files {
            let given = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            let Some(file) = self.read_file(path, &given)? else {
                return Err(
                    ReadError { name: given, reason: "there is no such file".into() }.into()
                );
            };
            files.insert(path.clone(), Some(file));
        }
        for path in optional {
            let file = self.read_file(path.resolved(), path.given())?;
            files.insert(path.resolved().to_owned(), file);
        }
        Ok(files)
    }

    fn read_file(&self, path: &Path, given: &str) -> Result<Option<File>, Error> {
        let slot = lock(&self.files).entry(path.to_owned()).or_default().clone();
        if let Some(file) = slot.get() {
            return Ok(file.clone());
        }
        let file = match std::fs::read(path) {
            Ok(bytes) => {
                let hash = Hash::of(&bytes);
                Some(File { name: given.to_owned(), bytes: bytes.into(), hash })
            }
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => None,
            Err(error) => {
                let (name, reason) = (given.to_owned(), error.to_string());
                return Err(ReadError { name, reason }.into());
            }
        };
        Ok(slot.get_or_init(|| file).clone())
    }

    fn without_value(
        &self,
        node: &GraphNode,
        state: State,
        reason: String,
        error: Option<Error>,
        ran: bool,
    ) -> Done {
        let trace = NodeTrace::new(node, state, reason);
        self.observer.finished(&trace);
        Done { outcome: None, error, parts: None, trace, ran }
    }

    fn not_run(
        &self,
        node: &GraphNode,
        outcome: Arc<Outcome>,
        parts: KeyParts,
        ran_above: bool,
    ) -> Done {
        let (state, reason) = match ran_above {
            true => (State::Equal, "its inputs came out the same"),
            false => (State::Cached, "nothing that it depends on changed"),
        };
        let mut trace = NodeTrace::new(node, state, reason.into());
        trace.bytes = outcome.bytes;
        trace.warnings.clone_from(&outcome.warnings);
        self.observer.finished(&trace);
        Done { outcome: Some(outcome), error: None, parts: Some(parts), trace, ran: ran_above }
    }

    fn compute(
        &self,
        node: &GraphNode,
        values: &[AnyValue],
        files: &BTreeMap<PathBuf, Option<File>>,
        parts: KeyParts,
        key: Hash,
    ) -> Done {
        self.observer.started(&node.name);
        let start = Instant::now();
        let report = |share: f64| self.observer.progress(&node.name, share);
        let cx = Context {
            inputs: values,
            files,
            progress: Progress { report: Some(&report), cancel: Some(self.cancel) },
            memos: Some(self.cache),
            warnings: Mutex::default(),
        };
        let result = if self.cancel.is_cancelled() {
            Err(Cancelled.into())
        } else {
            catch_unwind(AssertUnwindSafe(|| node.node.eval(&cx)))
                .unwrap_or_else(|panic| Err(Panic(in_words(&*panic)).into()))
        };
        let last = self.last.get(&node.name);
        let reason = match last {
            None => "not computed before".to_owned(),
            Some(last) => parts.difference(&last.parts),
        };
        let values = match result {
            Ok(values) => values,
            Err(error) => {
                let reason = error.to_string();
                return self.without_value(node, State::Failed, reason, Some(error), true);
            }
        };
        let warnings = cx.warnings.into_inner().unwrap_or_else(|broken| broken.into_inner());
        let outcome = Arc::new(Outcome::new(values, warnings));
        self.cache.keep(key, outcome.clone());
        let mut trace = NodeTrace::new(node, State::Computed, reason);
        trace.seconds = start.elapsed().as_secs_f64();
        trace.bytes = outcome.bytes;
        trace.warnings.clone_from(&outcome.warnings);
        trace.unchanged = last.is_some_and(|last| {
            last.hashes.iter().copied().eq(outcome.values.iter().map(AnyValue::hash))
        });
        self.observer.finished(&trace);
        Done { outcome: Some(outcome), error: None, parts: Some(parts), trace, ran: true }
    }
}

/// Locks even if another thread panicked while it held the lock: what these locks guard is whole after every step.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(|broken| broken.into_inner())
}
