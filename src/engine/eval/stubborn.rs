//! Tells of nodes that go on though the evaluation was told to stop.

use std::collections::BTreeSet;
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::thread::{Builder, scope};
use std::time::{Duration, Instant};

use super::lock;
use super::run::Run;

/// A node that was told to stop has this long to end before somebody is told that it does not.
const PATIENCE: Duration = Duration::from_secs(2);

/// How often it is looked whether the evaluation was told to stop.
const SPACING: Duration = Duration::from_millis(100);

impl Run<'_> {
    /// Does the work of the evaluation; meanwhile a thread of its own looks for nodes that take no notice of its end.
    pub(super) fn told_of_stubborn_nodes<R>(&self, work: impl FnOnce() -> R) -> R {
        let (over, ended) = channel::<()>();
        scope(|scope| {
            // Without the thread the evaluation is as good.
            let _ = Builder::new().spawn_scoped(scope, move || self.look_for_stubborn(&ended));
            let result = work();
            drop(over);
            result
        })
    }

    fn look_for_stubborn(&self, ended: &Receiver<()>) {
        let mut stopped: Option<Instant> = None;
        let mut told = BTreeSet::new();
        while ended.recv_timeout(SPACING) == Err(RecvTimeoutError::Timeout) {
            if !self.cancel.is_cancelled()
                || stopped.get_or_insert_with(Instant::now).elapsed() < PATIENCE
            {
                continue;
            }
            let stubborn = lock(&self.under_way).clone();
            for index in stubborn {
                if told.insert(index) {
                    let node = &self.graph.nodes()[index];
                    self.observer.does_not_stop(&node.name, node.kind(), node.pack);
                }
            }
        }
    }
}
