//! `--events`: reports progress to other programs while a command runs, as one JSON object per line on stdout. The field `event` is the
//! kind:
//!
//! | event | meaning |
//! |---|---|
//! | `watching` | all `files` are watched from now on; `polled` is the reason why files are polled, if they are (`watch` only) |
//! | `run` | evaluation `run` begins, because the contents of `changed` changed (`watch` only) |
//! | `started` | `node` is being computed; its `progress` is "unknown" until an event `progress` |
//! | `progress` | `node` has done the fraction `share` (0 to 1) of its work |
//! | `stubborn` | the evaluation was cancelled 2 s ago, but `node`, a `type` of `pack`, still runs; `why` is a message |
//! | `finished` | `node` ended with `state` after `seconds` of work; unchanged nodes are only in `done` |
//! | `cancelled` | evaluation `run` was stopped by a newer change and has no further events (`watch` only) |
//! | `problems` | all present diagnostics, as in `--json`: once after the check, once after the nodes have run; the list may be empty |
//! | `written` | a file of an output is on disk; `unchanged` if it already had the same bytes |
//! | `done` | `run` has ended: `ok`, the number of nodes by state, the `nodes` as in `--json`, `seconds` |
//!
//! A reader must skip unknown events and fields.

use std::collections::HashMap;
use std::ops::Deref;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use maquette_engine::eval::{NodeTrace, Observer, RunTrace, State};
use maquette_engine::session::OutputFile;
use maquette_node::CancelToken;
use maquette_syntax::diagnostics::escape_json;
use maquette_syntax::error::Diagnostic;
use serde_json::{Value as Json, json};

use super::{has_errors, print_as_it_is, put_problems};

/// The format of events.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum EventFormat {
    /// One JSON object per line.
    Json,
    /// Lines for an agent of Open Job Description: `openjd_progress: 42`, `openjd_status: ..`.
    Openjd,
}

/// The minimum time between two consecutive `progress` events of one node.
const MIN_PROGRESS_INTERVAL: Duration = Duration::from_millis(100);

/// The result of an evaluation, or of a graph with errors that could not be evaluated.
pub(super) struct RunEnd<'a> {
    pub(super) run: usize,
    pub(super) trace: Option<&'a RunTrace>,
    pub(super) written: &'a [OutputFile],
    pub(super) diagnostics: &'a [Diagnostic],
    pub(super) seconds: f64,
}

impl RunEnd<'_> {
    pub(super) fn is_ok(&self) -> bool {
        !has_errors(self.diagnostics)
    }
}

/// A receiver of events.
#[derive(Clone)]
pub(super) struct Listener(Arc<dyn Fn(&Json) + Send + Sync>);

impl Listener {
    pub(super) fn new(receive: impl Fn(&Json) + Send + Sync + 'static) -> Self {
        Self(Arc::new(receive))
    }

    /// Creates a listener that writes one event per line to stdout.
    pub(super) fn of_stdout() -> Self {
        Self::new(|event| print_as_it_is(&escape_json(&format!("{event}\n"))))
    }

    /// Sends an event; `fields` is a JSON object.
    pub(super) fn send(&self, event: &str, fields: Json) {
        let mut all = serde_json::Map::new();
        all.insert("event".into(), event.into());
        if let Json::Object(fields) = fields {
            all.extend(fields);
        }
        self.0(&Json::Object(all));
    }

    /// Sends an event object that already has all of its fields.
    pub(super) fn forward(&self, event: &Json) {
        self.0(event);
    }

    /// Sends the `written` events and the `done` event of an evaluation.
    pub(super) fn send_end(&self, ending: &RunEnd<'_>) {
        for file in ending.written {
            let mut event = file.to_json();
            event["unchanged"] = file.unchanged.into();
            self.send("written", event);
        }
        self.send("done", done_event(ending));
    }

    /// Sends the `problems` event.
    pub(super) fn send_problems(&self, diagnostics: &[Diagnostic]) {
        let mut fields = json!({});
        put_problems(&mut fields, diagnostics);
        self.send("problems", fields);
    }
}

