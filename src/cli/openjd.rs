//! `--events=openjd`: progress for an agent of Open Job Description, which reads it from the lines that a job prints:
//! `openjd_progress: 42` in percent, `openjd_status: ..` and `openjd_fail: ..` in words.

use std::collections::HashMap;
use std::sync::{Mutex, MutexGuard, PoisonError};

use maquette_engine::eval::{Observer, State};
use maquette_node::CancelToken;

use super::events::does_not_stop;
use super::print;

/// Tells how a job goes, of one task or several.
pub(super) struct JobProgress {
    cancel: CancelToken,
    state: Mutex<Work>,
}

#[derive(Default)]
struct Work {
    /// The number of tasks, and of those that have ended.
    tasks: usize,
    ended_tasks: usize,
    /// The number of nodes of the task under way; none if it is unknown.
    nodes: Option<usize>,
    ended_nodes: usize,
    /// The fraction that each node under way has done, if it says so.
    fractions: HashMap<String, f64>,
    /// The last percentage that was told.
    percentage: Option<usize>,
}

impl JobProgress {
    /// The progress of an evaluation, or of several tasks, that this token stops.
    pub(super) fn new(tasks: usize, cancel: CancelToken) -> Self {
        Self { cancel, state: Mutex::new(Work { tasks, ..Work::default() }) }
    }

    /// A task begins.
    pub(super) fn task_begins(&self, name: &str) {
        self.status(&format!("task {name}, progress unknown"));
    }

    /// A task has ended.
    pub(super) fn task_ended(&self) {
        let mut work = self.lock();
        work.ended_tasks += 1;
        (work.nodes, work.ended_nodes) = (None, 0);
        work.fractions.clear();
        work.tell();
    }

    /// Says in words how it goes.
    pub(super) fn status(&self, words: &str) {
        tell("openjd_status", words);
    }

    /// Says why it fails.
    pub(super) fn fail(&self, why: &str) {
        tell("openjd_fail", why);
    }

    fn lock(&self) -> MutexGuard<'_, Work> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Work {
    /// Tells the percentage if it is another one. What has not been told to be more is not told to be less.
    fn tell(&mut self) {
        let of_task = self.nodes.map_or(0.0, |nodes| {
            let done = self.ended_nodes as f64 + self.fractions.values().sum::<f64>();
            (done / nodes.max(1) as f64).min(1.0)
        });
        let all = (self.ended_tasks as f64 + of_task) / self.tasks.max(1) as f64;
        let percentage = (100.0 * all.min(1.0)) as usize;
        if self.percentage.is_none_or(|last| last < percentage) {
            self.percentage = Some(percentage);
            tell("openjd_progress", &percentage.to_string());
        }
    }
}

/// One line for the agent.
fn tell(what: &str, words: &str) {
    let words = words.lines().collect::<Vec<_>>().join(" ");
    print(&format!("{what}: {words}\n"));
}

impl Observer for JobProgress {
    fn planned(&self, count: usize) {
        let mut work = self.lock();
        (work.nodes, work.ended_nodes) = (Some(count), 0);
        work.fractions.clear();
    }

    fn unchanged(&self, count: usize) {
        let mut work = self.lock();
        work.ended_nodes += count;
        work.tell();
    }

    fn started(&self, node: &str) {
        if !self.cancel.is_cancelled() {
            self.status(&format!("computing {node}, progress unknown"));
        }
    }

    fn progress(&self, node: &str, share: f64) {
        let mut work = self.lock();
        let is_first = work.fractions.insert(node.to_owned(), share.clamp(0.0, 1.0)).is_none();
        work.tell();
        drop(work);
        if is_first && !self.cancel.is_cancelled() {
            self.status(&format!("computing {node}"));
        }
    }

    fn does_not_stop(&self, node: &str, kind: &str, pack: &str) {
        self.status(&does_not_stop(node, kind, pack));
    }

    fn finished(&self, node: &str, _: State, _: f64) {
        let mut work = self.lock();
        work.ended_nodes += 1;
        work.fractions.remove(node);
        work.tell();
    }
}
