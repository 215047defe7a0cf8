//! What happened to each node, and why: data, for people, programs and tests.

use std::fmt;

use maquette_graph::{GraphNode, INPUT, in_short, parameter_name};
use maquette_syntax::with_article;
use serde_json::json;

use super::key::Change;

/// What became of a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    /// Not run, and nothing that it hangs on ran.
    Cached,
    /// Not run, because what it hangs on was computed anew and came out the same.
    Equal,
    /// It ran.
    Computed,
    /// It ran and failed.
    Failed,
    /// It hangs on a node that failed.
    Skipped,
}

impl State {
    /// The word in traces.
    pub fn word(self) -> &'static str {
        match self {
            Self::Cached => "cached",
            Self::Equal => "equal",
            Self::Computed => "computed",
            Self::Failed => "failed",
            Self::Skipped => "skipped",
        }
    }
}

/// Why a node came to its end.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Reason {
    /// Nothing that it depends on changed.
    Unchanged,
    /// Its inputs came out the same.
    SameInputs,
    /// Something changed, but to what it was computed from at another time.
    Before(Change),
    /// Nothing is known of an earlier result.
    First,
    /// Something changed.
    Changed(Change),
    /// Its result was dropped, or what was kept of it is damaged.
    Lost,
    /// Its result was too little work to be kept on disk.
    Cheap,
    /// The user wanted it computed, to compare.
    Verified,
    /// Its file of this index may have changed: to know, a forecast would have to read all of it.
    Unread(usize),
    /// It hangs on this node.
    HangsOn(usize),
    /// An error, in words.
    Error(String),
}

impl Reason {
    pub(crate) fn in_words(&self, node: &GraphNode, nodes: &[GraphNode]) -> String {
        match self {
            Self::Unchanged => "nothing that it depends on changed".into(),
            Self::SameInputs => "its inputs came out the same".into(),
            Self::Before(change) => {
                format!("{}, as it was computed before", in_words(change, node))
            }
            Self::First => "not computed before".into(),
            Self::Changed(change) => in_words(change, node),
            Self::Lost => "its result is no longer in the cache".into(),
            Self::Cheap => {
                "computed again (cheap): it was too little work to be kept on disk".into()
            }
            Self::Verified => "computed again to compare it with its cached result".into(),
            Self::Unread(index) => {
                format!("file {} may have changed and was not read", node.files[*index].given)
            }
            Self::HangsOn(index) => format!("hangs on `{}`", nodes[*index].name),
            Self::Error(words) => words.clone(),
        }
    }
}

fn in_words(change: &Change, node: &GraphNode) -> String {
    match change {
        Change::Kind { before } => format!("it was {} before", with_article(before)),
        // The value at an input of the graph, by its hash.
        Change::Parameter { .. } if node.kind() == INPUT => "it gets another value".to_owned(),
        Change::Parameter { path, before, now } => {
            let name = parameter_name(path);
            format!("parameter `{name}` {} -> {}", in_short(before), in_short(now))
        }
        Change::Input(index) => format!("input `{}` changed", node.links[*index].port),
        Change::File(index) => format!("file {} changed", node.files[*index].given),
    }
}

/// What happened to one node.
#[derive(Clone, Debug, PartialEq)]
pub struct NodeTrace {
    /// Its name in the graph.
    pub name: String,
    /// Its type.
    pub node: String,
    /// What became of it.
    pub state: State,
    /// Whether it ran and gave the same as last time.
    pub unchanged: bool,
    /// Why.
    pub reason: String,
    /// When it began, in seconds from the evaluation's start; 0 if it did not run.
    pub start: f64,
    /// How long it ran, in seconds; 0 if it did not.
    pub seconds: f64,
    /// The thread on which it ran, from 0.
    pub thread: usize,
    /// How much memory its results need.
    pub bytes: usize,
    /// How many bytes it said that it needs at most, if it ran and can say that: see [`Node::estimate`](maquette_node::Node::estimate).
    pub estimate: Option<f64>,
    /// Its warnings about the results.
    pub warnings: Vec<String>,
}

impl NodeTrace {
    /// The trace as `--json` prints it.
    pub fn to_json(&self) -> serde_json::Value {
        let mut json = json!({
            "name": self.name,
            "node": self.node,
            "state": self.state.word(),
            "reason": self.reason,
            "seconds": self.seconds,
            "bytes": self.bytes,
            "warnings": self.warnings,
        });
        if self.unchanged {
            json["unchanged"] = true.into();
        }
        json
    }
}

/// What happened in a run to each node that was needed, in the graph's order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RunTrace(pub Vec<NodeTrace>);

impl RunTrace {
    /// How many nodes came to this end.
    pub fn count(&self, state: State) -> usize {
        self.0.iter().filter(|node| node.state == state).count()
    }

    /// The trace in the format of Chrome's tracing page and Perfetto: one bar for each node that ran, one row for each thread.
    pub fn to_chrome(&self) -> serde_json::Value {
        let ran = self.0.iter().filter(|node| node.seconds > 0.0);
        let events = ran.map(|node| {
            json!({
                "name": node.name,
                "cat": node.node,
                "ph": "X",
                "ts": node.start * 1e6,
                "dur": node.seconds * 1e6,
                "pid": 1,
                "tid": node.thread,
                "args": { "state": node.state.word(), "reason": node.reason, "bytes": node.bytes },
            })
        });
        json!({ "displayTimeUnit": "ms", "traceEvents": events.collect::<Vec<_>>() })
    }
}

/// One node a line: what became of it, its name, and why, without times.
impl fmt::Display for RunTrace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let longest = self.0.iter().map(|node| node.name.len()).max().unwrap_or(0);
        for node in &self.0 {
            let unchanged = if node.unchanged { "; came out the same" } else { "" };
            let (state, name, reason) = (node.state.word(), &node.name, &node.reason);
            writeln!(f, "{state:<8} {name:<longest$}  {reason}{unchanged}")?;
        }
        Ok(())
    }
}
