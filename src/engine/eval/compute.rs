//! Computes one node, and finds the values that it needs.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::PathBuf;
use std::sync::{Arc, Mutex};
use std::time::Instant;

use maquette_graph::{ELEMENTS, GraphNode, Link};
use maquette_node::limit::Estimate;
use maquette_node::{AnyNode, Context, File, Previous, Progress};
use maquette_syntax::error::{Cancelled, Error};
use maquette_value::Hash;

use super::cache::{Outcome, Values};
use super::key::Parts;
use super::plan::Task;
use super::run::{News, Run, size};
use super::snapshot::Done;
use super::trace::Reason;
use super::{State, lock, or_panic};

/// A node's files, or the hashes that they have now, if one has just been changed.
pub(super) enum Loaded {
    Files(BTreeMap<PathBuf, Option<File>>),
    Changed(Box<[Option<Hash>]>),
}

impl Run<'_> {
    /// The contents of the node's files; the hashes that they have now, if a file has just been changed.
    pub(super) fn load(&self, node: &GraphNode, parts: &Parts) -> Result<Loaded, Error> {
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

    /// Runs a node, compares its result with the `known` one, keeps it and tells what happened; none inside if it fails, none at all if
    /// it has to wait for memory.
    pub(super) fn compute(
        &self,
        index: usize,
        parts: Parts,
        key: Hash,
        files: &BTreeMap<PathBuf, Option<File>>,
        known: Option<Arc<Outcome>>,
    ) -> Option<Option<Arc<Done>>> {
        let node = &self.graph.nodes()[index];
        let start = Instant::now();
        self.set_ran(index, true);
        if !self.memory.has_put_aside(index) {
            self.observer.started(&node.name);
        }
        let inputs = node.links.iter().map(|link| self.values(link.node));
        let inputs = inputs.collect::<Result<Vec<Values>, Error>>();
        let ready = inputs.and_then(|inputs| {
            let estimate = self.estimate(index, &inputs, files)?;
            let own = self.unheld(index, &inputs);
            Ok((self.memory.admit(index, estimate, own, &self.evaluator.cache)?, estimate, inputs))
        });
        let (estimate, inputs) = match ready {
            Ok((true, estimate, inputs)) => (estimate, inputs),
            Ok((false, ..)) => return None,
            Err(error) => return Some(self.failed(index, error)),
        };
        let given = self.update(index, &parts, key, &inputs, files);
        let (values, warnings) = match given.unwrap_or_else(|| self.eval(index, &inputs, files)) {
            Ok(given) => given,
            Err(error) => return Some(self.failed(index, error)),
        };
        drop(inputs);
        let seconds = start.elapsed().as_secs_f64();
        let outcome = Arc::new(Outcome::new(&values, warnings, seconds));
        let before = self.before(index);
        let differs = known.as_ref().is_some_and(|known| !known.equals(&outcome));
        let reason = match (&known, before) {
            (Some(_), _) => Reason::Verified,
            (_, None) => Reason::First,
            (_, Some(before)) => parts.change(&before.parts).map_or(Reason::Lost, Reason::Changed),
        };
        let same = before.is_some_and(|before| before.outcome.equals(&outcome));
        self.evaluator.cache.keep(key, outcome.clone());
        let is_kept = match self.evaluator.shelf() {
            // They are cut again at once from what is kept.
            _ if node.kind() == ELEMENTS => false,
            Some(disk) => {
                let is_new = self.plan.tasks[index] == Task::Look && known.is_none();
                let is_kept = disk.keep(key, node.kind(), &outcome, &values, is_new);
                if differs && !is_kept {
                    disk.remove(key);
                }
                is_kept
            }
            None => {
                outcome.owe();
                false
            }
        };
        if self.evaluator.is_verifying() {
            lock(&self.evaluator.verified).insert(key);
        }
        self.set_new(index, is_kept && !same && known.is_none());
        self.hold(index, &values);
        self.tell(News {
            unchanged: same,
            differs,
            start: start.duration_since(self.start).as_secs_f64(),
            seconds,
            estimate: estimate.map(|estimate| estimate.bytes),
            thread: rayon::current_thread_index().unwrap_or(0),
            ..News::new(index, State::Computed, reason)
        });
        Some(Some(Arc::new(Done { parts, key, outcome })))
    }

    /// How much memory the node says that it needs.
    fn estimate(
        &self,
        index: usize,
        inputs: &[Values],
        files: &BTreeMap<PathBuf, Option<File>>,
    ) -> Result<Option<Estimate>, Error> {
        let node = &self.graph.nodes()[index].node;
        Ok(self.within(index, inputs, files, |cx| Ok(node.estimate(cx)))?.0)
    }

    /// How many bytes of the node's inputs are held for it alone, because their nodes have no slot.
    fn unheld(&self, index: usize, inputs: &[Values]) -> u64 {
        let links = self.graph.nodes()[index].links.iter().map(|link| link.node);
        let sources = BTreeMap::from_iter(links.zip(inputs));
        let apart = sources.iter().filter(|(source, _)| self.slot(**source).is_none());
        apart.map(|(_, values)| size(values)).sum()
    }

    /// Makes the node's values of those that it gave the last time, if only other values have come in since, and memory still has all
    /// of it; none if the node cannot.
    /// The hashes in the parts of its key identify the old values, so that nothing is tracked from edit to edit.
    fn update(
        &self,
        index: usize,
        parts: &Parts,
        key: Hash,
        inputs: &[Values],
        files: &BTreeMap<PathBuf, Option<File>>,
    ) -> Option<Result<(Values, Vec<String>), Error>> {
        let before = self.before(index).filter(|before| before.key != key)?;
        if before.parts.recipe.identity != parts.recipe.identity
            || before.parts.files != parts.files
        {
            return None;
        }
        let links = self.graph.nodes()[index].links.iter().zip(&before.parts.inputs);
        let (given, gave) = (
            links
                .map(|(link, hash): (&Link, &Hash)| {
                    let values = self.before(link.node)?.outcome.values()?;
                    values.get(link.output).filter(|value| value.hash() == *hash).cloned()
                })
                .collect::<Option<Vec<_>>>()?,
            before.outcome.values()?,
        );
        let previous = Previous { inputs: &given, outputs: &gave };
        let done = self.work(index, inputs, files, |node, cx| node.update(cx, &previous));
        done.map(|(values, warnings)| Some((values?.into(), warnings))).transpose()
    }

    /// Runs the node on the values of the nodes that its links lead to.
    fn eval(
        &self,
        index: usize,
        inputs: &[Values],
        files: &BTreeMap<PathBuf, Option<File>>,
    ) -> Result<(Values, Vec<String>), Error> {
        let done = self.work(index, inputs, files, |node, cx| node.eval(cx));
        done.map(|(values, warnings)| (values.into(), warnings))
    }

    /// What the node makes of inputs and files, which are as it wants them.
    fn work<R>(
        &self,
        index: usize,
        inputs: &[Values],
        files: &BTreeMap<PathBuf, Option<File>>,
        work: impl FnOnce(&dyn AnyNode, &Context<'_>) -> Result<R, Error>,
    ) -> Result<(R, Vec<String>), Error> {
        if self.cancel.is_cancelled() {
            return Err(Cancelled.into());
        }
        let node = &self.graph.nodes()[index];
        lock(&self.under_way).insert(index);
        let done = self.within(index, inputs, files, |cx| {
            self.evaluator.guards.check(self.graph, node, cx.inputs)?;
            work(&*node.node, cx)
        });
        lock(&self.under_way).remove(&index);
        done
    }

    /// What some code of a node makes of its inputs and files, and what it warns of; a panic becomes an error.
    fn within<R>(
        &self,
        index: usize,
        inputs: &[Values],
        files: &BTreeMap<PathBuf, Option<File>>,
        work: impl FnOnce(&Context<'_>) -> Result<R, Error>,
    ) -> Result<(R, Vec<String>), Error> {
        let node = &self.graph.nodes()[index];
        let inputs: Vec<_> = node
            .links
            .iter()
            .zip(inputs)
            .map(|(link, values): (&Link, &Values)| values[link.output].clone())
            .collect();
        let report = |share: f64| self.observer.progress(&node.name, share);
        let cx = Context {
            inputs: &inputs,
            files,
            progress: Progress { report: Some(&report), cancel: Some(self.cancel) },
            memos: Some(&self.evaluator.cache),
            readers: self.graph.readers(),
            warnings: Mutex::default(),
        };
        let result = or_panic(|| work(&cx))?;
        let warnings = cx.warnings.into_inner().unwrap_or_else(|broken| broken.into_inner());
        Ok((result, warnings))
    }

    /// The values of a node that has come to its end: from memory, from disk, or computed again if both lost them.
    pub(super) fn values(&self, index: usize) -> Result<Values, Error> {
        match self.kept(index) {
            Some(values) => Ok(values),
            None => self.restore(index),
        }
    }

    /// The values of a node, if memory or disk still has them.
    fn kept(&self, index: usize) -> Option<Values> {
        if let Some(values) = self.slot(index).and_then(|slot| lock(&slot.held).clone()) {
            return Some(values);
        }
        let done = self.done(index)?;
        if let Some(values) = done.outcome.values() {
            return Some(values);
        }
        let values = self.evaluator.known_results()?.read(done.key, &done.outcome)?;
        self.evaluator.cache.hold(done.key, &done.outcome, &values);
        self.hold(index, &values);
        Some(values)
    }

    /// Computes a node's values again, after those that it needs and that are lost, too. It is rare, because a plan restores
    /// what it knows to be lost: only what is dropped or found to be damaged later comes here, and may come twice at once.
    fn restore(&self, index: usize) -> Result<Values, Error> {
        let (mut lost, mut values) = (BTreeSet::new(), HashMap::new());
        let mut open = vec![index];
        while let Some(node) = open.pop() {
            lost.insert(node);
            for source in self.graph.nodes()[node].links.iter().map(|link| link.node) {
                if !lost.contains(&source) && !values.contains_key(&source) {
                    match self.kept(source) {
                        Some(kept) => drop(values.insert(source, kept)),
                        None => open.push(source),
                    }
                }
            }
        }
        // Each node comes after those that it hangs on.
        for node in lost {
            let links = self.graph.nodes()[node].links.iter();
            let inputs: Vec<_> = links.map(|link| values[&link.node].clone()).collect();
            values.insert(node, self.compute_again(node, &inputs)?);
        }
        Ok(values[&index].clone())
    }

    fn compute_again(&self, index: usize, inputs: &[Values]) -> Result<Values, Error> {
        let Some(done) = self.done(index) else { return Err(Cancelled.into()) };
        let node = &self.graph.nodes()[index];
        self.observer.started(&node.name);
        let start = Instant::now();
        let files = match self.load(node, &done.parts)? {
            Loaded::Files(files) => files,
            Loaded::Changed(_) => return Err(ChangedMeanwhile.into()),
        };
        self.memory.fits(self.estimate(index, inputs, &files)?, &self.evaluator.cache)?;
        let (values, _) = self.eval(index, inputs, &files)?;
        if let Some(disk) = self.evaluator.shelf().filter(|_| node.kind() != ELEMENTS) {
            disk.keep(done.key, node.kind(), &done.outcome, &values, false);
        }
        self.evaluator.cache.hold(done.key, &done.outcome, &values);
        self.hold(index, &values);
        let seconds = start.elapsed().as_secs_f64();
        let start = start.duration_since(self.start).as_secs_f64();
        self.tell(News { start, seconds, ..News::new(index, State::Computed, Reason::Lost) });
        Ok(values)
    }
}

/// A lost result cannot be computed again.
#[derive(Clone, Debug, thiserror::Error)]
#[error("a file that it reads has just been changed; run it again")]
pub(super) struct ChangedMeanwhile;
