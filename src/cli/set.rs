//! `maquette set`: values put into a graph file.

use std::path::PathBuf;

use clap::Args;
use maquette_edit::Edit as GraphEdit;
use maquette_graph::catalog::Catalog;

use super::edit::GraphFile;
use super::{Exit, assignment, print, print_document};

#[derive(Args)]
pub(crate) struct Set {
    /// The graph file.
    graph: PathBuf,
    /// A parameter's default (NAME=VALUE) or a node's field (NODE.FIELD=VALUE). Dots lead further in: red.select.distance=25,
    /// raised.steps.0.distance=3. A value that is no RON is text.
    #[arg(required = true, value_name = "NODE.FIELD=VALUE", value_parser = assignment)]
    values: Vec<(String, String)>,
    /// Put the values to the drafts of each `Draft(final: .., draft: ..)`, not to the final ones.
    #[arg(long)]
    draft: bool,
    /// Print the new text; write nothing.
    #[arg(long)]
    dry_run: bool,
    /// Let the graph read files of this folder, too.
    #[arg(long = "root", value_name = "DIR")]
    roots: Vec<PathBuf>,
}

impl Set {
    pub(super) fn run(&self, catalog: &Catalog) -> Exit {
        let edits: Vec<_> = self
            .values
            .iter()
            .map(|(target, value)| GraphEdit::Set { target: target.clone(), value: value.clone() })
            .collect();
        let file = GraphFile {
            graph: &self.graph,
            roots: &self.roots,
            draft: self.draft,
            dry_run: self.dry_run,
        };
        let Some(edited) = file.edit(&edits, catalog) else { return Exit::Failed };
        if self.dry_run {
            print_document(&edited.text);
            return Exit::Done;
        }
        for put in &edited.changes {
            let before = put.before.as_deref().unwrap_or("left out");
            print(&format!("{}: {before} -> {}\n", put.target, put.after));
        }
        Exit::Done
    }
}
