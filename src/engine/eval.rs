//! Evaluates graphs on demand and in parallel. Each result is computed once.
//!
//! `plan` finds the nodes whose inputs have not changed; these nodes need no work. The other nodes are visited after their dependencies. A
//! result is cached under its key, a hash of everything from which it is computed (`key`). The key is known before the node runs, so a
//! cached result is not computed again. Independent nodes run in parallel. If a node fails, only the nodes that depend on it fail, too.

use std::collections::HashSet;
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard};

use maquette_graph::files::KnownFiles;
use maquette_graph::{Graph, GraphNode, GraphOutput, UnknownType};
use maquette_node::budget::MemoryError;
use maquette_node::pack::{Content, NewFile};
use maquette_node::provenance::Signature;
use maquette_node::{CancelToken, ReadError};
use maquette_syntax::error::{Diagnostic, Error, Severity, code};
use maquette_value::{AnyValue, Hash};

mod blocks;
mod cache;
mod compute;
mod disk;
mod fitting_size;
mod guard;
mod key;
#[cfg(test)]
mod law;
mod memory;
pub mod needs;
mod panics;
mod plan;
mod preflight;
mod run;
mod snapshot;
mod streamed;
mod timing;
mod trace;
mod watchdog;
mod why;

use cache::{Cache, Values};
use compute::FileChangedError;
pub use disk::this_is_a_program;
pub use disk::{CacheFault, Diagnosis, Disk, DiskError, NodeSize, Sizes, Usage};
use guard::{Guards, UnmetRequirement};
pub use maquette_remote::RequestCounts;
use panics::Panic;
pub(crate) use panics::catch_panic;
use plan::Plan;
use run::{NodeEvent, Run};
use snapshot::Snapshot;
use streamed::BlockOptions;
use trace::Reason;
pub use trace::{NodeTrace, RunTrace, State};
pub use why::LastResult;
pub use why::{Forecast, explanation};

/// Receives the progress of an evaluation. All methods may be called from any thread.
pub trait Observer: Sync {
    /// Called once when an evaluation begins. `count` is the number of nodes that the evaluation needs.
    fn on_plan(&self, count: usize) {
        let _ = count;
    }

    /// Called once with the number of nodes that need no work, because neither they nor their dependencies have changed.
    fn on_unchanged(&self, count: usize) {
        let _ = count;
    }

    /// Called when a node starts to run.
    fn on_start(&self, node: &str) {
        let _ = node;
    }

    /// Called while a node runs. `fraction` is the fraction of its work that is done, from 0 to 1.
    fn on_progress(&self, node: &str, fraction: f64) {
        let _ = (node, fraction);
    }

    /// Called if a node still runs some seconds after the evaluation was cancelled. `kind` is the type of the node, and `pack` is the name
    /// of the pack that defines the type.
    fn on_unresponsive(&self, node: &str, kind: &str, pack: &str) {
        let _ = (node, kind, pack);
    }

    /// Called when a node is finished. `seconds` is the time for which it ran.
    fn on_finish(&self, node: &str, state: State, seconds: f64) {
        let _ = (node, state, seconds);
    }
}

impl Observer for () {}

/// Evaluates graphs and keeps results from one evaluation to the next.
pub struct Evaluator {
    pool: Arc<rayon::ThreadPool>,
    cache: Cache,
    /// The maximum number of bytes for results and running nodes together. If it is `None`, a fraction of the machine's free memory is
    /// used.
    max_bytes: Option<u64>,
    disk: Option<Arc<Disk>>,
    /// True if new results are written to disk.
    writes_to_disk: bool,
    /// True if the last evaluation changed results that have not been written to disk yet.
    has_unsaved: bool,
    files: KnownFiles,
    guards: Guards,
    /// The results of the last evaluation, in this process or an earlier one. `None` before the first evaluation.
    last: Option<Arc<Snapshot>>,
    /// Events of nodes that ran in a preflight evaluation (see `preflight`). The next evaluation reports them as its own.
    preflight_events: preflight::PreflightEvents,
    /// True if the next evaluation ignores the results on disk.
    ignores_disk: bool,
    /// The fraction (0 to 1) of cached results that is computed again and compared with the cache.
    verified_fraction: f64,
    blocks: BlockOptions,
    /// If cached results are verified: the keys of the results that were computed since the last evaluation ended. A result with one of
    /// these keys is not verified again.
    verified: Mutex<HashSet<Hash>>,
}

