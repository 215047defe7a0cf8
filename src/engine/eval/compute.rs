//! Computes one node, and provides the values of its inputs.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::PathBuf;
use std::sync::{Arc, Mutex};
use std::time::Instant;

use maquette_graph::{ELEMENTS, GraphNode, Link};
use maquette_node::budget::{Estimate, MemoryError};
use maquette_node::{AnyNode, Context, File, PointBlock, Previous, Progress, ValueSize};
use maquette_syntax::error::{CancelledError, Error};
use maquette_value::Hash;

use super::cache::{Outcome, Values};
use super::fitting_size::fitting_input;
use super::key::Parts;
use super::panics::catch_panic;
use super::plan::Task;
use super::run::{NodeEvent, Run, size};
use super::snapshot::NodeRecord;
use super::trace::Reason;
use super::{State, lock};

/// The contents of the files that a node reads. If one of the files has changed since the node's key was computed, the new hashes of the
/// files instead.
pub(super) enum LoadedFiles {
    Files(BTreeMap<PathBuf, Option<File>>),
    Changed(Box<[Option<Hash>]>),
}

/// A result that was just computed.
pub(super) struct Computed {
    pub(super) outcome: Arc<Outcome>,
    /// `None` if only the hash of the value was computed.
    pub(super) values: Option<Values>,
    pub(super) estimate: Option<Estimate>,
    pub(super) start: Instant,
}

