//! `--events=openjd`: reports progress to an agent of Open Job Description, which runs jobs on a farm. The agent reads lines such as
//! `openjd_progress: 42` (in percent), and `openjd_status: ..` and `openjd_fail: ..` with messages.

use std::collections::HashMap;
use std::sync::{Mutex, MutexGuard, PoisonError};

use maquette_engine::eval::{Observer, State};
use maquette_node::CancelToken;

use super::events::unresponsive_message;
use super::print;

/// Reports the progress of a job that consists of one or several tasks.
pub(super) struct JobProgress {
    cancel: CancelToken,
    state: Mutex<JobState>,
}

#[derive(Default)]
struct JobState {
    /// The number of tasks of the job.
    tasks: usize,
    ended_tasks: usize,
    /// The number of nodes of the running task, or `None` if it is unknown.
    nodes: Option<usize>,
    ended_nodes: usize,
    /// The finished fraction (0 to 1) of each running node, by name. Nodes that do not report their progress are missing.
    fractions: HashMap<String, f64>,
    /// The percentage that was last reported.
    percentage: Option<usize>,
}

impl JobProgress {
    /// Creates the report for a job of `tasks` tasks. After `cancel` is cancelled, nothing is reported.
    pub(super) fn new(tasks: usize, cancel: CancelToken) -> Self {
        Self { cancel, state: Mutex::new(JobState { tasks, ..JobState::default() }) }
    }

    /// Reports that a task begins.
    pub(super) fn begin_task(&self, name: &str) {
        self.status(&format!("task {name}, progress unknown"));
    }

    /// Records that a task has ended.
    pub(super) fn end_task(&self) {
        let mut work = self.lock();
        work.ended_tasks += 1;
        (work.nodes, work.ended_nodes) = (None, 0);
        work.fractions.clear();
        work.print_new_percentage();
    }

    /// Reports a status message.
    pub(super) fn status(&self, words: &str) {
        print_line("openjd_status", words);
    }

    /// Reports the reason why the job failed.
    pub(super) fn fail(&self, why: &str) {
        print_line("openjd_fail", why);
    }

    fn lock(&self) -> MutexGuard<'_, JobState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl JobState {
    /// Prints the percentage if it has increased. It is never reported to decrease.
    fn print_new_percentage(&mut self) {
        let of_task = self.nodes.map_or(0.0, |nodes| {
            let done = self.ended_nodes as f64 + self.fractions.values().sum::<f64>();
            (done / nodes.max(1) as f64).min(1.0)
        });
        let all = (self.ended_tasks as f64 + of_task) / self.tasks.max(1) as f64;
        let percentage = (100.0 * all.min(1.0)) as usize;
        if self.percentage.is_none_or(|last| last < percentage) {
            self.percentage = Some(percentage);
            print_line("openjd_progress", &percentage.to_string());
        }
    }
}

/// Prints a line that the agent reads. Line breaks in the message become spaces.
fn print_line(what: &str, words: &str) {
    let words = words.lines().collect::<Vec<_>>().join(" ");
    print(&format!("{what}: {words}\n"));
}

impl Observer for JobProgress {
    fn on_plan(&self, count: usize) {
        let mut work = self.lock();
        (work.nodes, work.ended_nodes) = (Some(count), 0);
        work.fractions.clear();
    }

    fn on_unchanged(&self, count: usize) {
        let mut work = self.lock();
        work.ended_nodes += count;
        work.print_new_percentage();
    }

    fn on_start(&self, node: &str) {
        if !self.cancel.is_cancelled() {
            self.status(&format!("computing {node}, progress unknown"));
        }
    }

    fn on_progress(&self, node: &str, share: f64) {
        let mut work = self.lock();
        let is_first = work.fractions.insert(node.to_owned(), share.clamp(0.0, 1.0)).is_none();
        work.print_new_percentage();
        drop(work);
        if is_first && !self.cancel.is_cancelled() {
            self.status(&format!("computing {node}"));
        }
    }

    fn on_unresponsive(&self, node: &str, kind: &str, pack: &str) {
        self.status(&unresponsive_message(node, kind, pack));
    }

    fn on_finish(&self, node: &str, _: State, _: f64) {
        let mut work = self.lock();
        work.ended_nodes += 1;
        work.fractions.remove(node);
        work.print_new_percentage();
    }
}
