//! One evaluation under way: visits the nodes that have a task, each after those that it hangs on.

use std::collections::{BTreeMap, HashMap};
use std::hash::BuildHasherDefault;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, OnceLock};
use std::time::Instant;

use super::cache::{FirstBytes, Outcome, Values};
use super::files::Reads;
use super::key::Parts;
use super::plan::{Plan, Task};
use super::snapshot::{Done, Fate};
use super::trace::Reason;
use super::why::{Forecast, Outlook};
use super::{Evaluator, Observer, Panic, State, in_words, lock};
use crate::error::{Cancelled, Error};
use crate::graph::{Graph, GraphNode};
use crate::node::{CancelToken, Context, File, Progress};
use crate::value::{AnyValue, Hash};

/// What happened to a node that is not as it was.
pub(super) struct News {
    pub(super) index: usize,
    pub(super) state: State,
    pub(super) reason: Reason,
    pub(super) unchanged: bool,
    /// Whether a result that was computed to compare it is another one.
    pub(super) differs: bool,
    pub(super) error: Option<Error>,
    pub(super) start: f64,
    pub(super) seconds: f64,
    pub(super) thread: usize,
}

impl News {
    fn new(index: usize, state: State, reason: Reason) -> Self {
        let (unchanged, differs, error) = (false, false, None);
        Self {
            index,
            state,
            reason,
            unchanged,
            differs,
            error,
            start: 0.0,
            seconds: 0.0,
            thread: 0,
        }
    }
}

pub(super) struct Run<'a> {
    evaluator: &'a Evaluator,
    graph: &'a Graph,
    tasks: &'a [Task],
    observer: &'a dyn Observer,
    cancel: &'a CancelToken,
    start: Instant,
    files: Reads<'a>,
    /// The slot of each node that has a task, by node.
    places: Vec<u32>,
    slots: Vec<Slot>,
    news: Mutex<Vec<News>>,
    /// Nodes that wait for another one with the same key.
    in_flight: Mutex<HashMap<Hash, Vec<usize>, BuildHasherDefault<FirstBytes>>>,
}

/// A node with a task.
#[derive(Default)]
struct Slot {
    node: usize,
    /// How many links wait for their node.
    waiting: AtomicUsize,
    /// The node's result; none inside if it has none.
    done: OnceLock<Option<Arc<Done>>>,
    /// Whether this node, or one that it hangs on, ran.
    ran: AtomicBool,
    /// The values, held for the nodes that still need them.
    held: Mutex<Option<Values>>,
    /// How many links of nodes that have a task still need them.
    users: AtomicUsize,
}

/// The place of a node without a slot.
const NOWHERE: u32 = u32::MAX;