/// The maximum number of threads, far more than useful on any machine. Thousands of threads would only slow each other down.
pub(crate) const MAX_THREADS: usize = 1024;

/// The error that threads could not be started.
#[derive(Debug, thiserror::Error)]
#[error("cannot start threads: {0}")]
pub struct ThreadsError(String);

impl ThreadsError {
    /// Checks that the number of threads is at most `MAX_THREADS`.
    pub fn check(threads: usize) -> Result<(), Self> {
        match threads {
            0..=MAX_THREADS => Ok(()),
            _ => Err(Self(format!(
                "{threads} are too many, there may be at most {MAX_THREADS}; 0 is as many as the machine has"
            ))),
        }
    }
}

/// Starts a pool of `threads` threads for evaluators; 0 means one thread per processor.
///
/// # Errors
/// If the threads cannot be started, or `threads` exceeds `MAX_THREADS`.
pub fn start_threads(threads: usize) -> Result<Arc<rayon::ThreadPool>, ThreadsError> {
    ThreadsError::check(threads)?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    pool.map(Arc::new).map_err(|error| ThreadsError(error.to_string()))
}

/// The result of one evaluation.
pub struct Evaluation {
    nodes: Arc<[GraphNode]>,
    wanted: Arc<[bool]>,
    snapshot: Arc<Snapshot>,
    /// The events of all nodes that had to be visited because they or their dependencies have changed, in the order of the graph.
    events: Vec<NodeEvent>,
    /// The values of the requested nodes, sorted by the index of the node.
    values: Vec<(usize, Values)>,
    /// The time spent reading the input files of nodes, in seconds, summed over all threads.
    files: f64,
}

impl Evaluation {
    /// Returns the trace of all nodes that the evaluation needed, in the order of the graph.
    pub fn trace(&self) -> RunTrace {
        let mut events = self.events.iter().peekable();
        let nodes = self.nodes.iter().enumerate().filter(|(index, _)| self.wanted[*index]);
        RunTrace(
            nodes
                .map(|(index, node)| {
                    let event = events.next_if(|event| event.index == index);
                    self.node_trace(index, node, event)
                })
                .collect(),
        )
    }

    fn node_trace(&self, index: usize, node: &GraphNode, event: Option<&NodeEvent>) -> NodeTrace {
        let outcome = self.snapshot.current(index).map(|done| &done.outcome);
        let reason = event.map_or(&Reason::Unchanged, |event| &event.reason);
        NodeTrace {
            name: node.name.clone(),
            node: node.kind().to_owned(),
            state: event.map_or(State::Cached, |event| event.state),
            unchanged: event.is_some_and(|event| event.unchanged),
            reason: reason.in_words(node, &self.nodes),
            start: event.map_or(0.0, |event| event.start),
            seconds: event.map_or(0.0, |event| event.seconds),
            thread: event.map_or(0, |event| event.thread),
            bytes: outcome.map_or(0, |outcome| outcome.bytes),
            estimate: event.and_then(|event| event.estimate),
            warnings: outcome.map_or(Vec::new(), |outcome| outcome.warnings.to_vec()),
        }
    }

    /// Returns the time spent reading the input files of nodes, in seconds, summed over all threads.
    pub fn seconds_of_files(&self) -> f64 {
        self.files
    }

