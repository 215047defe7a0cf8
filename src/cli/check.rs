//! `maquette check`: every problem of a graph, at once.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;

use super::{Exit, GraphOptions, counted, print, print_json, report};
use crate::catalog::Catalog;
use crate::error::{Problem, Severity};

#[derive(Args)]
pub(super) struct Check {
    /// The graph files.
    #[arg(required = true, value_name = "GRAPH")]
    graphs: Vec<PathBuf>,
    #[command(flatten)]
    options: GraphOptions,
    /// Print one JSON document.
    #[arg(long)]
    json: bool,
}

impl Check {
    pub(super) fn run(&self, catalog: &Catalog) -> Exit {
        let checked = self.graphs.iter().map(|path| self.options.load(path, catalog));
        let problems: Vec<Problem> = checked.flat_map(|checked| checked.problems).collect();
        let errors = problems.iter().filter(|problem| problem.severity == Severity::Error).count();
        if self.json {
            let problems: Vec<_> = problems.iter().map(Problem::to_json).collect();
            print_json(&json!({ "problems": problems }));
        } else {
            report(&problems);
            let graphs = counted(self.graphs.len(), "graph");
            print(&format!("checked {graphs}: {}\n", counted(errors, "error")));
        }
        if errors == 0 { Exit::Done } else { Exit::Failed }
    }
}