impl Run<'_> {
    /// Reads the files of a node. If one of them has changed since the node's key was computed, returns the new hashes instead.
    pub(super) fn load(&self, node: &GraphNode, parts: &Parts) -> Result<LoadedFiles, Error> {
        let files = node.files.iter().map(|file| self.files.file(file));
        let files: Vec<Option<File>> = files.collect::<Result<_, _>>()?;
        let hashes: Box<[_]> =
            files.iter().map(|file| file.as_ref().map(|file| file.hash)).collect();
        if hashes != parts.files {
            return Ok(LoadedFiles::Changed(hashes));
        }
        let paths = node.files.iter().map(|file| file.path.clone());
        Ok(LoadedFiles::Files(paths.zip(files).collect()))
    }

    /// Runs a node, and [records](Self::record) its result. Returns `Some(None)` if the node fails, and
    /// `None` if the node has to wait for memory.
    pub(super) fn compute(
        &self,
        index: usize,
        parts: Parts,
        key: Hash,
        files: &BTreeMap<PathBuf, Option<File>>,
        known: Option<Arc<Outcome>>,
    ) -> Option<Option<Arc<NodeRecord>>> {
        let node = &self.graph.nodes()[index];
        let start = Instant::now();
        self.set_ran(index, true);
        if !self.memory.has_waited(index) {
            self.observer.on_start(&node.name);
        }
        let inputs = node.links.iter().map(|link| self.values(link.node));
        let inputs = inputs.collect::<Result<Vec<Values>, Error>>();
        let ready = inputs.and_then(|inputs| {
            let estimate = self.estimate(index, &inputs, files)?;
            let own = self.unheld_bytes(index, &inputs);
            let admitted = self.memory.admit(index, estimate, own, &self.evaluator.cache);
            Ok((
                admitted.map_err(|error| self.with_fitting_input(index, error, &inputs))?,
                estimate,
                inputs,
            ))
        });
        let (estimate, inputs) = match ready {
            Ok((true, estimate, inputs)) => (estimate, inputs),
            Ok((false, ..)) => return None,
            Err(error) => return Some(self.fail(index, error)),
        };
        let given = self.update(index, &parts, key, &inputs, files);
        let (values, warnings) = match given.unwrap_or_else(|| self.eval(index, &inputs, files)) {
            Ok(given) => given,
            Err(error) => return Some(self.fail(index, error)),
        };
        drop(inputs);
        let seconds = start.elapsed().as_secs_f64();
        // Describing a large value takes seconds.
        let outcome = match self.cancel.stops(|| Outcome::new(&values, warnings, seconds)) {
            Ok(outcome) => Arc::new(outcome),
            Err(error) => return Some(self.fail(index, error.into())),
        };
        let computed = Computed { outcome, values: Some(values), estimate, start };
        Some(Some(self.record(index, parts, key, known, computed)))
    }

    /// Compares a new result with `known`, stores it, and reports the event.
    pub(super) fn record(
        &self,
        index: usize,
        parts: Parts,
        key: Hash,
        known: Option<Arc<Outcome>>,
        computed: Computed,
    ) -> Arc<NodeRecord> {
        let node = &self.graph.nodes()[index];
        let Computed { outcome, values, estimate, start } = computed;
        let before = self.last_result(index);
        let differs = known.as_ref().is_some_and(|known| !known.equals(&outcome));
        let reason = match (&known, before) {
            (Some(_), _) => Reason::Verified,
            (_, None) => Reason::First,
            (_, Some(before)) => parts.change(&before.parts).map_or(Reason::Lost, Reason::Changed),
        };
        let same = before.is_some_and(|before| before.outcome.equals(&outcome));
        if values.is_some() {
            self.evaluator.cache.keep(key, outcome.clone());
        }
        let is_kept = match (self.evaluator.writable_disk(), &values) {
            // Do not store the elements of a loop: they can be cut from the cached data again at no cost.
            _ if node.kind() == ELEMENTS => false,
            (Some(disk), Some(values)) => {
                let is_new = self.plan.tasks[index] == Task::Look && known.is_none();
                let is_kept = disk.keep(key, node.kind(), &outcome, values, is_new);
                if differs && !is_kept {
                    disk.remove(key);
                }
                is_kept
            }
            (None, Some(_)) => {
                outcome.mark_unsaved();
                false
            }
            (_, None) => false,
        };
        if self.evaluator.is_verifying() {
            lock(&self.evaluator.verified).insert(key);
        }
        self.set_new(index, is_kept && !same && known.is_none());
        if let Some(values) = &values {
            self.hold(index, values);
        }
        self.report(NodeEvent {
            unchanged: same,
            differs,
            start: start.duration_since(self.start).as_secs_f64(),
            seconds: outcome.seconds,
            estimate: estimate.map(|estimate| estimate.bytes),
            thread: rayon::current_thread_index().unwrap_or(0),
            ..NodeEvent::new(index, State::Computed, reason)
        });
        Arc::new(NodeRecord { parts, key, outcome })
    }

    /// Returns the node's own estimate of the memory that it needs, or `None` if the node gives no estimate.
    fn estimate(
        &self,
        index: usize,
        inputs: &[Values],
        files: &BTreeMap<PathBuf, Option<File>>,
    ) -> Result<Option<Estimate>, Error> {
        let node = &self.graph.nodes()[index].node;
        Ok(self.call_node(index, inputs, files, None, |cx| Ok(node.estimate(cx)))?.0)
    }

    /// Adds to an error the size of the inputs for which the memory would suffice.
    fn with_fitting_input(
        &self,
        index: usize,
        error: MemoryError,
        inputs: &[Values],
    ) -> MemoryError {
        let node = &self.graph.nodes()[index];
        let links = node.links.iter().zip(inputs);
        let sizes = links.map(|(link, values)| Some(ValueSize::of_value(&values[link.output])));
        let room = error.most.saturating_sub(error.held) as f64;
        let fits = fitting_input(&*node.node, &sizes.collect::<Vec<_>>(), room);
        MemoryError { fits, ..error }
    }

    /// Returns the size in bytes of those inputs that are in memory only for this node, because their source nodes have no slot.
    fn unheld_bytes(&self, index: usize, inputs: &[Values]) -> u64 {
        let links = self.graph.nodes()[index].links.iter().map(|link| link.node);
        let sources = BTreeMap::from_iter(links.zip(inputs));
        let apart = sources.iter().filter(|(source, _)| self.slot(**source).is_none());
        apart.map(|(_, values)| size(values)).sum()
    }

    /// Computes the node's values by updating its previous values. This is possible only if the previous inputs and outputs are in memory,
    /// and only input values have changed. Returns `None` if the node cannot update. The previous inputs are found by the hashes in the
    /// previous key, so no record of the edits is needed.
    fn update(
        &self,
        index: usize,
        parts: &Parts,
        key: Hash,
        inputs: &[Values],
        files: &BTreeMap<PathBuf, Option<File>>,
    ) -> Option<Result<(Values, Vec<String>), Error>> {
        let before = self.last_result(index).filter(|before| before.key != key)?;
        if before.parts.recipe.identity != parts.recipe.identity
            || before.parts.files != parts.files
        {
            return None;
        }
        let links = self.graph.nodes()[index].links.iter().zip(&before.parts.inputs);
        let (previous_inputs, previous_outputs) = (
            links
                .map(|(link, hash): (&Link, &Hash)| {
                    let values = self.last_result(link.node)?.outcome.values()?;
                    values.get(link.output).filter(|value| value.hash() == *hash).cloned()
                })
                .collect::<Option<Vec<_>>>()?,
            before.outcome.values()?,
        );
        let previous = Previous { inputs: &previous_inputs, outputs: &previous_outputs };
        let done = self.work(index, inputs, files, |node, cx| node.update(cx, &previous));
        done.map(|(values, warnings)| Some((values?.into(), warnings))).transpose()
    }

    /// Evaluates the node from scratch with the given input values.
    fn eval(
        &self,
        index: usize,
        inputs: &[Values],
        files: &BTreeMap<PathBuf, Option<File>>,
    ) -> Result<(Values, Vec<String>), Error> {
        let done = self.work(index, inputs, files, |node, cx| node.eval(cx));
        done.map(|(values, warnings)| (values.into(), warnings))
    }

    /// Checks that the inputs have the properties that the node requires, and then calls `work` on the node.
    fn work<R>(
        &self,
        index: usize,
        inputs: &[Values],
        files: &BTreeMap<PathBuf, Option<File>>,
        work: impl FnOnce(&dyn AnyNode, &Context<'_>) -> Result<R, Error>,
    ) -> Result<(R, Vec<String>), Error> {
        if self.cancel.is_cancelled() {
            return Err(CancelledError.into());
        }
        let node = &self.graph.nodes()[index];
        lock(&self.running).insert(index);
        let done = self.call_node(index, inputs, files, None, |cx| {
            self.evaluator.guards.check(self.graph, node, cx.inputs)?;
            work(&*node.node, cx)
        });
        lock(&self.running).remove(&index);
        done
    }

    /// Calls `work`, which runs code of a node, with the given inputs and files, or a block in place of a file. Returns its result and the
    /// warnings of the node. A panic becomes an error.
    pub(super) fn call_node<R>(
        &self,
        index: usize,
        inputs: &[Values],
        files: &BTreeMap<PathBuf, Option<File>>,
        block: Option<&PointBlock>,
        work: impl FnOnce(&Context<'_>) -> Result<R, Error>,
    ) -> Result<(R, Vec<String>), Error> {
        let node = &self.graph.nodes()[index];
        let inputs: Vec<_> = node
            .links
            .iter()
            .zip(inputs)
            .map(|(link, values): (&Link, &Values)| values[link.output].clone())
            .collect();
        let progress = Mutex::new(0.0);
        let report = |fraction: f64| {
            // Several threads may report, and the latest of their reports need not be the highest.
            let mut highest = lock(&progress);
            if *highest <= fraction {
                *highest = fraction.min(1.0);
                self.observer.on_progress(&node.name, *highest);
            }
        };
        let cx = Context {
            inputs: &inputs,
            files,
            progress: Progress { report: Some(&report), cancel: Some(self.cancel) },
            memos: Some(&self.evaluator.cache),
            readers: self.graph.readers(),
            block,
            warnings: Mutex::default(),
        };
        let result = catch_panic(|| self.cancel.stops(|| work(&cx))?)?;
        let warnings = cx.warnings.into_inner().unwrap_or_else(|broken| broken.into_inner());
        Ok((result, warnings))
    }

    /// Returns the values of a finished node from memory or disk. If they are in neither, computes them again.
    pub(super) fn values(&self, index: usize) -> Result<Values, Error> {
        match self.available_values(index) {
            Some(values) => Ok(values),
            None => self.restore(index),
        }
    }

    /// Returns the values of a node from memory or disk, or `None` if they are in neither.
    fn available_values(&self, index: usize) -> Option<Values> {
        if let Some(values) = self.slot(index).and_then(|slot| lock(&slot.held).clone()) {
            return Some(values);
        }
        let done = self.result_of(index)?;
        if let Some(values) = done.outcome.values() {
            return Some(values);
        }
        let values = self.evaluator.known_results()?.read(done.key, &done.outcome)?;
        self.evaluator.cache.hold(done.key, &done.outcome, &values);
        self.hold(index, &values);
        Some(values)
    }

    /// Computes the lost values of a node again, after the lost values on which it depends. This is rare: the plan restores values that are
    /// known to be lost. So only values that are dropped or found damaged during the evaluation are computed here. Two threads may compute
    /// the same value at the same time.
    fn restore(&self, index: usize) -> Result<Values, Error> {
        let (mut lost, mut values) = (BTreeSet::new(), HashMap::new());
        let mut pending = vec![index];
        while let Some(node) = pending.pop() {
            lost.insert(node);
            for source in self.graph.nodes()[node].links.iter().map(|link| link.node) {
                if !lost.contains(&source) && !values.contains_key(&source) {
                    match self.available_values(source) {
                        Some(kept) => drop(values.insert(source, kept)),
                        None => pending.push(source),
                    }
                }
            }
        }
        // `lost` is in ascending order, so each node comes after its dependencies.
        for node in lost {
            let links = self.graph.nodes()[node].links.iter();
            let inputs: Vec<_> = links.map(|link| values[&link.node].clone()).collect();
            values.insert(node, self.compute_again(node, &inputs)?);
        }
        Ok(values[&index].clone())
    }

    fn compute_again(&self, index: usize, inputs: &[Values]) -> Result<Values, Error> {
        let Some(done) = self.result_of(index) else { return Err(CancelledError.into()) };
        let node = &self.graph.nodes()[index];
        self.observer.on_start(&node.name);
        let start = Instant::now();
        let files = match self.load(node, &done.parts)? {
            LoadedFiles::Files(files) => files,
            LoadedFiles::Changed(_) => return Err(FileChangedError.into()),
        };
        self.memory.check_room(self.estimate(index, inputs, &files)?, &self.evaluator.cache)?;
        let (values, _) = self.eval(index, inputs, &files)?;
        if let Some(disk) = self.evaluator.writable_disk().filter(|_| node.kind() != ELEMENTS) {
            disk.keep(done.key, node.kind(), &done.outcome, &values, false);
        }
        self.evaluator.cache.hold(done.key, &done.outcome, &values);
        self.hold(index, &values);
        let seconds = start.elapsed().as_secs_f64();
        let start = start.duration_since(self.start).as_secs_f64();
        self.report(NodeEvent {
            start,
            seconds,
            ..NodeEvent::new(index, State::Computed, Reason::Lost)
        });
        Ok(values)
    }
}

/// The error that a lost result cannot be computed again because a file that the node reads has changed.
#[derive(Clone, Debug, thiserror::Error)]
#[error("a file that it reads has just changed; run it again")]
pub(super) struct FileChangedError;
