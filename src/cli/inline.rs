//! `maquette inline`: a use of a graph gives way to the nodes inside of it.

use std::path::PathBuf;

use clap::Args;
use maquette_edit::Edited;
use maquette_graph::catalog::Catalog;

use super::Exit;
use super::edit::{EditError, GraphFile};

/// Every value stays what it was, and nothing is computed anew. The used graph's file stays as it is.
#[derive(Args)]
pub(crate) struct Inline {
    /// The graph file.
    graph: PathBuf,
    /// The node that uses another graph.
    node: String,
    /// Print the lines that would change; write nothing.
    #[arg(long)]
    dry_run: bool,
    /// Let the graph read files of this folder, too.
    #[arg(long = "root", value_name = "DIR")]
    roots: Vec<PathBuf>,
}

impl Inline {
    pub(super) fn run(&self, catalog: &Catalog) -> Exit {
        let (graph, roots) = (&self.graph, &self.roots);
        let file = GraphFile { graph, roots, draft: false, dry_run: self.dry_run };
        match self.inlined(&file, catalog) {
            Ok(edited) => {
                file.tell(edited, catalog);
                Exit::Done
            }
            Err(error) => {
                error.tell();
                Exit::Failed
            }
        }
    }

    fn inlined(&self, file: &GraphFile<'_>, catalog: &Catalog) -> Result<Edited, EditError> {
        let _turn = if self.dry_run { None } else { Some(file.turn()?) };
        let (text, options) = (file.text()?, file.options());
        let edited = maquette_edit::inline(file.graph, &text, &self.node, catalog, &options);
        let edited = edited.map_err(EditError::Refused)?;
        if !self.dry_run {
            file.write(&edited)?;
        }
        Ok(edited)
    }
}
