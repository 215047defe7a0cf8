//! Runs the tasks of a batch, one by one or several at the same time. The first task always runs alone, to fill the cache for the others.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use maquette_engine::eval::Observer;
use maquette_engine::session::Session;
use maquette_golden::sweep::Task;
use maquette_graph::file_stat::FINE_GRAIN;
use maquette_node::CancelToken;

use super::record::Record;
use super::run::{Batch, DueTask, TaskStatus};
use super::time_limit::TimeLimit;
use crate::events::BothObservers;

/// A finished task.
pub(crate) struct FinishedTask {
    /// The index of the task in the sweep.
    pub(crate) index: usize,
    pub(crate) record: Record,
    /// True if the task was run now, false if its record was already up to date.
    pub(crate) was_run: bool,
}

/// Receives the progress of tasks. The methods may be called from any thread.
pub(crate) trait TaskObserver: Sync {
    /// Called when a task begins.
    fn on_begin(&self, index: usize);
    /// Called when a task has ended.
    fn on_end(&self, ended: FinishedTask);
}

/// Options for running the tasks of a batch.
pub(crate) struct ExecutionOptions<'a> {
    /// The maximum number of tasks that run at the same time.
    pub(crate) jobs: usize,
    /// Creates a session. It is called once for each of the sessions that run tasks at the same time.
    pub(crate) session: &'a (dyn Fn() -> Result<Session, String> + Sync),
    /// Is called with each session after its last task.
    pub(crate) finish: &'a (dyn Fn(&Session) + Sync),
    pub(crate) observer: &'a (dyn Observer + Sync),
    pub(crate) task_observer: &'a dyn TaskObserver,
    pub(crate) cancel: &'a CancelToken,
}

/// Returns the number of tasks that run at the same time, at most `jobs`. The first task runs alone before them and is not counted.
pub(crate) fn job_count(jobs: usize, tasks: usize) -> usize {
    if tasks < 3 { 1 } else { jobs.min(tasks) }
}

impl Batch<'_> {
    /// Runs the given tasks, except those whose record is up to date.
    ///
    /// # Errors
    /// A message if a session cannot be created, or a record cannot be written. Then the remaining tasks are not run.
    pub(crate) fn run_all(
        &self,
        tasks: &[usize],
        running: &ExecutionOptions<'_>,
    ) -> Result<(), String> {
        let next = AtomicUsize::new(0);
        self.sweep_records();
        let mut session = (running.session)()?;
        if running.jobs < 2 {
            self.run_next(&mut session, tasks, &next, running, usize::MAX)?;
            (running.finish)(&session);
            return Ok(());
        }
        // Run the first task alone, so that it fills the cache on disk for the others.
        self.run_next(&mut session, tasks, &next, running, 1)?;
        (running.finish)(&session);
        let failed = Mutex::new(None);
        let work = |mut session: Session| {
            let worked = self.run_next(&mut session, tasks, &next, running, usize::MAX);
            (running.finish)(&session);
            if let Err(why) = worked {
                *failed.lock().unwrap_or_else(PoisonError::into_inner) = Some(why);
                running.cancel.cancel();
            }
        };
        std::thread::scope(|scope| {
            for _ in 1..running.jobs {
                let other = (running.session)()?;
                scope.spawn(|| work(other));
            }
            work(session);
            Ok::<(), String>(())
        })?;
        failed.into_inner().unwrap_or_else(PoisonError::into_inner).map_or(Ok(()), Err)
    }

    /// Runs tasks one by one, until none is left or `limit` tasks have been run.
    fn run_next(
        &self,
        session: &mut Session,
        tasks: &[usize],
        next: &AtomicUsize,
        running: &ExecutionOptions<'_>,
        limit: usize,
    ) -> Result<(), String> {
        let mut count = 0;
        // The tasks that were run recently, each with the time at which it ended.
        let mut young = VecDeque::new();
        while count < limit && !running.cancel.is_cancelled() {
            let Some(&index) = tasks.get(next.fetch_add(1, Ordering::Relaxed)) else { break };
            let task = &self.sweep.tasks[index];
            let ended = match self.status(session, task) {
                TaskStatus::Holds(record) => {
                    self.log_up_to_date(task, record.state);
                    FinishedTask { index, record: *record, was_run: false }
                }
                TaskStatus::Due(due) => {
                    running.task_observer.on_begin(index);
                    count += 1;
                    let Some(record) = self.run_with_log(session, task, *due, running)? else {
                        break;
                    };
                    FinishedTask { index, record, was_run: true }
                }
            };
            if ended.was_run {
                young.push_back((Instant::now(), task));
            }
            running.task_observer.on_end(ended);
            while let Some((_, task)) = young.pop_front_if(|(ran, _)| FINE_GRAIN < ran.elapsed()) {
                self.verify_outputs(task);
            }
        }
        Ok(())
    }

    fn run_with_log(
        &self,
        session: &mut Session,
        task: &Task,
        due: DueTask,
        running: &ExecutionOptions<'_>,
    ) -> Result<Option<Record>, String> {
        let limit = TimeLimit::start(self.time_limit, running.cancel);
        let Some(log) = self.begin_log(task) else {
            return self.run(session, task, due, running.observer, &limit);
        };
        let record =
            self.run(session, task, due, &BothObservers(running.observer, &log), &limit)?;
        log.end(record.as_ref());
        Ok(record)
    }
}