impl<'a> Run<'a> {
    pub(super) fn new(
        evaluator: &'a Evaluator,
        graph: &'a Graph,
        plan: &'a Plan,
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
                let links = graph.nodes[node].links.iter().map(|link| places[link.node]);
                let mut waiting = 0;
                for place in links.filter(|&place| place != NOWHERE) {
                    *slots[place as usize].users.get_mut() += 1;
                    waiting += 1;
                }
                slots.push(Slot { node, waiting: waiting.into(), ..Slot::default() });
            }
        }
        Self {
            evaluator,
            graph,
            tasks,
            observer,
            cancel,
            start: Instant::now(),
            files: Reads::new(&evaluator.files),
            places,
            slots,
            news: Mutex::default(),
            in_flight: Mutex::default(),
        }
    }

    /// The slot of a node; none if it has no task.
    fn slot(&self, node: usize) -> Option<&Slot> {
        let place = *self.places.get(node)?;
        self.slots.get(place as usize)
    }

    pub(super) fn start<'s>(&'s self, scope: &rayon::Scope<'s>) {
        for slot in &self.slots {
            if slot.waiting.load(Ordering::Relaxed) == 0 {
                scope.spawn(move |scope| self.visit(slot.node, scope));
            }
        }
    }

    /// Brings a node to its end, and then those that waited for it alone.
    fn visit<'s>(&'s self, index: usize, scope: &rayon::Scope<'s>) {
        let mut next = Some(index);
        // One of the nodes that become ready goes on here, without the cost of a task: long chains are common. Going deep
        // first, values are used, and dropped, soon after they are made.
        while let Some(index) = next.take() {
            let Some((done, mut ready)) = self.node(index) else { return };
            if let Some(slot) = self.slot(index) {
                let _ = slot.done.set(done);
            }
            self.let_go(index);
            let users = self.graph.shape.users(index).iter();
            for user in users.filter_map(|&user| self.slot(user as usize)) {
                if user.waiting.fetch_sub(1, Ordering::AcqRel) == 1 {
                    ready.push(user.node);
                }
            }
            next = ready.pop();
            for other in ready {
                scope.spawn(move |scope| self.visit(other, scope));
            }
        }
    }

    /// Drops the values that only this node still needed.
    fn let_go(&self, index: usize) {
        let links = self.graph.nodes[index].links.iter();
        for slot in links.filter_map(|link| self.slot(link.node)) {
            if slot.users.fetch_sub(1, Ordering::AcqRel) == 1 {
                *lock(&slot.held) = None;
            }
        }
    }

    fn done(&self, index: usize) -> Option<&Arc<Done>> {
        match self.slot(index) {
            Some(slot) => slot.done.get()?.as_ref(),
            None => self.evaluator.last.as_ref()?.current(index),
        }
    }

    fn ran(&self, index: usize) -> bool {
        self.slot(index).is_some_and(|slot| slot.ran.load(Ordering::Acquire))
    }

    fn set_ran(&self, index: usize, ran: bool) {
        if let Some(slot) = self.slot(index) {
            slot.ran.store(ran, Ordering::Release);
        }
    }

    /// Holds a node's values as long as somebody still needs them.
    fn hold(&self, index: usize, values: &Values) {
        let needed = |slot: &&Slot| 0 < slot.users.load(Ordering::Acquire);
        if let Some(slot) = self.slot(index).filter(needed) {
            *lock(&slot.held) = Some(values.clone());
        }
    }

    fn before(&self, index: usize) -> Option<&Arc<Done>> {
        let name = &self.graph.shape.names[index];
        self.evaluator.last.as_ref()?.before(name, index)
    }

    /// What becomes of a node, and the nodes of the same key that waited for it; none if it waits itself.
    fn node(&self, index: usize) -> Option<(Option<Arc<Done>>, Vec<usize>)> {
        let node = &self.graph.nodes[index];
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
            if self.tasks[index] == Task::Look
                && let Some(outcome) = self.find(key)
            {
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
            let done = match self.load(node, &parts) {
                Ok(Loaded::Files(files)) => self.compute(index, parts, key, &files),
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
    fn parts(&self, node: &GraphNode) -> Result<Parts, Error> {
        let input = |link: &crate::graph::Link| {
            self.done(link.node).map(|done| done.outcome.outputs[link.output].1)
        };
        let inputs = node.links.iter().filter_map(input).collect();
        let files = node.files.iter().map(|file| self.files.hash(file));
        Ok(Parts { recipe: node.recipe.clone(), inputs, files: files.collect::<Result<_, _>>()? })
    }

    fn find(&self, key: Hash) -> Option<Arc<Outcome>> {
        let found = self.evaluator.cache.find(key);
        found.or_else(|| {
            let outcome = Arc::new(self.evaluator.known_results()?.find(key)?);
            self.evaluator.cache.keep(key, outcome.clone());
            Some(outcome)
        })
    }

    /// What would become of a node that must be looked at; those that it hangs on have been asked about before. A node that
    /// would not run has its result from then on.
    pub(super) fn forecast(&self, index: usize) -> Forecast {
        let node = &self.graph.nodes[index];
        let tell = |outlook, reason| Forecast { index, outlook, reason };
        let unknown = node.links.iter().find(|link| self.done(link.node).is_none());
        let before = self.before(index);
        let mut parts = match self.parts(node) {
            Ok(parts) => parts,
            Err(error) => return tell(Outlook::Fails, Reason::Error(error.to_string())),
        };
        if let Some(unknown) = unknown {
            // What it is apart from its inputs.
            parts.inputs = before.map_or_else(Box::default, |before| before.parts.inputs.clone());
            return match before.map(|before| parts.change(&before.parts)) {
                None => tell(Outlook::Runs, Reason::First),
                Some(Some(change)) => tell(Outlook::Runs, Reason::Changed(change)),
                Some(None) => tell(Outlook::MayRun, Reason::HangsOn(unknown.node)),
            };
        }
        let key = parts.key();
        let change = before.map(|before| parts.change(&before.parts));
        let found = self.find(key);
        let reason = match (found.is_some(), change) {
            (true, None | Some(None)) => Reason::Unchanged,
            (true, Some(Some(change))) => Reason::Before(change),
            (false, None) => Reason::First,
            (false, Some(None)) => Reason::Lost,
            (false, Some(Some(change))) => Reason::Changed(change),
        };
        let outlook = if found.is_some() { Outlook::Cached } else { Outlook::Runs };
        if let Some((outcome, slot)) = found.zip(self.slot(index)) {
            let _ = slot.done.set(Some(Arc::new(Done { parts, key, outcome })));
        }
        tell(outlook, reason)
    }

    /// The contents of the node's files; the hashes that they have now, if a file has just been changed.
    fn load(&self, node: &GraphNode, parts: &Parts) -> Result<Loaded, Error> {
        let files = node.files.iter().map(|file| self.files.file(file));
        let files: Vec<Option<File>> = files.collect::<Result<_, _>>()?;
        let hashes: Box<[_]> =
            files.iter().map(|file| file.as_ref().map(|file| file.hash)).collect();
        if hashes != parts.files {
            return Ok(Loaded::Changed(hashes));
        }
        let paths = node.files.iter().map(|file| file.path.clone());
        Ok(Loaded::Files(paths.zip(files).collect()))
    }

    fn tell(&self, news: News) {
        self.observer.finished(&self.graph.nodes[news.index].name, news.state, news.seconds);
        lock(&self.news).push(news);
    }

    fn failed(&self, index: usize, error: Error) -> Option<Arc<Done>> {
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

    fn compute(
        &self,
        index: usize,
        parts: Parts,
        key: Hash,
        files: &BTreeMap<PathBuf, Option<File>>,
    ) -> Option<Arc<Done>> {
        let node = &self.graph.nodes[index];
        self.set_ran(index, true);
        self.observer.started(&node.name);
        let start = Instant::now();
        let (values, warnings) = match self.eval(node, files) {
            Ok(given) => given,
            Err(error) => return self.failed(index, error),
        };
        let seconds = start.elapsed().as_secs_f64();
        let outcome = Arc::new(Outcome::new(&values, warnings, seconds));
        let before = self.before(index);
        let reason = match (self.tasks[index], before) {
            (Task::Verify, _) => Reason::Verified,
            (_, None) => Reason::First,
            (_, Some(before)) => parts.change(&before.parts).map_or(Reason::Lost, Reason::Changed),
        };
        let same = before.is_some_and(|before| before.outcome.equals(&outcome));
        self.evaluator.cache.keep(key, outcome.clone());
        if let Some(disk) = &self.evaluator.disk {
            disk.keep(key, &outcome, &values);
        }
        self.hold(index, &values);
        self.tell(News {
            unchanged: same,
            differs: self.tasks[index] == Task::Verify && !same,
            start: start.duration_since(self.start).as_secs_f64(),
            seconds,
            thread: rayon::current_thread_index().unwrap_or(0),
            ..News::new(index, State::Computed, reason)
        });
        Some(Arc::new(Done { parts, key, outcome }))
    }

    /// Runs the node.
    fn eval(
        &self,
        node: &GraphNode,
        files: &BTreeMap<PathBuf, Option<File>>,
    ) -> Result<(Values, Vec<String>), Error> {
        if self.cancel.is_cancelled() {
            return Err(Cancelled.into());
        }
        let inputs = node.links.iter().map(|link| {
            let values = self.values(link.node)?;
            Ok(values[link.output].clone())
        });
        let inputs: Vec<AnyValue> = inputs.collect::<Result<_, Error>>()?;
        let report = |share: f64| self.observer.progress(&node.name, share);
        let cx = Context {
            inputs: &inputs,
            files,
            progress: Progress { report: Some(&report), cancel: Some(self.cancel) },
            memos: Some(&self.evaluator.cache),
            warnings: Mutex::default(),
        };
        let values = catch_unwind(AssertUnwindSafe(|| node.node.eval(&cx)))
            .unwrap_or_else(|panic| Err(Panic(in_words(&*panic)).into()))?;
        let warnings = cx.warnings.into_inner().unwrap_or_else(|broken| broken.into_inner());
        Ok((values.into(), warnings))
    }

    /// The values of a node that has come to its end: from memory, from disk, or computed again if both lost them.
    fn values(&self, index: usize) -> Result<Values, Error> {
        if let Some(values) = self.slot(index).and_then(|slot| lock(&slot.held).clone()) {
            return Ok(values);
        }
        let Some(done) = self.done(index) else { return Err(Cancelled.into()) };
        if let Some(values) = done.outcome.values() {
            return Ok(values);
        }
        let disk = self.evaluator.known_results();
        let kept = disk.and_then(|disk| disk.read(done.key, &done.outcome));
        let values = match kept {
            Some(values) => values,
            None => self.compute_again(index, done)?,
        };
        self.evaluator.cache.hold(done.key, &done.outcome, &values);
        self.hold(index, &values);
        Ok(values)
    }

    /// Computes what was kept and turned out to be damaged. It is rare, and so may happen twice at once.
    fn compute_again(&self, index: usize, done: &Done) -> Result<Values, Error> {
        let node = &self.graph.nodes[index];
        self.observer.started(&node.name);
        let start = Instant::now();
        let files = match self.load(node, &done.parts)? {
            Loaded::Files(files) => files,
            Loaded::Changed(_) => return Err(Cancelled.into()),
        };
        let (values, _) = self.eval(node, &files)?;
        if let Some(disk) = &self.evaluator.disk {
            disk.keep(done.key, &done.outcome, &values);
        }
        let seconds = start.elapsed().as_secs_f64();
        let start = start.duration_since(self.start).as_secs_f64();
        self.tell(News { start, seconds, ..News::new(index, State::Computed, Reason::Lost) });
        Ok(values)
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
        let has = |root: &usize| self.done(*root).is_some();
        let values = roots.into_iter().filter(has);
        values.filter_map(|root| Some((root, self.values(root).ok()?))).collect()
    }

    /// What is known now of the nodes that are not as they were, and what happened to them, in the graph's order.
    pub(super) fn end(self) -> (Vec<(usize, Fate)>, Vec<News>) {
        let visited = self.slots.iter().map(|slot| (slot.node, self.fate(slot)));
        let last = self.evaluator.last.as_ref();
        let replaced = last.into_iter().flat_map(|last| self.graph.shape.differences(&last.shape));
        let unwanted = replaced.filter(|&index| self.tasks[index] == Task::None);
        let fates = visited.chain(unwanted.map(|index| (index, self.stale(index)))).collect();
        let mut news = self.news.into_inner().unwrap_or_else(|broken| broken.into_inner());
        news.sort_by_key(|news| news.index);
        // A node may have been found in the cache and then, its values damaged, computed: the latter counts.
        news.reverse();
        news.dedup_by_key(|news| news.index);
        news.reverse();
        (fates, news)
    }

    fn fate(&self, slot: &Slot) -> Fate {
        match slot.done.get() {
            Some(Some(done)) => Fate::Current(done.clone()),
            _ => self.stale(slot.node),
        }
    }

    fn stale(&self, index: usize) -> Fate {
        self.before(index).map_or(Fate::Unknown, |done| Fate::Stale(done.clone()))
    }
}

enum Loaded {
    Files(BTreeMap<PathBuf, Option<File>>),
    Changed(Box<[Option<Hash>]>),
}
