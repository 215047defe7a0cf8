//! Evaluates a graph: on demand, in parallel, each key once.
//!
//! What is computed from the same as the last time is known before anything runs (`plan`). The rest is visited in order: a
//! node's key is known before the node is run (`key`), so a result that is in the cache is never computed again. Nodes that do
//! not hang on each other run in parallel; a node that fails takes with it only what hangs on it.

use std::collections::HashSet;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard};

use maquette_graph::files::Known;
use maquette_graph::{Graph, GraphNode, GraphOutput, UnknownType};
use maquette_node::limit::NoRoom;
use maquette_node::pack::{Content, NewFile};
use maquette_node::provenance::Signature;
use maquette_node::{CancelToken, ReadError};
use maquette_syntax::error::in_words;
use maquette_syntax::error::{Error, Problem, Severity, code};
use maquette_value::{AnyValue, Hash};

mod cache;
mod compute;
mod disk;
mod guard;
mod key;
#[cfg(test)]
mod law;
mod memory;
mod plan;
mod run;
mod snapshot;
mod stage;
mod stubborn;
mod trace;
mod why;

use cache::{Cache, Values};
use compute::ChangedMeanwhile;
pub use disk::this_is_a_program;
pub use disk::{Diagnosis, Disk, DiskError, Fault, NodeSize, Sizes, Usage};
use guard::{Guards, NotAsWanted};
pub use maquette_remote::Exchange;
use plan::Plan;
use run::{News, Run};
use snapshot::Snapshot;
use trace::Reason;
pub use trace::{NodeTrace, RunTrace, State};
pub use why::Remembered;
pub use why::{Forecast, explanation};

/// Watches an evaluation from outside. All methods may be called from any thread.
pub trait Observer: Sync {
    /// An evaluation begins, in which so many nodes come to an end.
    fn planned(&self, count: usize) {
        let _ = count;
    }

    /// So many nodes need not be looked at: nothing that they depend on changed.
    fn unchanged(&self, count: usize) {
        let _ = count;
    }

    /// A node is being computed.
    fn started(&self, node: &str) {
        let _ = node;
    }

    /// A node has done this share (0 to 1) of its work.
    fn progress(&self, node: &str, share: f64) {
        let _ = (node, share);
    }

    /// The evaluation was told to stop some seconds ago, and this node, of this type of this pack, still runs.
    fn does_not_stop(&self, node: &str, kind: &str, pack: &str) {
        let _ = (node, kind, pack);
    }

    /// A node came to this end, after so many seconds of work.
    fn finished(&self, node: &str, state: State, seconds: f64) {
        let _ = (node, state, seconds);
    }
}

impl Observer for () {}

/// Evaluates graphs and remembers results between evaluations.
pub struct Evaluator {
    pool: Arc<rayon::ThreadPool>,
    cache: Cache,
    /// How many bytes results and nodes under way may hold together; none for a share of what the machine has left.
    most: Option<u64>,
    disk: Option<Arc<Disk>>,
    /// Whether results are put on disk.
    keeps: bool,
    /// Whether something was found since results were last put there.
    owes: bool,
    files: Known,
    guards: Guards,
    /// What the last evaluation found.
    last: Option<Arc<Snapshot>>,
    /// What happened on the way to the next evaluation.
    staged: stage::Staged,
    /// Whether the next evaluation believes nothing that is on disk.
    fresh: bool,
    /// Which share of the results that could come from the cache is computed all the same, and compared.
    verify: f64,
    /// The keys computed since the last evaluation ended, if results are verified: none is computed twice.
    verified: Mutex<HashSet<Hash>>,
}

/// The most threads that are started: more machines do not have, and thousands would be busy with each other alone.
pub(crate) const MOST_THREADS: usize = 1024;

/// No threads could be started.
#[derive(Debug, thiserror::Error)]
#[error("cannot start threads: {0}")]
pub struct ThreadsError(String);

