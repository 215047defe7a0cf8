//! A running evaluation. It visits all nodes that have a task, each after its dependencies.

use std::collections::{BTreeSet, HashMap};
use std::hash::BuildHasherDefault;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, OnceLock};
use std::time::Instant;

use maquette_graph::files::Reads;
use maquette_graph::{ELEMENTS, Graph, GraphNode};
use maquette_node::CancelToken;
use maquette_syntax::error::Error;
use maquette_value::parallel::detached;
use maquette_value::{AnyValue, Hash};

use super::cache::{FirstBytes, Outcome, Values};
use super::compute::LoadedFiles;
use super::key::Parts;
use super::memory::Memory;
use super::plan::{Plan, Task};
use super::snapshot::{NodeRecord, VisitedNodes};
use super::streamed::streamed_nodes;
use super::trace::Reason;
use super::{Evaluator, Observer, State, lock};

/// The outcome of a node's visit, for the trace and the diagnostics.
pub(super) struct NodeEvent {
    pub(super) index: usize,
    pub(super) state: State,
    pub(super) reason: Reason,
    pub(super) unchanged: bool,
    /// True if the result was computed again for verification and differs from the cached one.
    pub(super) differs: bool,
    pub(super) error: Option<Error>,
    /// The node's own estimate of the memory that it needs, in bytes. `None` if it gives no estimate.
    pub(super) estimate: Option<f64>,
    pub(super) start: f64,
    pub(super) seconds: f64,
    pub(super) thread: usize,
}

impl NodeEvent {
    pub(super) fn new(index: usize, state: State, reason: Reason) -> Self {
        let (unchanged, differs, error, estimate) = (false, false, None, None);
        Self {
            index,
            state,
            reason,
            unchanged,
            differs,
            error,
            estimate,
            start: 0.0,
            seconds: 0.0,
            thread: 0,
        }
    }
}

pub(super) struct Run<'a> {
    pub(super) evaluator: &'a Evaluator,
    pub(super) graph: &'a Graph,
    pub(super) plan: &'a Plan,
    pub(super) observer: &'a dyn Observer,
    pub(super) cancel: &'a CancelToken,
    pub(super) start: Instant,
    pub(super) files: Reads<'a>,
    /// For each node, the index of its slot in `slots`, or [`NO_SLOT`] if the node has no task.
    slot_indices: Vec<u32>,
    pub(super) slots: Vec<Slot>,
    pub(super) events: Mutex<Vec<NodeEvent>>,
    pub(super) memory: Memory,
    /// For each node, true if its points are streamed; empty if none are.
    pub(super) streamed: Vec<bool>,
    /// The nodes that are running at present.
    pub(super) running: Mutex<BTreeSet<usize>>,
    /// The keys whose results are being computed. Each has a list of other nodes with that key, which wait for the result.
    in_flight: Mutex<HashMap<Hash, Vec<usize>, BuildHasherDefault<FirstBytes>>>,
}

/// The state of a node that has a task.
#[derive(Default)]
pub(super) struct Slot {
    node: usize,
    /// The number of links to nodes that are not finished yet. The node is visited when it becomes 0.
    waiting: AtomicUsize,
    /// The result of the node; empty until the node is finished. The inner `None` means that the node failed.
    pub(super) result: OnceLock<Option<Arc<NodeRecord>>>,
    /// True if this node or one of its dependencies ran.
    ran: AtomicBool,
    /// True if this node or one of its dependencies has a result that no machine has stored before. Then the results of all nodes that
    /// depend on it are also new to every machine.
    is_new: AtomicBool,
    /// The values of the node, kept in memory while other nodes need them.
    pub(super) held: Mutex<Option<Values>>,
    /// The number of links that still need the values, plus one if the caller of the evaluation requested them.
    pub(super) users: AtomicUsize,
}

/// Returns the size of values, in bytes.
pub(super) fn size(values: &Values) -> u64 {
    values.iter().map(AnyValue::size).sum::<usize>() as u64
}

/// The slot index of a node without a task.
const NO_SLOT: u32 = u32::MAX;

