//! `maquette edit GRAPH set`: sets values in a graph file.

use clap::Args;
use maquette_edit::Edit as GraphEdit;
use maquette_graph::catalog::Catalog;

use super::graph_file::GraphFile;
use crate::{Exit, parse_assignment, print, print_document};

#[derive(Args)]
pub(crate) struct Set {
    /// The default of a parameter (NAME=VALUE) or a field of a node (NODE.FIELD=VALUE). More dots select nested fields:
    /// red.select.distance=25, raised.steps.0.distance=3. A value that is not RON is text.
    #[arg(required = true, value_name = "NODE.FIELD=VALUE", value_parser = parse_assignment)]
    values: Vec<(String, String)>,
    /// Set the draft value of each `Draft(final: .., draft: ..)`, not the final one.
    #[arg(long)]
    draft: bool,
}

impl Set {
    pub(super) fn run(&self, file: GraphFile<'_>, catalog: &Catalog) -> Exit {
        let edits: Vec<_> = self
            .values
            .iter()
            .map(|(target, value)| GraphEdit::Set { target: target.clone(), value: value.clone() })
            .collect();
        let file = GraphFile { draft: self.draft, ..file };
        let Some(edited) = file.edit(&edits, catalog) else { return Exit::Failed };
        if file.dry_run {
            print_document(&edited.text);
            return Exit::Done;
        }
        for change in &edited.changes {
            let before = change.before.as_deref().unwrap_or("left out");
            print(&format!("{}: {before} -> {}\n", change.target, change.after));
        }
        Exit::Done
    }
}
