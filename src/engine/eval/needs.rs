//! Predicts what the nodes of a graph need, before anything large is read: sizes, memory and time.
//!
//! The sizes of files come from their headers, those of cached results from the cache, and the others from the nodes' own laws
//! ([`Node::forecast`](maquette_node::Node::forecast)). Where a node has no law, its outputs are taken to be as large as its largest input.

use std::collections::HashMap;
use std::path::Path;

use maquette_graph::file_head::size_in_file;
use maquette_graph::{Graph, GraphNode};
use maquette_node::budget::{Estimate, MemoryError};
use maquette_node::{Certainty, FilePath, Sizes, ValueSize};
use maquette_syntax::error::{Diagnostic, Severity, code};
use maquette_value::ValueType;

use super::Evaluator;
use super::fitting_size::{fitting_size, forecast, largest};
use super::memory::max_bytes;
use super::timing::{NOTE, Timings, bytes_of_files};
use super::why::Forecast;

/// The needs of a node.
#[derive(Clone, Debug)]
pub struct NodeNeeds {
    /// The index of the node in the graph.
    pub index: usize,
    /// A word such as `runs` or `cached`: see [`Forecast::word`].
    pub state: &'static str,
    /// The size of each output; `None` for an unknown size.
    pub outputs: Vec<Option<ValueSize>>,
    /// The memory in bytes that the node needs while it runs, with its results and files. 0 if it does not run, and `None` if it is
    /// unknown.
    pub memory: Option<f64>,
    /// The time in seconds. 0 if the node does not run, and `None` if no such node has run on this machine.
    pub seconds: Option<f64>,
}

impl NodeNeeds {
    /// Returns the sum of the sizes of all outputs. `None` if one of them is unknown.
    pub fn size(&self) -> Option<ValueSize> {
        self.outputs.iter().copied().reduce(|a, b| Some(a?.plus(b?)))?
    }
}

/// The needs of all nodes of a run.
#[derive(Clone, Debug, Default)]
pub struct RunNeeds {
    /// The nodes that the run needs, in the order of the graph.
    pub nodes: Vec<NodeNeeds>,
    /// The maximum memory in bytes of results that are still needed and of the running node, if one node runs at a time.
    pub peak: f64,
    /// The memory that is allowed, in bytes.
    pub max_bytes: u64,
    /// An error for each node that needs more memory than is allowed, or a warning if its size is a guess.
    pub diagnostics: Vec<Diagnostic>,
}

/// The sizes of inputs and files on which a forecast of a node is based.
struct Known<'a> {
    node: &'a GraphNode,
    inputs: Vec<Option<ValueSize>>,
    files: &'a dyn Fn(&FilePath, &ValueType) -> Option<ValueSize>,
    /// The sizes of the outputs in the node's last run. Empty if they are unknown.
    last: Vec<ValueSize>,
}

impl Known<'_> {
    /// Returns the forecast of the node for inputs and files of `factor` times their size. `None` if the node has no law.
    fn forecast(&self, factor: f64) -> Option<maquette_node::Forecast> {
        let inputs = |slot: usize| Some((*self.inputs.get(slot)?)?.scale(factor));
        let files =
            |path: &FilePath, kind: &ValueType| Some((self.files)(path, kind)?.scale(factor));
        forecast(&*self.node.node, &Sizes { inputs: &inputs, files: &files })
    }
}

impl Evaluator {
    /// Predicts the needs of the nodes `roots` and of all their dependencies, for a run that requests the values of the nodes `values`. Of
    /// large files only the headers are read.
    pub(crate) fn needs(&mut self, graph: &Graph, roots: &[usize], values: &[usize]) -> RunNeeds {
        let (forecasts, outcomes) = self.forecast_with_outcomes(graph, roots, values);
        let timings = self
            .known_results()
            .map(|disk| Timings::read(disk.note(Path::new(NOTE))))
            .unwrap_or_default();
        let mut sizes: HashMap<usize, Vec<Option<ValueSize>>> = HashMap::new();
        let max_bytes = max_bytes(self.max_bytes, &self.cache);
        let mut needs = RunNeeds { max_bytes, ..RunNeeds::default() };
        for (forecast, outcome) in forecasts.iter().zip(outcomes) {
            let node = &graph.nodes()[forecast.index];
            let files = |path: &FilePath, kind: &ValueType| {
                size_in_file(path.resolved_path(), kind, graph.readers())
            };
            let inputs = node.links.iter().map(|link| *sizes.get(&link.node)?.get(link.output)?);
            let last = self.last.as_ref();
            let last = last.and_then(|last| last.last_result(&node.name, forecast.index));
            let last = last.map_or_else(Vec::new, |last| last.outcome.sizes.to_vec());
            let known = Known { node, inputs: inputs.collect(), files: &files, last };
            let own = match outcome.filter(|_| !forecast.may_run()) {
                Some(outcome) => NodeNeeds {
                    index: forecast.index,
                    state: forecast.word(),
                    outputs: outcome.sizes.iter().copied().map(Some).collect(),
                    memory: Some(0.0),
                    seconds: Some(0.0),
                },
                None => needs_of(forecast, &known, &timings, max_bytes, &mut needs.diagnostics),
            };
            sizes.insert(forecast.index, own.outputs.clone());
            needs.nodes.push(own);
        }
        needs.peak = peak(graph, &needs.nodes, values);
        needs
    }
}