impl ThreadsError {
    /// Refuses a number that no machine has.
    pub fn judge(threads: usize) -> Result<(), Self> {
        match threads {
            0..=MOST_THREADS => Ok(()),
            _ => Err(Self(format!(
                "{threads} are too many, there may be at most {MOST_THREADS}; 0 is as many as the machine has"
            ))),
        }
    }
}

/// Starts threads for evaluators: this many, 0 for as many as the machine has.
///
/// # Errors
/// If they cannot be started, or are too many.
pub fn start_threads(threads: usize) -> Result<Arc<rayon::ThreadPool>, ThreadsError> {
    ThreadsError::judge(threads)?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    pool.map(Arc::new).map_err(|error| ThreadsError(error.to_string()))
}

/// The result of one evaluation.
pub struct Evaluation {
    nodes: Arc<[GraphNode]>,
    wanted: Arc<[bool]>,
    found: Arc<Snapshot>,
    /// What happened to the nodes that are not as they were, in the graph's order.
    news: Vec<News>,
    /// The values of the nodes that were asked for, by node.
    values: Vec<(usize, Values)>,
    /// How long reading files took.
    files: f64,
}

impl Evaluation {
    /// What happened to each node that a wanted output needs, in the graph's order.
    pub fn trace(&self) -> RunTrace {
        let mut news = self.news.iter().peekable();
        let nodes = self.nodes.iter().enumerate().filter(|(index, _)| self.wanted[*index]);
        RunTrace(
            nodes
                .map(|(index, node)| {
                    let news = news.next_if(|news| news.index == index);
                    self.node_trace(index, node, news)
                })
                .collect(),
        )
    }

    fn node_trace(&self, index: usize, node: &GraphNode, news: Option<&News>) -> NodeTrace {
        let outcome = self.found.current(index).map(|done| &done.outcome);
        let reason = news.map_or(&Reason::Unchanged, |news| &news.reason);
        NodeTrace {
            name: node.name.clone(),
            node: node.kind().to_owned(),
            state: news.map_or(State::Cached, |news| news.state),
            unchanged: news.is_some_and(|news| news.unchanged),
            reason: reason.in_words(node, &self.nodes),
            start: news.map_or(0.0, |news| news.start),
            seconds: news.map_or(0.0, |news| news.seconds),
            thread: news.map_or(0, |news| news.thread),
            bytes: outcome.map_or(0, |outcome| outcome.bytes),
            estimate: news.and_then(|news| news.estimate),
            warnings: outcome.map_or(Vec::new(), |outcome| outcome.warnings.to_vec()),
        }
    }

    /// How long reading the files of nodes took, in seconds, on all threads together.
    pub fn seconds_of_files(&self) -> f64 {
        self.files
    }

    /// What failed, and what nodes have doubts about, at the nodes' places.
    pub fn problems(&self) -> Vec<Problem> {
        let mut problems = Vec::new();
        let mut news = self.news.iter().peekable();
        for (index, node) in self.nodes.iter().enumerate().filter(|(index, _)| self.wanted[*index])
        {
            if let Some(news) = news.next_if(|news| news.index == index) {
                // What the check has said is not said again: see `unknown`.
                let error = news.error.as_ref();
                let error = error.filter(|error| error.downcast::<UnknownType>().is_none());
                // Several nodes of a used graph may take the value that it does not want.
                let failure = error.map(|error| failure(node, error));
                problems.extend(failure.filter(|failure| !problems.contains(failure)));
                problems.extend(news.differs.then(|| difference(node)));
            }
            let outcome = self.found.current(index).map(|done| &done.outcome);
            for warning in outcome.iter().flat_map(|outcome| &outcome.warnings) {
                let message = format!("`{}`: {warning}", node.name);
                problems.push(node.problem(Severity::Warning, code::WARNING, message, ""));
            }
        }
        problems
    }