    /// Returns the errors and warnings of all nodes, in the order of the graph.
    pub fn diagnostics(&self) -> Vec<Diagnostic> {
        let mut diagnostics = Vec::new();
        let mut events = self.events.iter().peekable();
        for (index, node) in self.nodes.iter().enumerate().filter(|(index, _)| self.wanted[*index])
        {
            if let Some(event) = events.next_if(|event| event.index == index) {
                // Skip unknown node types: the check of the graph has already reported them, see `unknown_types`.
                let error = event.error.as_ref();
                let error = error.filter(|error| error.downcast::<UnknownType>().is_none());
                // Report an invalid input value only once, even if several nodes of a used graph report it.
                let failure = error.map(|error| failure(node, error));
                diagnostics.extend(failure.filter(|failure| !diagnostics.contains(failure)));
                diagnostics.extend(event.differs.then(|| difference(node)));
            }
            let outcome = self.snapshot.current(index).map(|done| &done.outcome);
            for warning in outcome.iter().flat_map(|outcome| &outcome.warnings) {
                let message = format!("`{}`: {warning}", node.name);
                diagnostics.push(node.diagnostic(Severity::Warning, code::WARNING, message, ""));
            }
        }
        diagnostics
    }

    /// Returns an error for each node of unknown type on which a requested node depends. The check of a graph reports the same errors.
    pub(crate) fn unknown_types(&self) -> impl Iterator<Item = Diagnostic> {
        let errors = self.events.iter().filter_map(|event| event.error.as_ref());
        errors.filter_map(|error| error.downcast::<UnknownType>()?.0.clone())
    }

    /// Returns true if a node failed because memory was short or a file could not be read. The same evaluation may then succeed later.
    pub(crate) fn may_succeed_later(&self) -> bool {
        let mut errors = self.events.iter().filter_map(|event| event.error.as_ref());
        errors.any(|error| {
            error.downcast::<MemoryError>().is_some()
                || error.downcast::<ReadError>().is_some()
                || error.downcast::<FileChangedError>().is_some()
        })
    }

    /// Returns the value of the output with index `output` of the node with index `node`. Returns `None` if the value was not requested or
    /// not computed.
    pub fn value(&self, node: usize, output: usize) -> Option<&AnyValue> {
        let place = self.values.binary_search_by_key(&node, |(node, _)| *node).ok()?;
        self.values[place].1.get(output)
    }

    /// Returns the hash of the value of a node's output, or `None` if the node has no result.
    pub(crate) fn hash(&self, node: usize, output: usize) -> Option<Hash> {
        Some(self.snapshot.current(node)?.outcome.outputs.get(output)?.1)
    }

    /// Returns the value of the output `output` of the node named `node`. If `output` is empty, returns the first output. Returns `None` if
    /// the node was not requested.
    pub fn find(&self, graph: &Graph, node: &str, output: &str) -> Option<&AnyValue> {
        let (node, output) = match output {
            "" => graph.target(node)?,
            _ => graph.target(&format!("{node}.{output}"))?,
        };
        self.value(node, output)
    }

    /// Returns a function that looks up requested values by the indices of node and output.
    pub(crate) fn values_by_output<'v>(&'v self) -> impl Fn(usize, usize) -> Option<&'v AnyValue> {
        |node, output| self.value(node, output)
    }

    /// Returns the hashes of the files that a node has read, in the order of the node's file parameters. A missing file is `None`.
    pub(crate) fn files_read_by(&self, node: usize) -> &[Option<Hash>] {
        self.snapshot.current(node).map_or(&[], |done| &done.parts.files)
    }

    /// Returns the files in which an output of the graph is stored. If a `signature` is given, it is written into the files. Returns `None`
    /// if the node of the output failed.
    pub(crate) fn files(
        &self,
        output: &GraphOutput,
        signature: Option<&Signature>,
    ) -> Option<Result<Vec<NewFile>, Error>> {
        let contents = self.contents(output, signature)?;
        Some(contents.and_then(|contents| {
            catch_panic(|| {
                let files = contents.into_iter();
                Ok(files
                    .map(|(name, content)| NewFile { name, bytes: content.into_bytes() })
                    .collect())
            })
        }))
    }

    /// Returns the contents of the files of an output, by file name. The content of a large file is divided into pieces. Returns `None` if
    /// the node of the output failed.
    pub(crate) fn contents(
        &self,
        output: &GraphOutput,
        signature: Option<&Signature>,
    ) -> Option<Result<Vec<(String, Content<'_>)>, Error>> {
        let value = self.value(output.node, output.output)?;
        let name = Path::new(&output.name).file_name()?.to_string_lossy().into_owned();
        Some(catch_panic(|| output.format.contents(value, &name, signature)))
    }
}