/// Returns the needs of a node that runs or may run. Adds a diagnostic if it needs more memory than is allowed.
fn needs_of(
    forecast: &Forecast,
    known: &Known<'_>,
    timings: &Timings,
    max_bytes: u64,
    diagnostics: &mut Vec<Diagnostic>,
) -> NodeNeeds {
    let node = known.node;
    let guess = largest(&known.inputs).map(|size| size.at_most(Certainty::Guess));
    let law = known.forecast(1.0);
    let outputs: Vec<Option<ValueSize>> = (0..node.outputs.len())
        .map(|output| {
            let by_law = match &law {
                Some(law) => law.outputs.get(output).copied().flatten(),
                None => guess,
            };
            // The last run is a better guess.
            let last = known.last.get(output).map(|last| last.at_most(Certainty::Guess));
            by_law.filter(|size| size.certainty < Certainty::Guess).or(last).or(by_law)
        })
        .collect();
    let made = outputs.iter().copied().reduce(|a, b| Some(a?.plus(b?))).flatten();
    let files = bytes_of_files(node);
    let estimate = law.and_then(|law| law.memory);
    let memory = estimate.map(|estimate| estimate.bytes).or(made.map(|made| made.bytes));
    let memory = memory.map(|memory| memory + files);
    let read: Option<f64> = known.inputs.iter().map(|input| input.map(|input| input.bytes)).sum();
    let work = read.zip(made).map(|(read, made)| read + made.bytes + files);
    let seconds = work.and_then(|work| timings.predict(node.kind(), work));
    if let Some(need) = memory.filter(|need| *need > max_bytes as f64 || need.is_nan()) {
        let none = Estimate { bytes: need, help: "use a smaller input" };
        let help = estimate.unwrap_or(none).help;
        let memory_of = |factor: f64| {
            let law = known.forecast(factor)?;
            let made = || law.outputs.iter().try_fold(0.0, |sum, size| Some(sum + (*size)?.bytes));
            Some(law.memory.map(|memory| memory.bytes).or_else(made)? + factor * files)
        };
        let size = largest(&known.inputs).or(made);
        let fits = size.and_then(|size| fitting_size(memory_of, size, max_bytes as f64));
        let error = MemoryError { need, held: 0, most: max_bytes, help, fits };
        let inputs = known.inputs.iter().flatten().chain(made.as_ref());
        let is_guess = inputs.map(|size| size.certainty).max() == Some(Certainty::Guess);
        let severity = if is_guess { Severity::Warning } else { Severity::Error };
        let message = format!("`{}` cannot be computed: {error}", node.name);
        diagnostics.push(node.diagnostic(severity, code::FAILED, message, ""));
    }
    NodeNeeds { index: forecast.index, state: forecast.word(), outputs, memory, seconds }
}

/// Returns the maximum memory in bytes of a run that computes one node at a time, in the order of the graph. A result is dropped after its
/// last use, except for those of `values`.
fn peak(graph: &Graph, nodes: &[NodeNeeds], values: &[usize]) -> f64 {
    let mut last_use: HashMap<usize, usize> = HashMap::new();
    for node in nodes.iter().filter(|node| node.memory != Some(0.0)) {
        for source in graph.topology().sources(node.index) {
            last_use.insert(source, node.index);
        }
    }
    let bytes = |node: &NodeNeeds| node.size().map_or(0.0, |size| size.bytes);
    let by_index: HashMap<usize, &NodeNeeds> =
        nodes.iter().map(|node| (node.index, node)).collect();
    let (mut held, mut peak) = (0.0, 0.0_f64);
    for node in nodes {
        peak = peak.max(held + node.memory.unwrap_or(0.0));
        if last_use.contains_key(&node.index) || values.contains(&node.index) {
            held += bytes(node);
        }
        peak = peak.max(held);
        for source in graph.topology().sources(node.index) {
            if last_use.get(&source) == Some(&node.index) && !values.contains(&source) {
                last_use.remove(&source);
                held -= by_index.get(&source).map_or(0.0, |node| bytes(node));
            }
        }
    }
    peak
}