    /// The nodes of unknown types that something wanted hangs on, as the check tells of them.
    pub(crate) fn unknown(&self) -> impl Iterator<Item = Problem> {
        let errors = self.news.iter().filter_map(|news| news.error.as_ref());
        errors.filter_map(|error| error.downcast::<UnknownType>()?.0.clone())
    }

    /// Whether a node failed for want of memory, or because a file could not be read: it may succeed another time.
    pub(crate) fn may_pass(&self) -> bool {
        let mut errors = self.news.iter().filter_map(|news| news.error.as_ref());
        errors.any(|error| {
            error.downcast::<NoRoom>().is_some()
                || error.downcast::<ReadError>().is_some()
                || error.downcast::<ChangedMeanwhile>().is_some()
        })
    }

    /// The value of a node's output, both by their place in the graph, if it was asked for and computed.
    pub fn value(&self, node: usize, output: usize) -> Option<&AnyValue> {
        let place = self.values.binary_search_by_key(&node, |(node, _)| *node).ok()?;
        self.values[place].1.get(output)
    }

    /// The hash of the value of a node's output, if it has one.
    pub(crate) fn hash(&self, node: usize, output: usize) -> Option<Hash> {
        Some(self.found.current(node)?.outcome.outputs.get(output)?.1)
    }

    /// The value of a node's output by their names; the first output if `output` is empty. Nodes that were not asked for are
    /// not found.
    pub fn find(&self, graph: &Graph, node: &str, output: &str) -> Option<&AnyValue> {
        let (node, output) = match output {
            "" => graph.target(node)?,
            _ => graph.target(&format!("{node}.{output}"))?,
        };
        self.value(node, output)
    }

    /// The values that were asked for and computed, by node and output.
    pub(crate) fn by_place<'v>(&'v self) -> impl Fn(usize, usize) -> Option<&'v AnyValue> {
        |node, output| self.value(node, output)
    }

    /// The hashes of the files that a node has read; none for those that are not there.
    pub(crate) fn read_by(&self, node: usize) -> &[Option<Hash>] {
        self.found.current(node).map_or(&[], |done| &done.parts.files)
    }

    /// The files of one of the graph's outputs, which tell where they came from if that is known; none if its node failed.
    pub(crate) fn files(
        &self,
        output: &GraphOutput,
        signature: Option<&Signature>,
    ) -> Option<Result<Vec<NewFile>, Error>> {
        let file =
            |(name, content): (_, Content<'_>)| NewFile { name, bytes: content.into_bytes() };
        let files = self.contents(output, signature)?;
        Some(files.and_then(|files| or_panic(|| Ok(files.into_iter().map(file).collect()))))
    }

    /// The same by their names, large ones in pieces.
    pub(crate) fn contents(
        &self,
        output: &GraphOutput,
        signature: Option<&Signature>,
    ) -> Option<Result<Vec<(String, Content<'_>)>, Error>> {
        let value = self.value(output.node, output.output)?;
        let name = Path::new(&output.name).file_name()?.to_string_lossy().into_owned();
        Some(or_panic(|| output.format.contents(value, &name, signature)))
    }
}

/// What a node's or format's own code does; its panic is an error.
pub(crate) fn or_panic<T>(does: impl FnOnce() -> Result<T, Error>) -> Result<T, Error> {
    let done = catch_unwind(AssertUnwindSafe(does));
    done.unwrap_or_else(|panic| Err(Panic(in_words(&*panic)).into()))
}

fn failure(node: &GraphNode, error: &Error) -> Problem {
    if let Some(refused) = error.downcast::<NotAsWanted>() {
        return refused.problem(node);
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
        Some(_) => (code::PANIC, "this is a bug of the node; please report it with the graph"),
        None => (code::FAILED, ""),
    };
    node.problem(Severity::Error, code, message, help)
}

fn difference(node: &GraphNode) -> Problem {
    let message = format!("`{}` gave another result than the one in the cache", node.name);
    let help =
        "this is a bug of the node: equal inputs must give equal bytes; the new result is used";
    node.problem(Severity::Error, code::NOT_PURE, message, help)
}

