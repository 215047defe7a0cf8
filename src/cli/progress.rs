//! A progress bar on stderr. It is shown if stderr is a terminal and the work takes longer than half a second.

use std::io::IsTerminal;
use std::sync::mpsc::{Sender, channel};
use std::thread::JoinHandle;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use maquette_engine::eval::{Observer, State};

use super::eprint;
use super::events::unresponsive_message;

/// The time after which the progress bar is shown.
const SHOW_DELAY: Duration = Duration::from_millis(500);

pub(super) struct Progress {
    bar: ProgressBar,
    /// The thread that shows the bar after [`SHOW_DELAY`]. It ends when the sender is dropped.
    shower: Option<(Sender<()>, JoinHandle<()>)>,
}

impl Progress {
    pub(super) fn new(nodes: usize) -> Self {
        let bar = ProgressBar::with_draw_target(Some(nodes as u64), ProgressDrawTarget::hidden());
        if let Ok(style) = ProgressStyle::with_template("{bar:24} {pos}/{len} {elapsed} {msg}") {
            bar.set_style(style);
        }
        let shower = std::io::stderr().is_terminal().then(|| {
            let (sender, receiver) = channel();
            let shown = bar.clone();
            let thread = std::thread::spawn(move || {
                if receiver.recv_timeout(SHOW_DELAY).is_err() {
                    shown.set_draw_target(ProgressDrawTarget::stderr());
                    shown.enable_steady_tick(Duration::from_millis(100));
                }
            });
            (sender, thread)
        });
        Self { bar, shower }
    }

    /// Removes the progress bar from the terminal.
    pub(super) fn end(self) {
        if let Some((sender, thread)) = self.shower {
            let _ = sender.send(());
            let _ = thread.join();
        }
        self.bar.finish_and_clear();
    }
}

impl Observer for Progress {
    fn on_start(&self, node: &str) {
        self.bar.set_message(format!("{node}, progress unknown"));
    }

    fn on_progress(&self, node: &str, share: f64) {
        self.bar.set_message(format!("{node} {:.0} %", share * 100.0));
    }

    fn on_unresponsive(&self, node: &str, kind: &str, pack: &str) {
        let words = unresponsive_message(node, kind, pack);
        self.bar.suspend(|| eprint(&format!("{words}; Ctrl-C again ends the program\n")));
    }

    fn on_unchanged(&self, count: usize) {
        self.bar.inc(count as u64);
    }

    fn on_finish(&self, _: &str, _: State, _: f64) {
        self.bar.inc(1);
    }
}
