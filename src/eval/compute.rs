//! Computes one node, and finds the values that it needs.

use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::{Arc, Mutex};
use std::time::Instant;

use super::cache::{Outcome, Values};
use super::key::Parts;
use super::plan::Task;
use super::run::{News, Run};
use super::snapshot::Done;
use super::trace::Reason;
use super::{Panic, State, in_words, lock};
use crate::error::{Cancelled, Error};
use crate::graph::GraphNode;
use crate::node::{Context, File, Progress};
use crate::value::{AnyValue, Hash};

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

    /// Runs a node, keeps its result and tells what happened; none if it fails.
    pub(super) fn compute(
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
            disk.keep(key, &outcome, &values, self.tasks[index] == Task::Look);
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
    pub(super) fn values(&self, index: usize) -> Result<Values, Error> {
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
            disk.keep(done.key, &done.outcome, &values, false);
        }
        let seconds = start.elapsed().as_secs_f64();
        let start = start.duration_since(self.start).as_secs_f64();
        self.tell(News { start, seconds, ..News::new(index, State::Computed, Reason::Lost) });
        Ok(values)
    }
}
