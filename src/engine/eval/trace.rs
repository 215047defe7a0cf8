//! Traces: the state of each node after an evaluation, and the reason for it.

use std::fmt;

use maquette_graph::{GraphNode, INPUT, parameter_name, short_text};
use maquette_syntax::with_article;
use serde_json::json;

use super::key::Change;

/// The state of a node after an evaluation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    /// Neither the node nor any of its dependencies ran.
    Cached,
    /// The node did not run: its dependencies were computed again, but their results did not change.
    Equal,
    /// The node ran and succeeded.
    Computed,
    /// The node ran and failed.
    Failed,
    /// The node was not run because it depends on a node that failed.
    Skipped,
}

impl State {
    /// Returns the word for the state in traces.
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

/// The reason why a node is in its state.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Reason {
    /// Nothing that the node depends on changed.
    Unchanged,
    /// The inputs of the node were computed again and did not change.
    SameInputs,
    /// The node changed back to an earlier state, whose result was still in the cache.
    Before(Change),
    /// The node has no earlier result to compare with.
    First,
    /// The node changed in this way since its last result.
    Changed(Change),
    /// The cached result of the node was dropped or is damaged.
    Lost,
    /// The result of the node was not written to disk, because computing it again is cheap.
    Cheap,
    /// The user asked to compare cached results with new ones.
    Verified,
    /// The file with this index may have changed. A forecast cannot tell, because the file is large and forecasts do not read large files.
    Unread(usize),
    /// The node depends on the node with this index.
    DependsOn(usize),
    /// The node failed with this error message.
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
                "computed again (cheap): its computation was too short to be stored on disk".into()
            }
            Self::Verified => "computed again to compare it with its cached result".into(),
            Self::Unread(index) => {
                format!("file {} may have changed and was not read", node.files[*index].given)
            }
            Self::DependsOn(index) => format!("depends on `{}`", nodes[*index].name),
            Self::Error(words) => words.clone(),
        }
    }
}

fn in_words(change: &Change, node: &GraphNode) -> String {
    match change {
        Change::Kind { before } => format!("it was {} before", with_article(before)),
        // Do not show the change of an input node's parameter: it is only the hash of the input's value.
        Change::Parameter { .. } if node.kind() == INPUT => "it gets another value".to_owned(),
        Change::Parameter { path, before, now } => {
            let name = parameter_name(path);
            format!("parameter `{name}` {} -> {}", short_text(before), short_text(now))
        }
        Change::Input(index) => format!("input `{}` changed", node.links[*index].port),
        Change::File(index) => format!("file {} changed", node.files[*index].given),
    }
}

/// The state of one node after an evaluation, with the reason, times and warnings.
#[derive(Clone, Debug, PartialEq)]
pub struct NodeTrace {
    /// The name of the node in the graph.
    pub name: String,
    /// The type of the node.
    pub node: String,
    /// The state of the node.
    pub state: State,
    /// True if the node ran and its result is the same as the last time.
    pub unchanged: bool,
    /// The reason for the state of the node.
    pub reason: String,
    /// The time at which the node started to run, in seconds after the start of the evaluation; 0 if the node did not run.
    pub start: f64,
    /// The time for which the node ran, in seconds; 0 if the node did not run.
    pub seconds: f64,
    /// The number of the thread on which the node ran, from 0.
    pub thread: usize,
    /// The memory that the results of the node need, in bytes.
    pub bytes: usize,
    /// The node's own estimate of its memory in bytes, or `None` if the node did not run or gives no estimate: see
    /// [`Node::estimate`](maquette_node::Node::estimate).
    pub estimate: Option<f64>,
    /// The warnings of the node.
    pub warnings: Vec<String>,
}

impl NodeTrace {
    /// Returns the trace as JSON, in the form that the option `--json` prints.
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

/// The traces of all nodes that an evaluation needed, in the order of the graph.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RunTrace(pub Vec<NodeTrace>);

impl RunTrace {
    /// Returns the number of nodes in a state.
    pub fn count(&self, state: State) -> usize {
        self.0.iter().filter(|node| node.state == state).count()
    }

    /// Returns the trace in the format of Chrome's tracing page and Perfetto. Each thread is a row, and each node that ran is a bar in it.
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

/// Prints one line per node with its state, name and reason. Times are not printed.
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
