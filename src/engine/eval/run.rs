//! One evaluation under way: visits the nodes that have a task, each after those that it hangs on.

use std::collections::{BTreeSet, HashMap};
use std::hash::BuildHasherDefault;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, OnceLock};
use std::time::Instant;

use maquette_graph::files::Reads;
use maquette_graph::{ELEMENTS, Graph, GraphNode};
use maquette_node::CancelToken;
use maquette_syntax::error::Error;
use maquette_value::{AnyValue, Hash};

use super::cache::{FirstBytes, Outcome, Values};
use super::compute::Loaded;
use super::key::Parts;
use super::memory::Memory;
use super::plan::{Plan, Task};
use super::snapshot::{Done, Visited};
use super::trace::Reason;
use super::{Evaluator, Observer, State, lock};

/// What happened to a node that is not as it was.
pub(super) struct News {
    pub(super) index: usize,
    pub(super) state: State,
    pub(super) reason: Reason,
    pub(super) unchanged: bool,
    /// Whether a result that was computed to compare it is another one.
    pub(super) differs: bool,
    pub(super) error: Option<Error>,
    /// How many bytes it said that it needs.
    pub(super) estimate: Option<f64>,
    pub(super) start: f64,
    pub(super) seconds: f64,
    pub(super) thread: usize,
}

impl News {
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
    /// The slot of each node that has a task, by node.
    places: Vec<u32>,
    pub(super) slots: Vec<Slot>,
    pub(super) news: Mutex<Vec<News>>,
    pub(super) memory: Memory,
    /// The nodes whose code runs now.
    pub(super) under_way: Mutex<BTreeSet<usize>>,
    /// Nodes that wait for another one with the same key.
    in_flight: Mutex<HashMap<Hash, Vec<usize>, BuildHasherDefault<FirstBytes>>>,
}

/// A node with a task.
#[derive(Default)]
pub(super) struct Slot {
    node: usize,
    /// How many links wait for their node.
    waiting: AtomicUsize,
    /// The node's result; none inside if it has none.
    pub(super) done: OnceLock<Option<Arc<Done>>>,
    /// Whether this node, or one that it hangs on, ran.
    ran: AtomicBool,
    /// Whether this node, or one that it hangs on, has a result that no machine has kept before: then none has what hangs on it.
    is_new: AtomicBool,
    /// The values, held for the nodes that still need them.
    pub(super) held: Mutex<Option<Values>>,
    /// How many links of nodes that have a task still need them; one more if they are wanted afterwards.
    pub(super) users: AtomicUsize,
}

/// How many bytes values count as.
pub(super) fn size(values: &Values) -> u64 {
    values.iter().map(AnyValue::size).sum::<usize>() as u64
}