/// An observer that sends the events of nodes.
pub(super) struct Events {
    listener: Listener,
    cancel: CancelToken,
    /// The time of the last `progress` event of each node.
    last_sent: Mutex<HashMap<String, Instant>>,
}

impl Events {
    /// Creates an observer for one evaluation. The observer sends no events after `cancel` is cancelled.
    pub(super) fn new(listener: Listener, cancel: CancelToken) -> Self {
        Self { listener, cancel, last_sent: Mutex::default() }
    }
}

/// Returns the message for a node that continues to run after its evaluation was cancelled.
pub(super) fn unresponsive_message(node: &str, kind: &str, pack: &str) -> String {
    format!("node `{node}` ({kind} of pack {pack}) does not stop")
}

fn done_event(ending: &RunEnd<'_>) -> Json {
    fn count(state: State, trace: Option<&RunTrace>) -> usize {
        trace.map_or(0, |trace| trace.count(state))
    }
    let nodes = ending.trace.iter().flat_map(|trace| &trace.0);
    json!({
        "nodes": nodes.map(NodeTrace::to_json).collect::<Vec<_>>(),
        "run": ending.run,
        "ok": ending.is_ok(),
        "computed": count(State::Computed, ending.trace),
        "equal": count(State::Equal, ending.trace),
        "cached": count(State::Cached, ending.trace),
        "failed": count(State::Failed, ending.trace),
        "skipped": count(State::Skipped, ending.trace),
        "seconds": ending.seconds,
    })
}

impl Observer for Events {
    fn on_start(&self, node: &str) {
        if !self.cancel.is_cancelled() {
            self.listener.send("started", json!({ "node": node, "progress": "unknown" }));
        }
    }

    fn on_progress(&self, node: &str, share: f64) {
        if self.cancel.is_cancelled() {
            return;
        }
        let mut last_sent = self.last_sent.lock().unwrap_or_else(|broken| broken.into_inner());
        let now = Instant::now();
        if last_sent.get(node).is_some_and(|&last| now < last + MIN_PROGRESS_INTERVAL) {
            return;
        }
        last_sent.insert(node.to_owned(), now);
        drop(last_sent);
        self.listener.send("progress", json!({ "node": node, "share": share }));
    }

    fn on_unresponsive(&self, node: &str, kind: &str, pack: &str) {
        let why = unresponsive_message(node, kind, pack);
        self.listener
            .send("stubborn", json!({ "node": node, "type": kind, "pack": pack, "why": why }));
    }

    fn on_finish(&self, node: &str, state: State, seconds: f64) {
        if !self.cancel.is_cancelled() {
            let state = state.word();
            self.listener
                .send("finished", json!({ "node": node, "state": state, "seconds": seconds }));
        }
    }
}

/// An observer that passes the events of an evaluation to two other observers.
pub(crate) struct BothObservers<A, B>(pub(crate) A, pub(crate) B);

impl<A, B> Observer for BothObservers<A, B>
where
    A: Deref<Target: Observer> + Sync,
    B: Deref<Target: Observer> + Sync,
{
    fn on_plan(&self, count: usize) {
        self.0.on_plan(count);
        self.1.on_plan(count);
    }

    fn on_unchanged(&self, count: usize) {
        self.0.on_unchanged(count);
        self.1.on_unchanged(count);
    }

    fn on_start(&self, node: &str) {
        self.0.on_start(node);
        self.1.on_start(node);
    }

    fn on_progress(&self, node: &str, share: f64) {
        self.0.on_progress(node, share);
        self.1.on_progress(node, share);
    }

    fn on_unresponsive(&self, node: &str, kind: &str, pack: &str) {
        self.0.on_unresponsive(node, kind, pack);
        self.1.on_unresponsive(node, kind, pack);
    }

    fn on_finish(&self, node: &str, state: State, seconds: f64) {
        self.0.on_finish(node, state, seconds);
        self.1.on_finish(node, state, seconds);
    }
}
