//! `maquette edit GRAPH extract`: moves nodes of a graph into a new graph file.

use std::path::PathBuf;

use clap::Args;
use maquette_edit::{ExtractedGraph, Extraction};
use maquette_engine::writing::rewrite_with;
use maquette_graph::catalog::Catalog;

use super::graph_file::{EditError, GraphFile};
use crate::{DisplayPath, Exit, print, print_document};

/// All values and cached results stay valid. References to the nodes in other files, such as a Patch, a test or a pin, are not changed.
/// `inline` reverses the edit.
#[derive(Args)]
pub(crate) struct Extract {
    /// The nodes.
    #[arg(required = true, value_name = "NODE")]
    nodes: Vec<String>,
    /// The file of the new graph; by default a file beside the graph, named after the new node.
    #[arg(long, value_name = "FILE")]
    to: Option<PathBuf>,
    /// The node type under which the new graph is used: Nose. Derived from the name of the file by default.
    #[arg(long, value_name = "TYPE")]
    name: Option<String>,
    /// The name of the node that uses the new graph: nose. Derived from the type by default.
    #[arg(long = "as", value_name = "NODE")]
    node: Option<String>,
}

impl Extract {
    pub(super) fn run(&self, file: &GraphFile<'_>, catalog: &Catalog) -> Exit {
        let ExtractedGraph { edited, path, text, kind, name } = match self.apply(file, catalog) {
            Ok(extracted) => extracted,
            Err(error) => {
                error.print();
                return Exit::Failed;
            }
        };
        print(&format!("{}: {kind}, used by `{name}`\n", path.for_display()));
        if file.dry_run {
            let lines = text.lines().map(|line| format!("+{line}\n"));
            print_document(&String::from_iter(lines));
        }
        file.print_changes(edited, catalog);
        Exit::Done
    }

    /// Extracts the nodes into a new graph. Writes both files, except in a dry run.
    fn apply(&self, file: &GraphFile<'_>, catalog: &Catalog) -> Result<ExtractedGraph, EditError> {
        if file.dry_run {
            return self.extract(file, catalog);
        }
        let _turn = file.acquire_lock()?;
        let extracted = self.extract(file, catalog)?;
        write(file, &extracted)?;
        Ok(extracted)
    }

    fn extract(
        &self,
        file: &GraphFile<'_>,
        catalog: &Catalog,
    ) -> Result<ExtractedGraph, EditError> {
        let (nodes, to) = (self.nodes.clone(), self.to.clone());
        let (kind, name) = (self.name.clone(), self.node.clone());
        let extraction = Extraction { nodes, to, kind, name };
        let (text, options) = (file.text()?, file.options());
        let extracted = maquette_edit::extract(file.graph, &text, &extraction, catalog, &options);
        extracted.map_err(EditError::Refused)
    }
}

/// Writes the edited and the new file. If one of them cannot be written, neither is changed.
fn write(file: &GraphFile<'_>, extracted: &ExtractedGraph) -> Result<(), EditError> {
    let ExtractedGraph { edited, path, text, .. } = extracted;
    file.check_same_text(&edited.before)?;
    let written = rewrite_with(file.graph, &edited.text, (path, text));
    written.map_err(|(path, error)| EditError::Write(path, error))
}
