//! What must be looked at, found before anything runs: the work grows with what changed, not with the graph.

use std::sync::Arc;

use super::Evaluator;
use super::snapshot::{Fate, Snapshot};
use crate::graph::Graph;

/// Which nodes an evaluation looks at.
pub(super) struct Plan {
    pub(super) wanted: Arc<[bool]>,
    pub(super) tasks: Vec<Task>,
    /// The nodes that are not what stood at their place last time, whether wanted or not.
    pub(super) replaced: Vec<usize>,
    /// How many nodes have a task.
    active: usize,
}

/// What an evaluation does with a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Task {
    /// Nothing: it is as it was, or nobody needs it.
    None,
    /// Something about it changed, or something that it hangs on: it may have to be computed.
    Look,
    /// Nothing changed, but its values are needed and gone.
    Restore,
    /// Nothing changed, but it is computed to compare the result.
    Verify,
}

impl Plan {
    pub(super) fn new(
        evaluator: &Evaluator,
        graph: &Graph,
        roots: &[usize],
        values: &[usize],
    ) -> Self {
        let count = graph.nodes.len();
        let wanted = wanted(graph, roots);
        let Some(last) = &evaluator.last else {
            let task = |&wanted: &bool| if wanted { Task::Look } else { Task::None };
            let tasks = Vec::from_iter(wanted.iter().map(task));
            let active = wanted.iter().filter(|wanted| **wanted).count();
            return Self { active, wanted, tasks, replaced: Vec::new() };
        };
        let mut tasks = vec![Task::None; count];
        let mut active = 0;
        let mut mark = |tasks: &mut Vec<Task>, index: usize, task| {
            if wanted[index] && tasks[index] == Task::None {
                tasks[index] = task;
                active += 1;
                return true;
            }
            false
        };
        let replaced = Vec::from_iter(graph.shape.differences(&last.shape));
        let mut changed = changed(evaluator, last, graph, &wanted);
        changed.extend(&replaced);
        while let Some(index) = changed.pop() {
            if mark(&mut tasks, index, Task::Look) {
                changed.extend(graph.shape.users(index).iter().map(|&user| user as usize));
            }
        }
        if 0.0 < evaluator.verify {
            for index in 0..count {
                if last.fates.get(index).is_some_and(|fate| evaluator.verifies(fate)) {
                    mark(&mut tasks, index, Task::Verify);
                }
            }
        }
        // Backwards, so that what a restored node needs is met after it.
        let mut needed = vec![false; count];
        values.iter().for_each(|&node| needed[node] = true);
        let mut look = |index: usize, tasks: &mut Vec<Task>, needed: &mut Vec<bool>| {
            let lost = needed[index] && tasks[index] == Task::None && !evaluator.has(last, index);
            if lost {
                mark(tasks, index, Task::Restore);
            }
            if tasks[index] != Task::None {
                graph.shape.sources(index).iter().for_each(|&node| needed[node as usize] = true);
            }
        };
        for index in (0..count).rev() {
            if needed[index] || tasks[index] != Task::None {
                look(index, &mut tasks, &mut needed);
            }
        }
        Self { wanted, tasks, replaced, active }
    }

    pub(super) fn has_work(&self) -> bool {
        0 < self.active
    }

    /// How many of the wanted nodes are as they were.
    pub(super) fn unchanged(&self) -> usize {
        self.wanted.iter().filter(|wanted| **wanted).count() - self.active
    }
}

/// The nodes that these roots hang on, and the roots.
fn wanted(graph: &Graph, roots: &[usize]) -> Arc<[bool]> {
    let mut wanted = vec![false; graph.nodes.len()];
    roots.iter().for_each(|&root| wanted[root] = true);
    // Each node comes after those that it hangs on, so backwards every user is met before what it uses.
    for index in (0..wanted.len()).rev() {
        if wanted[index] {
            graph.shape.sources(index).iter().for_each(|&node| wanted[node as usize] = true);
        }
    }
    wanted.into()
}

/// The wanted nodes that did not succeed last time, or read a file that is not as it was.
fn changed(evaluator: &Evaluator, last: &Snapshot, graph: &Graph, wanted: &[bool]) -> Vec<usize> {
    let failed = |index: &usize| !matches!(last.fates.get(*index), Some(Fate::Current(_)));
    let mut changed =
        Vec::from_iter((0..wanted.len()).filter(|&index| wanted[index]).filter(failed));
    changed.extend(graph.shape.readers.iter().filter(|&&index| {
        let found = graph.nodes[index].files.iter().map(|file| evaluator.files.look(&file.path));
        let before = last.fates.get(index);
        wanted[index]
            && before.is_some_and(|before| match before {
                Fate::Current(done) => !found.eq(done.parts.files.iter().map(|hash| Some(*hash))),
                _ => false,
            })
    }));
    changed
}

impl Evaluator {
    /// Whether a node's values can be had without computing them.
    fn has(&self, last: &Snapshot, index: usize) -> bool {
        last.current(index).is_some_and(|done| {
            done.outcome.has_values() || self.known_results().is_some_and(|disk| disk.has(done.key))
        })
    }

    /// Whether a result is among those that are compared.
    fn verifies(&self, fate: &Fate) -> bool {
        let Fate::Current(done) = fate else { return false };
        let [a, b, ..] = done.key.0;
        f64::from(u16::from_le_bytes([a, b])) < self.verify * 65536.0
    }
}
