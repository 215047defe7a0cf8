//! `--events`: what happens, as it happens, for other programs. One JSON object a line on stdout, each with its kind in `event`:
//!
//! | event | says |
//! |---|---|
//! | `watching` | everything in `files` is watched from now on, `polled` if events of the system do not suffice (`watch` only) |
//! | `run` | evaluation `run` begins, because the content of `changed` changed (`watch` only) |
//! | `started` | `node` is being computed; its `progress` is "unknown" until an event `progress` says its share |
//! | `progress` | `node` has done this `share` (0 to 1) of its work |
//! | `stubborn` | the evaluation was told to stop 2 s ago, and `node`, a `type` of `pack`, still runs; `why` says so in words |
//! | `finished` | `node` came to the end `state` after `seconds` of work; nodes that are as they were are only in `done` |
//! | `cancelled` | evaluation `run` was stopped by a newer change; nothing more is said of it (`watch` only) |
//! | `problems` | all problems that are known now, as in `--json`: once after the check, once after the nodes have run; an empty list
//! says that there are none any more |
//! | `written` | a file of an output is on disk; `unchanged` if it was there with the same bytes |
//! | `done` | `run` is over: `ok`, how many nodes came to each end, the `nodes` as in `--json`, `seconds` |
//!
//! A reader must skip events and fields that it does not know.

use std::collections::HashMap;
use std::ops::Deref;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use maquette_engine::eval::{NodeTrace, Observer, RunTrace, State};
use maquette_engine::session::Written;
use maquette_node::CancelToken;
use maquette_syntax::error::{Problem, Severity};
use maquette_syntax::telling::escaped;
use serde_json::{Value as Json, json};

use super::{print_as_it_is, put_problems};

/// The form in which events are told.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum EventFormat {
    /// One JSON object a line.
    Json,
    /// Lines that an agent of Open Job Description reads: `openjd_progress: 42`, `openjd_status: ..`.
    Openjd,
}

/// The progress of one node is not told more often than this.
const SPACING: Duration = Duration::from_millis(100);

/// The end of one evaluation, or of an attempt.
pub(super) struct Ending<'a> {
    pub(super) run: usize,
    pub(super) trace: Option<&'a RunTrace>,
    pub(super) written: &'a [Written],
    pub(super) problems: &'a [Problem],
    pub(super) seconds: f64,
}

impl Ending<'_> {
    pub(super) fn is_ok(&self) -> bool {
        self.problems.iter().all(|problem| problem.severity != Severity::Error)
    }
}

/// Whoever events are told to.
#[derive(Clone)]
pub(super) struct Listener(Arc<dyn Fn(&Json) + Send + Sync>);

impl Listener {
    pub(super) fn new(hear: impl Fn(&Json) + Send + Sync + 'static) -> Self {
        Self(Arc::new(hear))
    }

    /// The reader of stdout: one event a line.
    pub(super) fn of_stdout() -> Self {
        Self::new(|event| print_as_it_is(&escaped(&format!("{event}\n"))))
    }

    /// Tells one event; `fields` is an object.
    pub(super) fn tell(&self, event: &str, fields: Json) {
        let mut all = serde_json::Map::new();
        all.insert("event".into(), event.into());
        if let Json::Object(fields) = fields {
            all.extend(fields);
        }
        self.0(&Json::Object(all));
    }

    /// Tells an event that somebody else has made.
    pub(super) fn pass(&self, event: &Json) {
        self.0(event);
    }

    /// Tells what was written, and that it is over.
    pub(super) fn tell_end(&self, ending: &Ending<'_>) {
        for file in ending.written {
            let mut event = file.to_json();
            event["unchanged"] = file.unchanged.into();
            self.tell("written", event);
        }
        self.tell("done", done(ending));
    }

    /// Tells which problems there are now.
    pub(super) fn tell_problems(&self, problems: &[Problem]) {
        let mut fields = json!({});
        put_problems(&mut fields, problems);
        self.tell("problems", fields);
    }
}

/// Tells what happens to nodes.
pub(super) struct Events {
    listener: Listener,
    cancel: CancelToken,
    /// When the progress of each node was last told.
    told: Mutex<HashMap<String, Instant>>,
}

impl Events {
    /// Events of an evaluation that this token stops; then nothing more is said of its nodes.
    pub(super) fn new(listener: Listener, cancel: CancelToken) -> Self {
        Self { listener, cancel, told: Mutex::default() }
    }
}

/// What is said of a node that goes on though it was told to stop.
pub(super) fn does_not_stop(node: &str, kind: &str, pack: &str) -> String {
    format!("node `{node}` ({kind} of pack {pack}) does not stop")
}

fn done(ending: &Ending<'_>) -> Json {
    fn count(state: State, ending_trace: &Option<&RunTrace>) -> usize {
        ending_trace.map_or(0, |trace| trace.count(state))
    }
    let nodes = ending.trace.iter().flat_map(|trace| &trace.0);
    json!({
        "nodes": nodes.map(NodeTrace::to_json).collect::<Vec<_>>(),
        "run": ending.run,
        "ok": ending.is_ok(),
        "computed": count(State::Computed, &ending.trace),
        "equal": count(State::Equal, &ending.trace),
        "cached": count(State::Cached, &ending.trace),
        "failed": count(State::Failed, &ending.trace),
        "skipped": count(State::Skipped, &ending.trace),
        "seconds": ending.seconds,
    })
}

impl Observer for Events {
    fn started(&self, node: &str) {
        if !self.cancel.is_cancelled() {
            self.listener.tell("started", json!({ "node": node, "progress": "unknown" }));
        }
    }

    fn progress(&self, node: &str, share: f64) {
        if self.cancel.is_cancelled() {
            return;
        }
        let mut told = self.told.lock().unwrap_or_else(|broken| broken.into_inner());
        let now = Instant::now();
        if told.get(node).is_some_and(|&last| now < last + SPACING) {
            return;
        }
        told.insert(node.to_owned(), now);
        drop(told);
        self.listener.tell("progress", json!({ "node": node, "share": share }));
    }

    fn does_not_stop(&self, node: &str, kind: &str, pack: &str) {
        let why = does_not_stop(node, kind, pack);
        self.listener
            .tell("stubborn", json!({ "node": node, "type": kind, "pack": pack, "why": why }));
    }

    fn finished(&self, node: &str, state: State, seconds: f64) {
        if !self.cancel.is_cancelled() {
            let state = state.word();
            self.listener
                .tell("finished", json!({ "node": node, "state": state, "seconds": seconds }));
        }
    }
}

/// Two observers of one evaluation.
pub(crate) struct Both<A, B>(pub(crate) A, pub(crate) B);

impl<A, B> Observer for Both<A, B>
where
    A: Deref<Target: Observer> + Sync,
    B: Deref<Target: Observer> + Sync,
{
    fn planned(&self, count: usize) {
        self.0.planned(count);
        self.1.planned(count);
    }

    fn unchanged(&self, count: usize) {
        self.0.unchanged(count);
        self.1.unchanged(count);
    }

    fn started(&self, node: &str) {
        self.0.started(node);
        self.1.started(node);
    }

    fn progress(&self, node: &str, share: f64) {
        self.0.progress(node, share);
        self.1.progress(node, share);
    }

    fn does_not_stop(&self, node: &str, kind: &str, pack: &str) {
        self.0.does_not_stop(node, kind, pack);
        self.1.does_not_stop(node, kind, pack);
    }

    fn finished(&self, node: &str, state: State, seconds: f64) {
        self.0.finished(node, state, seconds);
        self.1.finished(node, state, seconds);
    }
}
