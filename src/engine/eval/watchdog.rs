//! Reports nodes that continue to run after the evaluation was cancelled.

use std::collections::BTreeSet;
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::thread::{Builder, scope};
use std::time::{Duration, Instant};

use super::lock;
use super::run::Run;

/// The time after a cancellation before a node that is still running is reported.
const STOP_TIMEOUT: Duration = Duration::from_secs(2);

/// The interval at which the watchdog checks for a cancellation.
const POLL_INTERVAL: Duration = Duration::from_millis(100);

impl Run<'_> {
    /// Runs `work` while a separate thread watches for nodes that do not stop after a cancellation.
    pub(super) fn run_with_watchdog<R>(&self, work: impl FnOnce() -> R) -> R {
        let (over, ended) = channel::<()>();
        scope(|scope| {
            // Ignore an error: if the thread cannot be started, the evaluation runs without the watchdog.
            let _ = Builder::new().spawn_scoped(scope, move || self.watch_unresponsive(&ended));
            let result = work();
            drop(over);
            result
        })
    }

    fn watch_unresponsive(&self, ended: &Receiver<()>) {
        let mut stopped: Option<Instant> = None;
        let mut reported = BTreeSet::new();
        while ended.recv_timeout(POLL_INTERVAL) == Err(RecvTimeoutError::Timeout) {
            if !self.cancel.is_cancelled()
                || stopped.get_or_insert_with(Instant::now).elapsed() < STOP_TIMEOUT
            {
                continue;
            }
            let running = lock(&self.running).clone();
            for index in running {
                if reported.insert(index) {
                    let node = &self.graph.nodes()[index];
                    self.observer.on_unresponsive(&node.name, node.kind(), node.pack);
                }
            }
        }
    }
}