fn failure(node: &GraphNode, error: &Error) -> Diagnostic {
    if let Some(refused) = error.downcast::<UnmetRequirement>() {
        return refused.diagnostic(node);
    }
    let unread = error.downcast::<ReadError>();
    let missing = unread.and_then(|unread| {
        let file = node.files.iter().find(|file| file.given == unread.name);
        file?.missing.as_deref()
    });
    if let Some(missing) = missing {
        return missing.clone();
    }
    let message = format!("`{}` cannot be computed: {error}", node.name);
    let (code, help) = match error.downcast::<Panic>() {
        Some(_) => (code::PANIC, "this is a bug in the node; report it with the graph"),
        None => (code::FAILED, ""),
    };
    node.diagnostic(Severity::Error, code, message, help)
}

fn difference(node: &GraphNode) -> Diagnostic {
    let message = format!("`{}` gave another result than the one in the cache", node.name);
    let help =
        "this is a bug in the node: equal inputs must give equal bytes; the new result is used";
    node.diagnostic(Severity::Error, code::NOT_PURE, message, help)
}

impl Evaluator {
    /// Creates an evaluator with `threads` threads (0 to 1024; 0 for one per processor) and at most `memory` bytes of cached results.
    ///
    /// # Errors
    /// If the threads cannot be started, or `threads` exceeds the maximum.
    pub fn new(threads: usize, memory: usize) -> Result<Self, ThreadsError> {
        Ok(Self::with_threads(start_threads(threads)?, memory))
    }

    /// Creates an evaluator that runs on the threads of `pool`. Several evaluators can share a pool.
    pub fn with_threads(pool: Arc<rayon::ThreadPool>, memory: usize) -> Self {
        let (cache, files, guards) = (Cache::new(memory), KnownFiles::default(), Guards::default());
        let (disk, last) = (None, None);
        let (writes_to_disk, has_unsaved, ignores_disk) = (true, false, false);
        let preflight_events = preflight::PreflightEvents::new();
        Self {
            pool,
            cache,
            max_bytes: None,
            disk,
            writes_to_disk,
            has_unsaved,
            files,
            guards,
            last,
            preflight_events,
            ignores_disk,
            verified_fraction: 0.0,
            blocks: BlockOptions::default(),
            verified: Mutex::default(),
        }
    }

    /// Adds a disk cache, which keeps results from one process to the next.
    #[must_use]
    pub fn with_disk(self, disk: Disk) -> Self {
        Self { disk: Some(Arc::new(disk)), ..self }
    }

    /// Sets the fraction (0 to 1) of cached results that is computed again and compared with the cache. A different result is reported as
    /// an error.
    #[must_use]
    pub fn with_verification(self, fraction: f64) -> Self {
        Self { verified_fraction: fraction, ..self }
    }

    /// Returns true if a fraction of the cached results is computed again and compared with the cache.
    pub(crate) fn is_verifying(&self) -> bool {
        0.0 < self.verified_fraction
    }