/// The place of a node without a slot.
const NOWHERE: u32 = u32::MAX;

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
        let mut places = Vec::new();
        let mut slots: Vec<Slot> = Vec::new();
        if plan.has_work() {
            places.resize(tasks.len(), NOWHERE);
            for node in (0..tasks.len()).filter(|&node| tasks[node] != Task::None) {
                places[node] = slots.len() as u32;
                // Each node comes after those that it hangs on, so their slots are there.
                let links = graph.shape().sources(node).map(|source| places[source]);
                let mut waiting = 0;
                for place in links.filter(|&place| place != NOWHERE) {
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
            places,
            slots,
            news: Mutex::default(),
            memory: Memory::new(evaluator.most),
            under_way: Mutex::default(),
            in_flight: Mutex::default(),
        };
        for slot in values.iter().filter_map(|&node| run.slot(node)) {
            slot.users.fetch_add(1, Ordering::Relaxed);
        }
        run
    }

    /// The slot of a node; none if it has no task.
    pub(super) fn slot(&self, node: usize) -> Option<&Slot> {
        let place = *self.places.get(node)?;
        self.slots.get(place as usize)
    }

    pub(super) fn start<'s>(&'s self, scope: &rayon::Scope<'s>) {
        // All are found before the first one runs: one that becomes ready meanwhile is visited by whom it waited for, and would be
        // visited twice.
        let ready: Vec<_> =
            self.slots.iter().filter(|slot| slot.waiting.load(Ordering::Relaxed) == 0).collect();
        self.memory.begin(ready.len());
        for slot in ready {
            scope.spawn(move |scope| self.visit(slot.node, scope));
        }
    }

    /// Brings a node to its end, and then those that waited for it alone.
    fn visit<'s>(&'s self, index: usize, scope: &rayon::Scope<'s>) {
        let mut next = Some(index);
        // One of the nodes that become ready goes on here, without the cost of a task: long chains are common. Going deep
        // first, values are used, and dropped, soon after they are made.
        while let Some(index) = next.take() {
            let Some((done, mut ready)) = self.node(index) else {
                next = self.memory.end();
                continue;
            };
            if let Some(slot) = self.slot(index) {
                let _ = slot.done.set(done);
            }
            self.let_go(index);
            let users = self.graph.shape().users(index);
            for user in users.filter_map(|user| self.slot(user)) {
                if user.waiting.fetch_sub(1, Ordering::AcqRel) == 1 {
                    ready.push(user.node);
                }
            }
            ready.extend(self.memory.leave(index, &self.evaluator.cache));
            next = ready.pop();
            self.memory.begin(ready.len());
            for other in ready {
                scope.spawn(move |scope| self.visit(other, scope));
            }
            next = next.or_else(|| self.memory.end());
        }
    }

    /// Drops the values that only this node still needed.
    fn let_go(&self, index: usize) {
        let links = self.graph.nodes()[index].links.iter();
        for slot in links.filter_map(|link| self.slot(link.node)) {
            if slot.users.fetch_sub(1, Ordering::AcqRel) == 1
                && let Some(values) = lock(&slot.held).take()
            {
                self.memory.let_go(size(&values));
            }
        }
    }

    /// What is known of a node. One that is only restored or compared is known before it is visited: a node that is not visited
    /// may hang on it, and need its values when another process has dropped its own.
    pub(super) fn done(&self, index: usize) -> Option<&Arc<Done>> {
        let found = self.slot(index).and_then(|slot| slot.done.get());
        match found {
            Some(found) => found.as_ref(),
            None => self.plan.known.get(index),
        }
    }

    fn ran(&self, index: usize) -> bool {
        self.slot(index).is_some_and(|slot| slot.ran.load(Ordering::Acquire))
    }

    pub(super) fn set_ran(&self, index: usize, ran: bool) {
        if let Some(slot) = self.slot(index) {
            slot.ran.store(ran, Ordering::Release);
        }
    }

    /// Whether one that the node hangs on has a result that no machine has kept before.
    fn is_new_above(&self, node: &GraphNode) -> bool {
        let mut slots = node.links.iter().filter_map(|link| self.slot(link.node));
        slots.any(|slot| slot.is_new.load(Ordering::Acquire))
    }

    /// Says that a node was computed, and whether its result is new.
    pub(super) fn set_new(&self, index: usize, is_new: bool) {
        let is_new = is_new || self.is_new_above(&self.graph.nodes()[index]);
        if let Some(slot) = self.slot(index) {
            slot.is_new.store(is_new, Ordering::Release);
        }
    }

    /// Holds a node's values as long as somebody still needs them.
    pub(super) fn hold(&self, index: usize, values: &Values) {
        if let Some(slot) = self.slot(index).filter(|slot| 0 < slot.users.load(Ordering::Acquire))
            && lock(&slot.held).replace(values.clone()).is_none()
        {
            self.memory.hold(size(values));
        }
    }

    /// The node's last result, if an evaluation of this graph gave it.
    pub(super) fn before(&self, index: usize) -> Option<&Arc<Done>> {
        let name = &self.graph.shape().names[index];
        let last = self.evaluator.last.as_ref();
        last.filter(|last| last.graph == self.graph.source().name)?.before(name, index)
    }

    /// What becomes of a node, and the nodes of the same key that waited for it; none if it waits itself, for one of the same key or
    /// for memory.
    fn node(&self, index: usize) -> Option<(Option<Arc<Done>>, Vec<usize>)> {
        let node = &self.graph.nodes()[index];
        let ran_above = node.links.iter().any(|link| self.ran(link.node));
        self.set_ran(index, ran_above);
        if let Some(failed) = node.links.iter().find(|link| self.done(link.node).is_none()) {
            self.tell(News::new(index, State::Skipped, Reason::HangsOn(failed.node)));
            return Some((None, Vec::new()));
        }
        let mut parts = match self.parts(node) {
            Ok(parts) => parts,
            Err(error) => return Some((self.failed(index, error), Vec::new())),
        };
        loop {
            let key = parts.key();
            let mut flight = lock(&self.in_flight);
            let mut known = self.known(index, key);
            let is_believed = self.plan.tasks[index] == Task::Look && !self.evaluator.verifies(key);
            if is_believed && let Some(outcome) = known.take() {
                drop(flight);
                return Some((
                    Some(self.not_run(index, parts, key, outcome, ran_above)),
                    Vec::new(),
                ));
            }
            match flight.get_mut(&key) {
                Some(waiters) => {
                    waiters.push(index);
                    return None;
                }
                None => drop(flight.insert(key, Vec::new())),
            }
            drop(flight);
            // Nobody else who looks anything up waits for the server.
            known = known.or_else(|| self.fetch(index, key));
            if is_believed && let Some(outcome) = known.take() {
                let waiters = lock(&self.in_flight).remove(&key).unwrap_or_default();
                return Some((Some(self.not_run(index, parts, key, outcome, ran_above)), waiters));
            }
            let done = match self.load(node, &parts) {
                Ok(Loaded::Files(files)) => match self.compute(index, parts, key, &files, known) {
                    Some(done) => done,
                    None => {
                        // It waits for memory, and so do those that wait for it.
                        let waiters = lock(&self.in_flight).remove(&key).unwrap_or_default();
                        self.memory.wait(waiters);
                        return None;
                    }
                },
                Ok(Loaded::Changed(now)) => {
                    lock(&self.in_flight).remove(&key);
                    parts.files = now;
                    continue;
                }
                Err(error) => self.failed(index, error),
            };
            // After the result is in the cache: whoever comes now finds it there.
            let waiters = lock(&self.in_flight).remove(&key).unwrap_or_default();
            return Some((done, waiters));
        }
    }

    /// What the node is computed from.
    pub(super) fn parts(&self, node: &GraphNode) -> Result<Parts, Error> {
        let inputs = node
            .links
            .iter()
            .filter_map(|link| self.done(link.node).map(|done| done.outcome.outputs[link.output].1))
            .collect();
        let files = node.files.iter().map(|file| self.files.hash(file));
        Ok(Parts { recipe: node.recipe.clone(), inputs, files: files.collect::<Result<_, _>>()? })
    }

    /// The result to which a computed one is compared, or which takes its place.
    fn known(&self, index: usize, key: Hash) -> Option<Arc<Outcome>> {
        match self.plan.tasks[index] {
            Task::Look => self.find(index, key),
            Task::Verify => {
                let known = self.plan.known.get(index).filter(|done| done.key == key);
                known.map(|done| done.outcome.clone())
            }
            Task::None | Task::Restore => None,
        }
    }

    /// What is known of a node's result of this key.
    pub(super) fn find(&self, index: usize, key: Hash) -> Option<Arc<Outcome>> {
        // What this process has computed comes before what another one has noted.
        let found = self.evaluator.cache.find(key).or_else(|| {
            let before = self.before(index).filter(|before| before.key == key)?;
            Some(before.outcome.clone())
        });
        found.or_else(|| {
            let outcome = Arc::new(self.evaluator.known_results()?.find(key)?);
            self.evaluator.cache.keep(key, outcome.clone());
            Some(outcome)
        })
    }

    /// What another machine has found, if it may have looked for it. So where there is nothing, only what hangs on nothing is asked for.
    fn fetch(&self, index: usize, key: Hash) -> Option<Arc<Outcome>> {
        let node = &self.graph.nodes()[index];
        let asks = self.plan.tasks[index] == Task::Look
            && node.kind() != ELEMENTS
            && !self.is_new_above(node)
            && !self.memory.has_put_aside(index)
            && !self.cancel.is_cancelled();
        let disk = self.evaluator.known_results().filter(|_| asks && self.evaluator.keeps)?;
        let outcome = Arc::new(disk.fetch(key)?);
        self.evaluator.cache.keep(key, outcome.clone());
        Some(outcome)
    }

    pub(super) fn tell(&self, news: News) {
        self.observer.finished(&self.graph.nodes()[news.index].name, news.state, news.seconds);
        lock(&self.news).push(news);
    }

    pub(super) fn failed(&self, index: usize, error: Error) -> Option<Arc<Done>> {
        let reason = Reason::Error(error.to_string());
        self.tell(News { error: Some(error), ..News::new(index, State::Failed, reason) });
        None
    }

    fn not_run(
        &self,
        index: usize,
        parts: Parts,
        key: Hash,
        outcome: Arc<Outcome>,
        ran_above: bool,
    ) -> Arc<Done> {
        let change = self.before(index).and_then(|before| parts.change(&before.parts));
        let (state, reason) = match change {
            _ if ran_above => (State::Equal, Reason::SameInputs),
            Some(change) => (State::Cached, Reason::Before(change)),
            None => (State::Cached, Reason::Unchanged),
        };
        self.tell(News::new(index, state, reason));
        Arc::new(Done { parts, key, outcome })
    }

    /// Whether the values of these nodes are in memory.
    pub(super) fn has_values(&self, roots: &[usize]) -> bool {
        roots.iter().all(|&root| self.done(root).is_none_or(|done| done.outcome.has_values()))
    }

    /// The values of these nodes, in order of the nodes; without those that have none.
    pub(super) fn values_of(&self, roots: &[usize]) -> Vec<(usize, Values)> {
        let mut roots = roots.to_vec();
        roots.sort_unstable();
        roots.dedup();
        let values = roots.into_iter().filter(|root| self.done(*root).is_some());
        values.filter_map(|root| Some((root, self.values(root).ok()?))).collect()
    }

    /// The nodes that were visited, and what happened to them, in the graph's order.
    pub(super) fn end(self) -> (Visited, Vec<News>) {
        let visited = self.slots.into_iter().filter_map(|slot| {
            let done = slot.done.into_inner()?;
            Some((slot.node, done))
        });
        let visited = visited.collect();
        let mut news = self.news.into_inner().unwrap_or_else(|broken| broken.into_inner());
        news.sort_by_key(|news| news.index);
        // A node may have been found in the cache and then, its values damaged, computed: the latter counts.
        news.reverse();
        news.dedup_by_key(|news| news.index);
        news.reverse();
        (visited, news)
    }
}
