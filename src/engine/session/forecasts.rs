//! Forecasts of runs, and facts known from earlier runs.

use std::path::PathBuf;

use maquette_graph::{Graph, KnownInputs};
use maquette_syntax::error::Diagnostic;

use super::{OutputFolder, Session, expected_of, inputs, outputs_of};
use crate::eval::needs::RunNeeds;
use crate::eval::{Forecast, LastResult, explanation};
use crate::expect;

impl Session {
    /// Returns the facts about the values of a graph's inputs that stored notes and small files contain. Large files are not read.
    ///
    /// # Errors
    /// The same errors as [`read_inputs`](Self::read_inputs).
    pub fn known_inputs(
        &self,
        graph: &Graph,
        files: &[(String, PathBuf)],
    ) -> Result<(KnownInputs, Vec<Diagnostic>), Vec<Diagnostic>> {
        inputs::read_known(self, graph, files)
    }

    /// Returns the graph with its [known inputs](Self::known_inputs), for a forecast. Works like [`bind_inputs`](Self::bind_inputs).
    ///
    /// # Errors
    /// The same errors as [`bind_inputs`](Self::bind_inputs).
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

    /// Returns the forecast of each node for a run that writes the outputs `only` to a folder. An empty list stands for all outputs. The
    /// loops of the graph must be expanded to their [last known counts](Self::with_last_counts). Large files are not read: if one may have
    /// changed, the nodes that depend on it are forecast as possibly running.
    pub fn dry_run(
        &mut self,
        graph: &Graph,
        only: &[String],
        folder: &OutputFolder,
    ) -> Result<Vec<Forecast>, String> {
        let (nodes, values) = self.forecast_targets(graph, only, folder)?;
        Ok(self.evaluator.forecast(graph, &nodes, &values))
    }

    /// Predicts the sizes, the memory and the time of each node, for the same run as [`dry_run`](Self::dry_run). Of large files only the
    /// headers are read.
    ///
    /// # Errors
    /// A message if one of the names is not an output of the graph.
    pub fn needs(
        &mut self,
        graph: &Graph,
        only: &[String],
        folder: &OutputFolder,
    ) -> Result<RunNeeds, String> {
        let (nodes, values) = self.forecast_targets(graph, only, folder)?;
        Ok(self.evaluator.needs(graph, &nodes, &values))
    }

    /// Returns the nodes that a run of the outputs `only` evaluates, and the nodes whose values it needs.
    fn forecast_targets(
        &mut self,
        graph: &Graph,
        only: &[String],
        folder: &OutputFolder,
    ) -> Result<(Vec<usize>, Vec<usize>), String> {
        let outputs = outputs_of(graph, only)?;
        let mut nodes: Vec<_> = outputs.iter().map(|output| output.node).collect();
        let expected = expected_of(graph, &nodes, only);
        nodes.extend(expect::nodes_of(&expected));
        let (_, open) = self.open_expectations(graph, &expected);
        let (catalog, evaluator) = (&self.catalog, &mut self.evaluator);
        let mut values = folder.nodes_to_write_by_stamps(&outputs, graph, catalog, evaluator);
        values.extend(expect::nodes_of(&open));
        Ok((nodes, values))
    }

    /// Returns the forecasts of the given nodes and of their dependencies, for a run that requests the nodes' values. A value with an
    /// expectation that is not known to hold also counts as requested, because the run must check it.
    pub(crate) fn forecast(&mut self, graph: &Graph, nodes: &[usize]) -> Vec<Forecast> {
        let needed = graph.topology().needed_by(nodes);
        let (_, open) = self.open_expectations(graph, &graph.expectations_for(nodes));
        let mut values = expect::nodes_of(&open);
        values.retain(|&node| needed[node]);
        values.extend(nodes);
        self.evaluator.forecast(graph, nodes, &values)
    }

    /// Returns facts about the last result of each node, from this process or another one; `None` for a node without a known result. No
    /// node is run. The loops of the graph must be expanded to their [last known counts](Self::with_last_counts).
    pub fn last_results(&mut self, graph: &Graph) -> Vec<Option<LastResult>> {
        self.evaluator.last_results(graph)
    }

    /// Explains in one or more lines why the node `name` would run or not in the next evaluation. If the node uses another graph, explains
    /// it for each node that computes one of its outputs. Returns `None` if there is no such node.
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