    /// Limits the memory of results and running nodes together, in bytes. The default is nine tenths of the free memory of the machine or
    /// of this process's control group (cgroup). Systems that do not report their free memory have no default limit.
    ///
    /// A node whose [`Node::estimate`](maquette_node::Node::estimate) exceeds the limit fails before it runs. If running nodes leave too
    /// little memory for a node, the node waits for them. Results that no other node needs are dropped to make room.
    #[must_use]
    pub fn with_max_memory(mut self, bytes: u64) -> Self {
        self.cache.set_limit(usize::try_from(bytes).unwrap_or(usize::MAX).min(self.cache.limit()));
        Self { max_bytes: Some(bytes), ..self }
    }

    /// Reads files of points with at least `min_file_size` bytes in blocks of `block_len` points, if the nodes allow it. The results do not
    /// depend on it.
    #[doc(hidden)]
    #[must_use]
    pub fn with_blocks(self, min_file_size: u64, block_len: usize) -> Self {
        Self { blocks: BlockOptions { min_file_size, block_len }, ..self }
    }

    /// Returns the disk cache, or `None` if results are kept only in memory.
    pub fn disk(&self) -> Option<&Disk> {
        self.disk.as_deref()
    }

    /// Sets the maximum size of the results in memory, in bytes. If the results are larger, the least recently used ones are dropped at
    /// once.
    pub fn set_memory(&mut self, memory: usize) {
        self.cache.set_limit(memory);
    }

    /// Sets whether new results are written to disk. Results that are already on disk are used in any case. When writing is turned on
    /// again, the next evaluation also writes results that were computed in the meantime, if they are still the last results of their
    /// nodes.
    pub(crate) fn set_keeping_on_disk(&mut self, keep: bool) {
        self.writes_to_disk = keep;
    }

    /// Returns the disk cache, or `None` if new results are not written to disk.
    fn writable_disk(&self) -> Option<&Arc<Disk>> {
        self.disk.as_ref().filter(|_| self.writes_to_disk)
    }

    /// Returns the size of the results in memory, in bytes.
    pub fn memory(&self) -> usize {
        self.cache.bytes()
    }

    /// Returns the hashes of the files that nodes have read.
    pub(crate) fn known_files(&self) -> &KnownFiles {
        &self.files
    }

    /// Runs a closure on the evaluator's threads and returns its result.
    pub fn install<R: Send>(&self, work: impl FnOnce() -> R + Send) -> R {
        self.pool.install(work)
    }

    /// Drops all results in memory. Results on disk stay, but the next evaluation ignores them.
    pub fn forget(&mut self) {
        self.cache.clear();
        self.last = None;
        self.ignores_disk = true;
    }

    /// Returns the results of those nodes in `nodes` that have not changed since they were computed. Nothing is evaluated.
    pub(crate) fn predict(&mut self, graph: &Graph, nodes: &[usize]) -> Prediction {
        self.recall(graph);
        Prediction(Plan::new(self, graph, nodes, &[]).known)
    }

    /// Evaluates the nodes in `roots` and all their dependencies. Returns the values of the nodes in `values`. All nodes are given by
    /// index.
    pub(crate) fn evaluate(
        &mut self,
        graph: &Graph,
        roots: &[usize],
        values: &[usize],
        observer: &dyn Observer,
        cancel: &CancelToken,
    ) -> Evaluation {
        let mut evaluation = self.evaluate_once(graph, roots, values, observer, cancel);
        evaluation.merge_preflight(graph, std::mem::take(&mut self.preflight_events));
        lock(&self.verified).clear();
        evaluation
    }