/// A panic that was caught: our bug, or a plugin's.
#[derive(Clone, Debug, thiserror::Error)]
#[error("it panicked: {0}")]
struct Panic(String);

impl Evaluator {
    /// An evaluator with this many threads (0 to 1024; 0: as many as the machine has) and this many bytes of memory for results.
    ///
    /// # Errors
    /// If the threads cannot be started, or are too many.
    pub fn new(threads: usize, memory: usize) -> Result<Self, ThreadsError> {
        Ok(Self::on(start_threads(threads)?, memory))
    }

    /// An evaluator on threads that others may use, too.
    pub fn on(pool: Arc<rayon::ThreadPool>, memory: usize) -> Self {
        let (cache, files, guards) = (Cache::new(memory), Known::default(), Guards::default());
        let (disk, last) = (None, None);
        let (keeps, owes, fresh) = (true, false, false);
        let staged = stage::Staged::new();
        Self {
            pool,
            cache,
            most: None,
            disk,
            keeps,
            owes,
            files,
            guards,
            last,
            staged,
            fresh,
            verify: 0.0,
            verified: Mutex::default(),
        }
    }

    /// The same, with results kept on disk from one process to the next.
    #[must_use]
    pub fn with_disk(self, disk: Disk) -> Self {
        Self { disk: Some(Arc::new(disk)), ..self }
    }

    /// The same, computing this share (0 to 1) of the results that are in the cache all the same: a node whose result differs
    /// is an error.
    #[must_use]
    pub fn verifying(self, share: f64) -> Self {
        Self { verify: share, ..self }
    }

    /// Returns true if results in the cache are computed all the same.
    pub(crate) fn is_verifying(&self) -> bool {
        0.0 < self.verify
    }

    /// The same, with at most this many bytes for results and nodes under way together. Else it is nine tenths of what the machine,
    /// or the group of processes that this one is in, has left, where the system tells that.
    ///
    /// A node that says by [`Node::estimate`](maquette_node::Node::estimate) that it needs more fails before it begins; one for which
    /// others leave too little waits for them. Results that no node needs any more make way.
    #[must_use]
    pub fn holding_at_most(mut self, bytes: u64) -> Self {
        self.cache.set_limit(usize::try_from(bytes).unwrap_or(usize::MAX).min(self.cache.limit()));
        Self { most: Some(bytes), ..self }
    }

    /// The results on disk.
    pub fn disk(&self) -> Option<&Disk> {
        self.disk.as_deref()
    }

    /// From now on results may hold this many bytes; those used longest ago are dropped at once if they hold more.
    pub fn set_memory(&mut self, memory: usize) {
        self.cache.set_limit(memory);
    }

    /// Whether what is found from now on is put on disk; what is there is used in any case. What was not put there is as soon as
    /// results are put there again and it is a node's last one.
    pub(crate) fn keep_on_disk(&mut self, keep: bool) {
        self.keeps = keep;
    }

    /// Where results are put for other processes.
    fn shelf(&self) -> Option<&Arc<Disk>> {
        self.disk.as_ref().filter(|_| self.keeps)
    }

    /// How many bytes the results in memory are counted as.
    pub fn memory(&self) -> usize {
        self.cache.bytes()
    }

    /// The files that were read.
    pub(crate) fn known_files(&self) -> &Known {
        &self.files
    }

    /// Runs something on the evaluator's threads.
    pub fn install<R: Send>(&self, work: impl FnOnce() -> R + Send) -> R {
        self.pool.install(work)
    }

    /// Drops every result in memory; what is on disk stays, but the next evaluation does not use it.
    pub fn forget(&mut self) {
        self.cache.clear();
        self.last = None;
        self.fresh = true;
    }