impl<'a> Run<'a> {
    pub(super) fn new(
        evaluator: &'a Evaluator,
        graph: &'a Graph,
        plan: &'a Plan,
        values: &[usize],
        observer: &'a dyn Observer,
        cancel: &'a CancelToken,
    ) -> Self {
        let tasks = &plan.tasks[..];
        let mut slot_indices = Vec::new();
        let mut slots: Vec<Slot> = Vec::new();
        if plan.has_work() {
            slot_indices.resize(tasks.len(), NO_SLOT);
            for node in (0..tasks.len()).filter(|&node| tasks[node] != Task::None) {
                slot_indices[node] = slots.len() as u32;
                // The slots of the dependencies exist already, because a node comes after its dependencies.
                let links = graph.topology().sources(node).map(|source| slot_indices[source]);
                let mut waiting = 0;
                for place in links.filter(|&place| place != NO_SLOT) {
                    *slots[place as usize].users.get_mut() += 1;
                    waiting += 1;
                }
                slots.push(Slot { node, waiting: waiting.into(), ..Slot::default() });
            }
        }
        let run = Self {
            evaluator,
            graph,
            plan,
            observer,
            cancel,
            start: Instant::now(),
            files: Reads::new(&evaluator.files, graph.readers()),
            slot_indices,
            slots,
            events: Mutex::default(),
            memory: Memory::new(evaluator.max_bytes),
            streamed: streamed_nodes(graph, &plan.wanted, values, evaluator.blocks),
            running: Mutex::default(),
            in_flight: Mutex::default(),
        };
        for slot in values.iter().filter_map(|&node| run.slot(node)) {
            slot.users.fetch_add(1, Ordering::Relaxed);
        }
        run
    }

    /// Returns the slot of a node; `None` if the node has no task.
    pub(super) fn slot(&self, node: usize) -> Option<&Slot> {
        let place = *self.slot_indices.get(node)?;
        self.slots.get(place as usize)
    }

