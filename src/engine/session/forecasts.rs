//! Forecasts of runs, and facts known from earlier runs.

use std::path::PathBuf;

use maquette_graph::{Graph, KnownInputs};
use maquette_syntax::error::Diagnostic;

use super::{OutputFolder, Session, expected_of, inputs, outputs_of};
use crate::eval::{Forecast, LastResult, explanation};
use crate::expect;

impl Session {
    /// Returns what is known about the values in the input files of a graph. Large files are not read.
    ///
    /// # Errors
    /// As [`read_inputs`](Self::read_inputs).
    pub fn known_inputs(
        &self,
        graph: &Graph,
        files: &[(String, PathBuf)],
    ) -> Result<(KnownInputs, Vec<Diagnostic>), Vec<Diagnostic>> {
        inputs::read_known(self, graph, files)
    }

    /// Returns the graph with [known inputs](Self::known_inputs), for a forecast: see [`bind_inputs`](Self::bind_inputs).
    ///
    /// # Errors
    /// As [`bind_inputs`](Self::bind_inputs).
    pub fn bind_known_inputs(
        &self,
        graph: &Graph,
        inputs: &KnownInputs,
    ) -> Result<Graph, Vec<Diagnostic>> {
        if inputs.is_empty() && graph.inputs().is_empty() && !graph.is_function() {
            return Ok(graph.clone());
        }
        graph.with_known_inputs(inputs, &self.catalog)
    }

    /// Returns the forecast of each node for a run that writes the outputs `only` (or all outputs if the list is empty) to a folder. The
    /// graph must have its [last known counts](Self::with_last_counts). Large files are not read: if one of them may have changed, the
    /// forecast is that the nodes that depend on it may run.
    pub fn dry_run(
        &mut self,
        graph: &Graph,
        only: &[String],
        folder: &OutputFolder,
    ) -> Result<Vec<Forecast>, String> {
        let outputs = outputs_of(graph, only)?;
        let mut nodes: Vec<_> = outputs.iter().map(|output| output.node).collect();
        let expected = expected_of(graph, &nodes, only);
        nodes.extend(expect::nodes_of(&expected));
        let (_, open) = self.open_expectations(graph, &expected);
        let (catalog, evaluator) = (&self.catalog, &mut self.evaluator);
        let mut values = folder.nodes_to_write_by_stamps(&outputs, graph, catalog, evaluator);
        values.extend(expect::nodes_of(&open));
        Ok(self.evaluator.forecast(graph, &nodes, &values))
    }

    /// Returns the forecasts of the given nodes and of their dependencies for a run that requests their values. Values are also needed if
    /// their expectations are not known to hold.
    pub(crate) fn forecast(&mut self, graph: &Graph, nodes: &[usize]) -> Vec<Forecast> {
        let needed = graph.topology().needed_by(nodes);
        let (_, open) = self.open_expectations(graph, &graph.expectations_for(nodes));
        let mut values = expect::nodes_of(&open);
        values.retain(|&node| needed[node]);
        values.extend(nodes);
        self.evaluator.forecast(graph, nodes, &values)
    }

    /// Returns facts about the last result of each node, in this process or another one. No node is run. The graph must have its [last
    /// known counts](Self::with_last_counts).
    pub fn last_results(&mut self, graph: &Graph) -> Vec<Option<LastResult>> {
        self.evaluator.last_results(graph)
    }

    /// Explains why a node would run or not since the last evaluation, in one or more lines. For a use of a graph, explains this for each
    /// node that computes an output of the use. Returns `None` if the graph has no node or use with this name.
    pub fn explain(&mut self, graph: &Graph, name: &str) -> Option<String> {
        let graph = &self.with_last_counts(graph);
        let nodes = graph.nodes_of(name);
        let forecasts = self.forecast(graph, &nodes);
        let explanations = nodes.iter().map(|&node| explanation(graph, node, &forecasts));
        let open = graph.open_loop(name).map(|open| {
            format!("how many elements `{}` has is known when the graph has been run\n", open.name)
        });
        (!nodes.is_empty() || open.is_some()).then(|| explanations.chain(open).collect())
    }
}
