//! Evaluates nodes of an example for the laws.

use std::collections::{BTreeMap, HashMap};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Mutex;

use maquette_engine::eval::Evaluator;
use maquette_graph::{Graph, GraphNode};
use maquette_node::importers::Readers;
use maquette_node::{CancelToken, Context, Progress};
use maquette_syntax::error::Error;
use maquette_value::{AnyValue, ValueType};

/// The memory limit of each evaluator, in bytes.
pub(super) const MEMORY: usize = 1 << 30;

/// The value types by name. They provide the edge cases.
pub(super) struct EdgeCases(pub(super) HashMap<&'static str, &'static ValueType>);

impl EdgeCases {
    /// Returns edge cases of the value type with this name.
    pub(super) fn values(&self, kind: &str) -> Vec<AnyValue> {
        self.0.get(kind).map_or_else(Vec::new, |kind| kind.edge_cases())
    }
}

/// The values of outputs, by the index of the node and the index of its output.
pub(super) type Values = BTreeMap<(usize, usize), AnyValue>;

/// Returns the input values of a node, or `None` if one of them is missing.
pub(super) fn inputs(node: &GraphNode, values: &Values) -> Option<Vec<AnyValue>> {
    node.links.iter().map(|link| values.get(&(link.node, link.output)).cloned()).collect()
}

/// Evaluates a graph, and returns all outputs of all nodes.
pub(super) fn run_all(graph: &Graph) -> Result<Values, String> {
    let mut evaluator = Evaluator::new(0, MEMORY).map_err(|error| error.to_string())?;
    let evaluation = evaluator.evaluate_all_nodes(graph, &(), &CancelToken::default());
    let places = (0..graph.nodes().len())
        .flat_map(|node| (0..graph.nodes()[node].outputs.len()).map(move |output| (node, output)));
    Ok(places
        .filter_map(|place: (usize, usize)| {
            Some((place, evaluation.value(place.0, place.1)?.clone()))
        })
        .collect())
}

/// Runs a single node. Failing is not an error, but panicking is: the error is the message of the panic.
pub(super) fn run_node(
    node: &GraphNode,
    inputs: &[AnyValue],
    progress: Progress<'_>,
) -> Result<(), String> {
    evaluate_node(node, inputs, progress).map(|_| ())
}

/// Evaluates a single node with the given inputs. Returns `None` if the node fails. The error is the message of a panic.
pub(super) fn evaluate_node(
    node: &GraphNode,
    inputs: &[AnyValue],
    progress: Progress<'_>,
) -> Result<Option<Vec<AnyValue>>, String> {
    let (result, _) = call_with_context(inputs, progress, |cx| node.node.eval(cx))?;
    Ok(result.ok())
}

/// Runs code of a node with the given inputs. Returns its result and warnings. The error is the message of a panic.
pub(super) fn call_with_context<R>(
    inputs: &[AnyValue],
    progress: Progress<'_>,
    work: impl FnOnce(&Context<'_>) -> Result<R, Error>,
) -> Result<(Result<R, Error>, Vec<String>), String> {
    let (files, readers) = (BTreeMap::new(), Readers::default());
    let cx = Context {
        inputs,
        files: &files,
        progress,
        memos: None,
        readers: &readers,
        block: None,
        warnings: Mutex::default(),
    };
    let result = catch_unwind(AssertUnwindSafe(|| work(&cx)));
    let result = result.map_err(|panic| maquette_syntax::error::panic_message(&*panic))?;
    Ok((result, cx.warnings.into_inner().unwrap_or_else(|broken| broken.into_inner())))
}