    pub(super) fn start<'s>(&'s self, scope: &rayon::Scope<'s>) {
        // Collect all ready nodes before the first one runs. A node that becomes ready later is visited right after the last node for which
        // it waited, and must not be visited twice.
        let ready: Vec<_> =
            self.slots.iter().filter(|slot| slot.waiting.load(Ordering::Relaxed) == 0).collect();
        self.memory.add_visits(ready.len());
        for slot in ready {
            scope.spawn(move |scope| detached(|| self.visit(slot.node, scope)));
        }
    }

    /// Visits a node, and then those nodes for which it was the last unfinished dependency.
    fn visit<'s>(&'s self, index: usize, scope: &rayon::Scope<'s>) {
        let mut next = Some(index);
        // Of the nodes that become ready, visit one on this thread. This saves the cost of a new task in long chains, which are common. In
        // this depth-first order, values are used and dropped soon after they are computed.
        while let Some(index) = next.take() {
            let Some((done, mut ready)) = self.run_node(index) else {
                next = self.memory.end_visit();
                continue;
            };
            if let Some(slot) = self.slot(index) {
                let _ = slot.result.set(done);
            }
            self.release_inputs(index);
            let users = self.graph.topology().users(index);
            for user in users.filter_map(|user| self.slot(user)) {
                if user.waiting.fetch_sub(1, Ordering::AcqRel) == 1 {
                    ready.push(user.node);
                }
            }
            ready.extend(self.memory.finish_node(index, &self.evaluator.cache));
            next = ready.pop();
            self.memory.add_visits(ready.len());
            for other in ready {
                scope.spawn(move |scope| detached(|| self.visit(other, scope)));
            }
            next = next.or_else(|| self.memory.end_visit());
        }
    }

    /// Drops those input values of a finished node that no other node needs.
    fn release_inputs(&self, index: usize) {
        let links = self.graph.nodes()[index].links.iter();
        for slot in links.filter_map(|link| self.slot(link.node)) {
            if slot.users.fetch_sub(1, Ordering::AcqRel) == 1
                && let Some(values) = lock(&slot.held).take()
            {
                self.memory.release(size(&values));
            }
        }
    }

    /// Returns the result of a node, or `None` if it is not known or the node failed. After the node's visit, this is the result of the
    /// visit. Before, it is the result that the plan knows, if the node is only restored or verified. It may be needed before the visit:
    /// another process may have dropped the values of a node without a task, and computing them again needs the results of its
    /// dependencies.
    pub(super) fn result_of(&self, index: usize) -> Option<&Arc<NodeRecord>> {
        let found = self.slot(index).and_then(|slot| slot.result.get());
        match found {
            Some(found) => found.as_ref(),
            None => self.plan.known.get(index),
        }
    }

    fn has_run(&self, index: usize) -> bool {
        self.slot(index).is_some_and(|slot| slot.ran.load(Ordering::Acquire))
    }

    pub(super) fn set_ran(&self, index: usize, ran: bool) {
        if let Some(slot) = self.slot(index) {
            slot.ran.store(ran, Ordering::Release);
        }
    }

    /// Returns true if a dependency of the node has a result that no machine has stored before.
    fn has_new_input(&self, node: &GraphNode) -> bool {
        let mut slots = node.links.iter().filter_map(|link| self.slot(link.node));
        slots.any(|slot| slot.is_new.load(Ordering::Acquire))
    }

    /// Records that a node was computed. `is_new` is true if no machine has stored this result before.
    pub(super) fn set_new(&self, index: usize, is_new: bool) {
        let is_new = is_new || self.has_new_input(&self.graph.nodes()[index]);
        if let Some(slot) = self.slot(index) {
            slot.is_new.store(is_new, Ordering::Release);
        }
    }

    /// Keeps a node's values in memory while other nodes need them.
    pub(super) fn hold(&self, index: usize, values: &Values) {
        if let Some(slot) = self.slot(index).filter(|slot| 0 < slot.users.load(Ordering::Acquire))
            && lock(&slot.held).replace(values.clone()).is_none()
        {
            self.memory.hold(size(values));
        }
    }

    /// Returns the last result of the node from earlier evaluations, or `None` if there is none.
    pub(super) fn last_result(&self, index: usize) -> Option<&Arc<NodeRecord>> {
        let name = &self.graph.topology().names[index];
        let last = self.evaluator.last.as_ref();
        last.filter(|last| last.graph == self.graph.source().name)?.last_result(name, index)
    }

    /// Finds or computes the result of a node. Returns the result (`None` if the node failed), and the nodes with the same key that waited
    /// for it. Returns `None` instead if this node itself must wait: for a node with the same key, or for memory.
    fn run_node(&self, index: usize) -> Option<(Option<Arc<NodeRecord>>, Vec<usize>)> {
        let node = &self.graph.nodes()[index];
        let ran_above = node.links.iter().any(|link| self.has_run(link.node));
        self.set_ran(index, ran_above);
        if let Some(failed) = node.links.iter().find(|link| self.result_of(link.node).is_none()) {
            self.report(NodeEvent::new(index, State::Skipped, Reason::DependsOn(failed.node)));
            return Some((None, Vec::new()));
        }
        if self.plan.tasks[index] == Task::Restore && self.is_streamed(index) {
            return Some((self.result_of(index).cloned(), Vec::new()));
        }
        let mut parts = match self.parts(index) {
            Ok(parts) => parts,
            Err(error) => return Some((self.fail(index, error), Vec::new())),
        };
        loop {
            let key = parts.key();
            let mut flight = lock(&self.in_flight);
            let mut known = self.known_outcome(index, key);
            let is_believed = self.plan.tasks[index] == Task::Look && !self.evaluator.verifies(key);
            if is_believed && let Some(outcome) = known.take() {
                drop(flight);
                return Some((Some(self.reuse(index, parts, key, outcome, ran_above)), Vec::new()));
            }
            match flight.get_mut(&key) {
                Some(waiters) => {
                    waiters.push(index);
                    return None;
                }
                None => drop(flight.insert(key, Vec::new())),
            }
            drop(flight);
            // Ask the server only after the lock is released, so that other nodes need not wait for the reply.
            known = known.or_else(|| self.fetch(index, key));
            if is_believed && let Some(outcome) = known.take() {
                let waiters = lock(&self.in_flight).remove(&key).unwrap_or_default();
                return Some((Some(self.reuse(index, parts, key, outcome, ran_above)), waiters));
            }
            let in_blocks = self.compute_in_blocks(index, &parts);
            if let Some(computed) = in_blocks {
                let done = match computed {
                    Ok(computed) => Some(self.record(index, parts, key, known, computed)),
                    Err(error) => self.fail(index, error),
                };
                let waiters = lock(&self.in_flight).remove(&key).unwrap_or_default();
                return Some((done, waiters));
            }
            let done = match self.load(node, &parts) {
                Ok(LoadedFiles::Files(files)) => {
                    match self.compute(index, parts, key, &files, known) {
                        Some(done) => done,
                        None => {
                            // The node must wait for memory, and so must the nodes that wait for its result.
                            let waiters = lock(&self.in_flight).remove(&key).unwrap_or_default();
                            self.memory.wait(waiters);
                            return None;
                        }
                    }
                }
                Ok(LoadedFiles::Changed(now)) => {
                    lock(&self.in_flight).remove(&key);
                    parts.files = now;
                    continue;
                }
                Err(error) => self.fail(index, error),
            };
            // Remove the key from `in_flight`: the result is in the cache now, where later nodes with this key find it.
            let waiters = lock(&self.in_flight).remove(&key).unwrap_or_default();
            return Some((done, waiters));
        }
    }

    /// Returns the parts of the node's key: everything from which the node is computed.
    pub(super) fn parts(&self, index: usize) -> Result<Parts, Error> {
        let node = &self.graph.nodes()[index];
        let inputs = node
            .links
            .iter()
            .filter_map(|link| {
                self.result_of(link.node).map(|done| done.outcome.outputs[link.output].1)
            })
            .collect();
        let files = node.files.iter().map(|file| match self.is_streamed(index) {
            true => self.files.hash_in_pieces(file).map(Some),
            false => self.files.hash(file),
        });
        Ok(Parts { recipe: node.recipe.clone(), inputs, files: files.collect::<Result<_, _>>()? })
    }

    /// Returns the known result for the key, which the caller reuses or, if the task is `Verify`, compares with a newly computed result.
    /// Returns `None` if there is no such result or the task is another one.
    fn known_outcome(&self, index: usize, key: Hash) -> Option<Arc<Outcome>> {
        match self.plan.tasks[index] {
            Task::Look => self.find(index, key),
            Task::Verify => {
                let known = self.plan.known.get(index).filter(|done| done.key == key);
                known.map(|done| done.outcome.clone())
            }
            Task::None | Task::Restore => None,
        }
    }

    /// Returns the result with this key from memory, from the last evaluation or from disk. Returns `None` if none of them has it.
    pub(super) fn find(&self, index: usize, key: Hash) -> Option<Arc<Outcome>> {
        // Prefer results in this process to results on disk.
        let found = self.evaluator.cache.find(key).or_else(|| {
            let before = self.last_result(index).filter(|before| before.key == key)?;
            Some(before.outcome.clone())
        });
        found.or_else(|| {
            let outcome = Arc::new(self.evaluator.known_results()?.find(key)?);
            self.evaluator.cache.keep(key, outcome.clone());
            Some(outcome)
        })
    }

    /// Fetches a result that another machine computed. If an input of the node is new to all machines, no machine can have the result, so
    /// the server is not asked. For a graph that no machine knows, the server is therefore asked only about nodes without dependencies.
    fn fetch(&self, index: usize, key: Hash) -> Option<Arc<Outcome>> {
        let node = &self.graph.nodes()[index];
        let asks = self.plan.tasks[index] == Task::Look
            && node.kind() != ELEMENTS
            && !self.has_new_input(node)
            && !self.memory.has_waited(index)
            && !self.cancel.is_cancelled();
        let disk =
            self.evaluator.known_results().filter(|_| asks && self.evaluator.writes_to_disk)?;
        let outcome = Arc::new(disk.fetch(key)?);
        self.evaluator.cache.keep(key, outcome.clone());
        Some(outcome)
    }

    pub(super) fn report(&self, event: NodeEvent) {
        self.observer.on_finish(&self.graph.nodes()[event.index].name, event.state, event.seconds);
        lock(&self.events).push(event);
    }

    pub(super) fn fail(&self, index: usize, error: Error) -> Option<Arc<NodeRecord>> {
        let reason = Reason::Error(error.to_string());
        self.report(NodeEvent {
            error: Some(error),
            ..NodeEvent::new(index, State::Failed, reason)
        });
        None
    }

    fn reuse(
        &self,
        index: usize,
        parts: Parts,
        key: Hash,
        outcome: Arc<Outcome>,
        ran_above: bool,
    ) -> Arc<NodeRecord> {
        let change = self.last_result(index).and_then(|before| parts.change(&before.parts));
        let (state, reason) = match change {
            _ if ran_above => (State::Equal, Reason::SameInputs),
            Some(change) => (State::Cached, Reason::Before(change)),
            None => (State::Cached, Reason::Unchanged),
        };
        self.report(NodeEvent::new(index, state, reason));
        Arc::new(NodeRecord { parts, key, outcome })
    }

    /// Returns true if the values of those nodes in `roots` that have a result are in memory.
    pub(super) fn has_values(&self, roots: &[usize]) -> bool {
        roots.iter().all(|&root| self.result_of(root).is_none_or(|done| done.outcome.has_values()))
    }

    /// Returns the values of the nodes `roots`, sorted by the index of the node. Nodes without values are left out.
    pub(super) fn values_of(&self, roots: &[usize]) -> Vec<(usize, Values)> {
        let mut roots = roots.to_vec();
        roots.sort_unstable();
        roots.dedup();
        let values = roots.into_iter().filter(|root| self.result_of(*root).is_some());
        values.filter_map(|root| Some((root, self.values(root).ok()?))).collect()
    }

    /// Returns the visited nodes with their results, and the events of the nodes, both in the order of the graph.
    pub(super) fn into_results(self) -> (VisitedNodes, Vec<NodeEvent>) {
        let visited = self.slots.into_iter().filter_map(|slot| {
            let done = slot.result.into_inner()?;
            Some((slot.node, done))
        });
        let visited = visited.collect();
        let mut events = self.events.into_inner().unwrap_or_else(|broken| broken.into_inner());
        events.sort_by_key(|event| event.index);
        // Keep only the last event of each node. A node has two events if it was found in the cache and then computed because its values
        // were damaged.
        events.reverse();
        events.dedup_by_key(|event| event.index);
        events.reverse();
        (visited, events)
    }
}
