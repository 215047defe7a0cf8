//! `maquette why`: explains why a node would run, or why it would not.

use std::path::PathBuf;
use std::sync::Arc;

use clap::Args;
use maquette_graph::catalog::Catalog;

use super::{EvaluationOptions, Exit, print, report};

#[derive(Args)]
pub(crate) struct WhyCommand {
    /// The graph file.
    graph: PathBuf,
    /// The node, or a use of a graph for the nodes that compute its outputs.
    node: String,
    #[command(flatten)]
    evaluation: EvaluationOptions,
}

impl WhyCommand {
    pub(super) fn run(&self, catalog: &Arc<Catalog>) -> Exit {
        let checked = self.evaluation.graph.load(&self.graph, catalog).without_unknown_nodes();
        report(&checked.diagnostics);
        let Some(graph) = checked.graph else { return Exit::Failed };
        let mut session = match self.evaluation.cache.reporting_session(1, catalog) {
            Ok(session) => session,
            Err(why) => return Exit::Usage(why),
        };
        let graph = match self.evaluation.inputs.feed_for_forecast_and_report(&session, &graph) {
            Ok(graph) => graph,
            Err(exit) => return exit,
        };
        match session.explain(&graph, &self.node) {
            Some(reasons) => {
                print(&reasons);
                Exit::Done
            }
            None => {
                let known = Vec::from_iter(graph.names());
                Exit::Usage(graph.unknown("node", &self.node, "its nodes", &known))
            }
        }
    }
}