    /// What is known of these nodes before anything is evaluated: of those that are as they were.
    pub(crate) fn foreseen(&mut self, graph: &Graph, nodes: &[usize]) -> Foreseen {
        self.recall(graph);
        Foreseen(Plan::new(self, graph, nodes, &[]).known)
    }

    /// Evaluates what these nodes, by their place in the graph, need. The values of the nodes `values` are wanted afterwards.
    pub(crate) fn evaluate(
        &mut self,
        graph: &Graph,
        roots: &[usize],
        values: &[usize],
        observer: &dyn Observer,
        cancel: &CancelToken,
    ) -> Evaluation {
        let mut evaluation = self.evaluate_alone(graph, roots, values, observer, cancel);
        evaluation.take_over(graph, std::mem::take(&mut self.staged));
        lock(&self.verified).clear();
        evaluation
    }

    fn evaluate_alone(
        &mut self,
        graph: &Graph,
        roots: &[usize],
        values: &[usize],
        observer: &dyn Observer,
        cancel: &CancelToken,
    ) -> Evaluation {
        self.recall(graph);
        let plan = Plan::new(self, graph, roots, values);
        observer.planned(plan.wanted.iter().filter(|wanted| **wanted).count());
        observer.unchanged(plan.unchanged());
        let run = Run::new(self, graph, &plan, values, observer, cancel);
        let needs_threads = plan.has_work() || !run.has_values(values);
        let values = match needs_threads {
            true => run.told_of_stubborn_nodes(|| {
                self.pool.install(|| {
                    rayon::scope(|scope| run.start(scope));
                    run.values_of(values)
                })
            }),
            false => run.values_of(values),
        };
        let files = run.files.seconds();
        let (visited, news) = run.end();
        let found = plan.known.after(visited, &plan.wanted, graph, self.last.as_ref());
        self.fresh = false;
        let is_new = self.last.as_ref().is_none_or(|last| !Arc::ptr_eq(last, &found));
        self.last = Some(found.clone());
        self.owes |= is_new;
        if let Some(disk) = self.shelf().filter(|_| self.owes) {
            found.settle(disk);
            disk.keep_snapshot(&found, self.files.of(graph.files()));
            self.owes = false;
        }
        let (nodes, wanted) = (graph.nodes().clone(), plan.wanted);
        Evaluation { nodes, wanted, found, news, values, files }
    }

    /// The results on disk, if they may be believed.
    fn known_results(&self) -> Option<&Arc<Disk>> {
        self.disk.as_ref().filter(|_| !self.fresh)
    }

    /// What the last process found of the graph, if this one does not know better.
    fn recall(&mut self, graph: &Graph) {
        let name = &graph.source().name;
        if self.last.as_ref().is_some_and(|last| last.graph == *name) {
            return;
        }
        // The results of another graph are as true, and may be of use.
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

    /// Evaluates what the nodes of these names need; names that the graph does not have are left out.
    pub fn evaluate_nodes(&mut self, graph: &Graph, names: &[&str]) -> Evaluation {
        let wanted: Vec<_> = names.iter().flat_map(|name| graph.nodes_of(name)).collect();
        self.evaluate(graph, &wanted, &wanted, &(), &CancelToken::default())
    }

    /// Evaluates every node of a graph, those that no output needs included.
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

/// What is known of nodes before they are evaluated.
pub(crate) struct Foreseen(plan::Known);

impl Foreseen {
    /// The hash of the value of a node's output, if it is as it was.
    pub(crate) fn hash(&self, node: usize, output: usize) -> Option<Hash> {
        Some(self.0.get(node)?.outcome.outputs.get(output)?.1)
    }

    /// As [`Evaluation::read_by`].
    pub(crate) fn read_by(&self, node: usize) -> &[Option<Hash>] {
        self.0.get(node).map_or(&[], |done| &done.parts.files)
    }
}

/// Locks even if another thread panicked while it held the lock: what these locks guard is whole after every step.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(|broken| broken.into_inner())
}
