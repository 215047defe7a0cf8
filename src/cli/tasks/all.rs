//! Runs the tasks of a batch: one after the other, or several at a time once the first has found what they have in common.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use maquette_engine::eval::Observer;
use maquette_engine::session::Session;
use maquette_golden::sweep::Task;
use maquette_graph::stamp::FINE_GRAIN;
use maquette_node::CancelToken;

use super::record::Record;
use super::run::{Batch, Due, Standing};
use super::time_limit::TimeLimit;
use crate::events::Both;

/// A task that came to its end.
pub(crate) struct Ended {
    /// Which of the sweep's.
    pub(crate) index: usize,
    pub(crate) record: Record,
    /// Whether it was run now, and did not still hold.
    pub(crate) was_run: bool,
}

/// Hears what happens to tasks, from any thread.
pub(crate) trait Hearer: Sync {
    /// A task begins.
    fn begins(&self, index: usize);
    /// A task has ended.
    fn ended(&self, ended: Ended);
}

/// How tasks are run.
pub(crate) struct Running<'a> {
    /// How many at a time.
    pub(crate) jobs: usize,
    /// Makes a session for each of them.
    pub(crate) session: &'a (dyn Fn() -> Result<Session, String> + Sync),
    /// Is called with each session when there is nothing more to do for it.
    pub(crate) finish: &'a (dyn Fn(&Session) + Sync),
    pub(crate) observer: &'a (dyn Observer + Sync),
    pub(crate) hearer: &'a dyn Hearer,
    pub(crate) cancel: &'a CancelToken,
}

/// How many of some tasks are run at a time, where so many may be: the first is run alone.
pub(crate) fn at_a_time(jobs: usize, tasks: usize) -> usize {
    if tasks < 3 { 1 } else { jobs.min(tasks) }
}

impl Batch<'_> {
    /// Runs these tasks, except those that need not be.
    ///
    /// # Errors
    /// In words, if there can be no session, or a record cannot be written: the rest is not run then.
    pub(crate) fn run_all(&self, tasks: &[usize], running: &Running<'_>) -> Result<(), String> {
        let next = AtomicUsize::new(0);
        self.sweep_records();
        let mut session = (running.session)()?;
        if running.jobs < 2 {
            self.worked(&mut session, tasks, &next, running, usize::MAX)?;
            (running.finish)(&session);
            return Ok(());
        }
        // What the first one finds on the way, the others find on disk.
        self.worked(&mut session, tasks, &next, running, 1)?;
        (running.finish)(&session);
        let failed = Mutex::new(None);
        let work = |mut session: Session| {
            let worked = self.worked(&mut session, tasks, &next, running, usize::MAX);
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

    /// Works until no task is left, or so many have been run.
    fn worked(
        &self,
        session: &mut Session,
        tasks: &[usize],
        next: &AtomicUsize,
        running: &Running<'_>,
        most: usize,
    ) -> Result<(), String> {
        let mut count = 0;
        // Those that were run a moment ago, and when.
        let mut young = VecDeque::new();
        while count < most && !running.cancel.is_cancelled() {
            let Some(&index) = tasks.get(next.fetch_add(1, Ordering::Relaxed)) else { break };
            let task = &self.sweep.tasks[index];
            let ended = match self.standing(session, task) {
                Standing::Holds(record) => {
                    self.note_unchanged(task, record.state);
                    Ended { index, record: *record, was_run: false }
                }
                Standing::Due(due) => {
                    running.hearer.begins(index);
                    count += 1;
                    let Some(record) = self.run_logged(session, task, *due, running)? else {
                        break;
                    };
                    Ended { index, record, was_run: true }
                }
            };
            if ended.was_run {
                young.push_back((Instant::now(), task));
            }
            running.hearer.ended(ended);
            while let Some((_, task)) = young.pop_front_if(|(ran, _)| FINE_GRAIN < ran.elapsed()) {
                self.settle(task);
            }
        }
        Ok(())
    }

    fn run_logged(
        &self,
        session: &mut Session,
        task: &Task,
        due: Due,
        running: &Running<'_>,
    ) -> Result<Option<Record>, String> {
        let limit = TimeLimit::start(self.time_limit, running.cancel);
        let Some(log) = self.begin_log(task) else {
            return self.run(session, task, due, running.observer, &limit);
        };
        let record = self.run(session, task, due, &Both(running.observer, &log), &limit)?;
        log.end(record.as_ref());
        Ok(record)
    }
}
