//! What a run would do, and what is known without one.

use std::path::PathBuf;

use maquette_graph::{Graph, KnownInputs};
use maquette_syntax::error::Problem;

use super::{OutputFolder, Session, expected_of, inputs, outputs_of};
use crate::eval::{Forecast, Remembered, explanation};
use crate::expect;

impl Session {
    /// What is known of the values in some files for inputs of a graph, without reading large files.
    ///
    /// # Errors
    /// As [`read_inputs`](Self::read_inputs).
    pub fn known_inputs(
        &self,
        graph: &Graph,
        files: &[(String, PathBuf)],
    ) -> Result<(KnownInputs, Vec<Problem>), Vec<Problem>> {
        inputs::known(self, graph, files)
    }

    /// The graph as it is [`fed`](Self::fed), for a forecast: with what is [known](Self::known_inputs) of the values.
    ///
    /// # Errors
    /// As [`fed`](Self::fed).
    pub fn fed_with_known(
        &self,
        graph: &Graph,
        inputs: &KnownInputs,
    ) -> Result<Graph, Vec<Problem>> {
        if inputs.is_empty() && graph.inputs().is_empty() && !graph.is_function() {
            return Ok(graph.clone());
        }
        graph.with_known_inputs(inputs, &self.catalog)
    }

    /// What each node would do if these outputs, all if none is named, were made in a folder now, and why. The graph is one as it is
    /// [last known](Self::as_last_known). Large files are not read: what depends on one that is not known may run.
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
        let (_, open) = self.unjudged(graph, &expected);
        let (catalog, evaluator) = (&self.catalog, &mut self.evaluator);
        let mut values = folder.nodes_to_write_by_stamps(&outputs, graph, catalog, evaluator);
        values.extend(expect::nodes_of(&open));
        Ok(self.evaluator.forecast(graph, &nodes, &values))
    }

    /// What these nodes, and each that they need, would do if their values were wanted now, and why. The values of which something is
    /// expected are needed themselves, if they are not known to be so.
    pub(crate) fn forecast(&mut self, graph: &Graph, nodes: &[usize]) -> Vec<Forecast> {
        let needed = graph.shape().needed_by(nodes);
        let (_, open) = self.unjudged(graph, &graph.expected(nodes));
        let mut values = expect::nodes_of(&open);
        values.retain(|&node| needed[node]);
        values.extend(nodes);
        self.evaluator.forecast(graph, nodes, &values)
    }

    /// What is known of the last result of each node, by this process or another one; nothing is run. The graph is one as it is
    /// [last known](Self::as_last_known).
    pub fn remembered(&mut self, graph: &Graph) -> Vec<Option<Remembered>> {
        self.evaluator.remembered(graph)
    }

    /// Why a node, or each node that makes what a use of a graph gives, would run, or why not, since the graph was evaluated last: in
    /// words, a line or more for each. None if the graph has no such node.
    pub fn why(&mut self, graph: &Graph, name: &str) -> Option<String> {
        let graph = &self.as_last_known(graph);
        let nodes = graph.nodes_of(name);
        let forecasts = self.forecast(graph, &nodes);
        let told = nodes.iter().map(|&node| explanation(graph, node, &forecasts));
        let open = graph.open_loop(name).map(|open| {
            format!("how many elements `{}` has is known when the graph has been run\n", open.name)
        });
        (!nodes.is_empty() || open.is_some()).then(|| told.chain(open).collect())
    }
}
