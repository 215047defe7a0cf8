//! `maquette edit GRAPH inline`: replaces a use of a graph by the nodes of that graph.

use clap::Args;
use maquette_edit::EditedText;
use maquette_graph::catalog::Catalog;

use super::graph_file::{EditError, GraphFile};
use crate::Exit;

/// All values and cached results stay valid. The file of the used graph is not changed.
#[derive(Args)]
pub(crate) struct Inline {
    /// The node that uses another graph.
    node: String,
}

impl Inline {
    pub(super) fn run(&self, file: &GraphFile<'_>, catalog: &Catalog) -> Exit {
        match self.apply(file, catalog) {
            Ok(edited) => {
                file.print_changes(edited, catalog);
                Exit::Done
            }
            Err(error) => {
                error.print();
                Exit::Failed
            }
        }
    }

    fn apply(&self, file: &GraphFile<'_>, catalog: &Catalog) -> Result<EditedText, EditError> {
        let _turn = if file.dry_run { None } else { Some(file.acquire_lock()?) };
        let (text, options) = (file.text()?, file.options());
        let edited = maquette_edit::inline(file.graph, &text, &self.node, catalog, &options);
        let edited = edited.map_err(EditError::Refused)?;
        if !file.dry_run {
            file.write(&edited)?;
        }
        Ok(edited)
    }
}