    fn evaluate_once(
        &mut self,
        graph: &Graph,
        roots: &[usize],
        values: &[usize],
        observer: &dyn Observer,
        cancel: &CancelToken,
    ) -> Evaluation {
        self.recall(graph);
        let plan = Plan::new(self, graph, roots, values);
        observer.on_plan(plan.wanted.iter().filter(|wanted| **wanted).count());
        observer.on_unchanged(plan.unchanged_count());
        let run = Run::new(self, graph, &plan, values, observer, cancel);
        let needs_threads = plan.has_work() || !run.has_values(values);
        let values = match needs_threads {
            true => run.run_with_watchdog(|| {
                self.pool.install(|| {
                    rayon::scope(|scope| run.start(scope));
                    run.values_of(values)
                })
            }),
            false => run.values_of(values),
        };
        let files = run.files.seconds();
        let (visited, events) = run.into_results();
        let found = plan.known.into_snapshot(visited, &plan.wanted, graph, self.last.as_ref());
        self.ignores_disk = false;
        let is_new = self.last.as_ref().is_none_or(|last| !Arc::ptr_eq(last, &found));
        self.last = Some(found.clone());
        self.has_unsaved |= is_new;
        if let Some(disk) = self.writable_disk().filter(|_| self.has_unsaved) {
            found.save_unsaved(disk);
            disk.keep_snapshot(&found, self.files.get_all(graph.files()));
            found.keep_timings(&events, graph, disk);
            self.has_unsaved = false;
        }
        let (nodes, wanted) = (graph.nodes().clone(), plan.wanted);
        Evaluation { nodes, wanted, snapshot: found, events, values, files }
    }

    /// Returns the disk cache if this evaluation may use results from it, otherwise `None`.
    fn known_results(&self) -> Option<&Arc<Disk>> {
        self.disk.as_ref().filter(|_| !self.ignores_disk)
    }

    /// Loads the results of the last evaluation of this graph by an earlier process, unless this process has already evaluated the graph.
    fn recall(&mut self, graph: &Graph) {
        let name = &graph.source().name;
        if self.last.as_ref().is_some_and(|last| last.graph == *name) {
            return;
        }
        // Add to `files` instead of clearing it: facts about files that other graphs read stay valid and may be reused.
        if let Some((snapshot, files)) = self.known_results().and_then(|disk| disk.snapshot(name)) {
            self.last = Some(Arc::new(snapshot));
            self.files.extend(files);
        }
    }

    /// Evaluates all outputs of a graph.
    pub fn evaluate_all(&mut self, graph: &Graph) -> Evaluation {
        let wanted: Vec<usize> = graph.outputs().iter().map(|output| output.node).collect();
        self.evaluate(graph, &wanted, &wanted, &(), &CancelToken::default())
    }

    /// Evaluates the nodes with the given names and all their dependencies. Names that the graph does not contain are skipped.
    pub fn evaluate_nodes(&mut self, graph: &Graph, names: &[&str]) -> Evaluation {
        let wanted: Vec<_> = names.iter().flat_map(|name| graph.nodes_of(name)).collect();
        self.evaluate(graph, &wanted, &wanted, &(), &CancelToken::default())
    }

    /// Evaluates every node of a graph, including nodes that no output needs.
    pub fn evaluate_all_nodes(
        &mut self,
        graph: &Graph,
        observer: &dyn Observer,
        cancel: &CancelToken,
    ) -> Evaluation {
        let all: Vec<usize> = (0..graph.nodes().len()).collect();
        self.evaluate(graph, &all, &all, observer, cancel)
    }
}

/// The results that are known before an evaluation runs, because their nodes have not changed.
pub(crate) struct Prediction(plan::KnownResults);

impl Prediction {
    /// Returns the hash of the value of a node's output, or `None` if the node has changed.
    pub(crate) fn hash(&self, node: usize, output: usize) -> Option<Hash> {
        Some(self.0.get(node)?.outcome.outputs.get(output)?.1)
    }

    /// Returns the hashes of the files that a node has read, in the order of the node's file parameters. A missing file is `None`.
    pub(crate) fn files_read_by(&self, node: usize) -> &[Option<Hash>] {
        self.0.get(node).map_or(&[], |done| &done.parts.files)
    }
}

/// Locks a mutex even if another thread panicked while holding it. This is safe because the data behind these mutexes is consistent after
/// every step.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(|broken| broken.into_inner())
}
