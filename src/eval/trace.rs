//! What happened to each node, and why: data, for people, programs and tests.

use std::fmt;

use serde_json::json;

use crate::graph::GraphNode;

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
    /// How long it ran; 0 if it did not.
    pub seconds: f64,
    /// How much memory its results hold.
    pub bytes: usize,
    /// Its doubts about the results.
    pub warnings: Vec<String>,
}

impl NodeTrace {
    pub(super) fn new(node: &GraphNode, state: State, reason: String) -> Self {
        Self {
            name: node.name.clone(),
            node: node.kind.clone(),
            state,
            unchanged: false,
            reason,
            seconds: 0.0,
            bytes: 0,
            warnings: Vec::new(),
        }
    }

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

/// What happened to each node that was needed, in the graph's order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Trace(pub Vec<NodeTrace>);

impl Trace {
    /// How many nodes came to this end.
    pub fn count(&self, state: State) -> usize {
        self.0.iter().filter(|node| node.state == state).count()
    }
}

/// One node a line: what became of it, its name, and why, without times.
impl fmt::Display for Trace {
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
