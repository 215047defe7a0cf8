//! `maquette why`: why a node would run, or why not.

use std::fmt::Write as _;
use std::path::PathBuf;
use std::sync::Arc;

use clap::Args;

use super::caching::CacheOptions;
use super::inputs::InputOptions;
use super::{Exit, GraphOptions, print, report};
use crate::catalog::Catalog;
use crate::eval::{Change, Forecast, Outlook, Reason};
use crate::graph::Graph;
use crate::text::unknown;

#[derive(Args)]
pub(super) struct Why {
    /// The graph file.
    graph: PathBuf,
    /// The node, or a use of a graph: then the nodes that make its outputs.
    node: String,
    #[command(flatten)]
    inputs: InputOptions,
    #[command(flatten)]
    options: GraphOptions,
    #[command(flatten)]
    cache: CacheOptions,
}

impl Why {
    pub(super) fn run(&self, catalog: &Arc<Catalog>) -> Exit {
        let checked = self.options.load(&self.graph, catalog);
        report(&checked.problems);
        let Some(graph) = checked.graph else { return Exit::Failed };
        let nodes = graph.nodes_of(&self.node);
        if nodes.is_empty() {
            let message = format!("the graph has no node `{}`", self.node);
            let known = Vec::from_iter(graph.names());
            return Exit::Usage(unknown(message, &self.node, "its nodes", &known));
        }
        let mut session = match self.cache.session(1, catalog) {
            Ok(session) => session,
            Err(why) => return Exit::Usage(why),
        };
        let graph = match self.inputs.told(&session, &graph) {
            Ok(graph) => graph,
            Err(exit) => return exit,
        };
        let forecasts = session.forecast(&graph, &nodes);
        nodes.iter().for_each(|&node| print(&explain(&graph, node, &forecasts)));
        Exit::Done
    }
}

/// Why a node would run, back to what was changed.
fn explain(graph: &Graph, node: usize, forecasts: &[Forecast]) -> String {
    let find = |index: usize| forecasts.iter().find(|forecast| forecast.index == index);
    let Some(forecast) = find(node) else { return String::new() };
    let name = &graph.nodes[node].name;
    let reason = |forecast: &Forecast| reason_with_place(graph, forecast);
    match forecast.outlook {
        Outlook::Cached => format!("`{name}` does not run: {}\n", reason(forecast)),
        Outlook::Fails => format!("`{name}` fails: {}\n", reason(forecast)),
        Outlook::Runs => format!("`{name}` runs: {}\n", reason(forecast)),
        Outlook::MayRun => {
            let mut text = format!("`{name}` runs if what it hangs on comes out different:\n");
            let causes = forecasts
                .iter()
                .filter(|forecast| matches!(forecast.outlook, Outlook::Runs | Outlook::Fails));
            for cause in causes {
                let _ = writeln!(
                    text,
                    "  `{}` {}: {}",
                    graph.nodes[cause.index].name,
                    cause.word(),
                    reason(cause)
                );
            }
            text
        }
    }
}

/// A forecast's reason, and where in the graph file a changed parameter stands.
pub(super) fn reason_with_place(graph: &Graph, forecast: &Forecast) -> String {
    let node = &graph.nodes[forecast.index];
    let mut text = forecast.reason.in_words(node, &graph.nodes);
    if let Reason::Changed(change) | Reason::Before(change) = &forecast.reason {
        let place = match change {
            Change::Parameter { path, .. } => Some(node.place_of(path)),
            Change::Kind { .. } => Some(node.place_of(&[])),
            Change::Input(_) | Change::File(_) => None,
        };
        if let Some(place) = place {
            let _ = write!(text, ", {place}");
        }
    }
    text
}
