//! `--events`: reports progress to other programs while a command runs, as one JSON object per line on stdout. The field `event` is the
//! kind of event:
//!
//! | event | meaning |
//! |---|---|
//! | `watching` | all `files` are watched from this time on; `polled` is the reason why files are polled, if they are (`watch` only) |
//! | `run` | the evaluation with the number `run` begins, because the files `changed` have new contents (`watch` only) |
//! | `started` | `node` is being computed; its `progress` is "unknown" until an event `progress` |
//! | `progress` | `node` has done the fraction `share` (0 to 1) of its work |
//! | `stubborn` | `node`, of the type `type` in the pack `pack`, still runs 2 s after the cancellation; `why` is a message |
//! | `finished` | `node` ended with `state` after `seconds` of work; unchanged nodes are only in `done` |
//! | `cancelled` | the evaluation `run` was stopped because of a newer change; it has no further events (`watch` only) |
//! | `problems` | all current diagnostics, as in `--json`: once after the check, once after the nodes have run; may be empty |
//! | `written` | a file of an output is on disk; `unchanged` is true if it already had the same bytes |
//! | `done` | the evaluation `run` has ended: `ok`, the number of nodes by state, the `nodes` as in `--json`, `seconds` |
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

/// The minimum time between two `progress` events of the same node.
const MIN_PROGRESS_INTERVAL: Duration = Duration::from_millis(100);

/// The result of an evaluation. Also used for a graph that was not evaluated because it has errors.
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

/// A function that receives events.
#[derive(Clone)]
pub(super) struct Listener(Arc<dyn Fn(&Json) + Send + Sync>);

impl Listener {
    pub(super) fn new(receive: impl Fn(&Json) + Send + Sync + 'static) -> Self {
        Self(Arc::new(receive))
    }

    /// Creates a listener that writes each event as a line to stdout.
    pub(super) fn of_stdout() -> Self {
        Self::new(|event| print_as_it_is(&escape_json(&format!("{event}\n"))))
    }

    /// Sends an event with the name `event`. `fields` is a JSON object with its other fields.
    pub(super) fn send(&self, event: &str, fields: Json) {
        let mut all = serde_json::Map::new();
        all.insert("event".into(), event.into());
        if let Json::Object(fields) = fields {
            all.extend(fields);
        }
        self.0(&Json::Object(all));
    }

    /// Sends an event object that is already complete.
    pub(super) fn forward(&self, event: &Json) {
        self.0(event);
    }

    /// Sends the `written` events and the final `done` event of an evaluation.
    pub(super) fn send_end(&self, ending: &RunEnd<'_>) {
        for file in ending.written {
            let mut event = file.to_json();
            event["unchanged"] = file.unchanged.into();
            self.send("written", event);
        }
        self.send("done", done_event(ending));
    }

    /// Sends the `problems` event with all diagnostics.
    pub(super) fn send_problems(&self, diagnostics: &[Diagnostic]) {
        let mut fields = json!({});
        put_problems(&mut fields, diagnostics);
        self.send("problems", fields);
    }
}

/// An observer of an evaluation that sends the events of nodes.
pub(super) struct Events {
    listener: Listener,
    cancel: CancelToken,
    /// The time of the last `progress` event of each node, by the name of the node.
    last_sent: Mutex<HashMap<String, Instant>>,
}

impl Events {
    /// Creates an observer for one evaluation. It sends no more events after `cancel` is cancelled.
    pub(super) fn new(listener: Listener, cancel: CancelToken) -> Self {
        Self { listener, cancel, last_sent: Mutex::default() }
    }
}

/// Returns the message about a node that still runs after its evaluation was cancelled.
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
