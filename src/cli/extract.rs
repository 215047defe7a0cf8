//! `maquette extract`: nodes of a graph that become a graph of their own.

use std::path::PathBuf;

use clap::Args;
use maquette_edit::{Extracted, Extraction};
use maquette_engine::writing::rewrite_with;
use maquette_graph::catalog::Catalog;

use super::edit::{EditError, GraphFile};
use super::{Exit, print, print_document};
use crate::Shown;

/// Every value stays what it was, and nothing is computed anew. What names the nodes in other files, as a Patch, a test or a pin does,
/// is left as it is. `inline` puts the nodes back.
#[derive(Args)]
pub(crate) struct Extract {
    /// The graph file.
    graph: PathBuf,
    /// The nodes.
    #[arg(required = true, value_name = "NODE")]
    nodes: Vec<String>,
    /// The file of the new graph; if left out, one beside the graph, with the name of the new node.
    #[arg(long, value_name = "FILE")]
    to: Option<PathBuf>,
    /// The type of nodes that the new graph is: Nose. Made of the file's name if left out.
    #[arg(long, value_name = "TYPE")]
    name: Option<String>,
    /// The name of the node that uses it: nose. Made of the type's if left out.
    #[arg(long = "as", value_name = "NODE")]
    node: Option<String>,
    /// Print the lines that would change, and the new file; write nothing.
    #[arg(long)]
    dry_run: bool,
    /// Let the graph read files of this folder, too.
    #[arg(long = "root", value_name = "DIR")]
    roots: Vec<PathBuf>,
}

impl Extract {
    pub(super) fn run(&self, catalog: &Catalog) -> Exit {
        let (graph, roots) = (&self.graph, &self.roots);
        let file = GraphFile { graph, roots, draft: false, dry_run: self.dry_run };
        let Extracted { edited, path, text, kind, name } = match self.done(&file, catalog) {
            Ok(done) => done,
            Err(error) => {
                error.tell();
                return Exit::Failed;
            }
        };
        print(&format!("{}: {kind}, used by `{name}`\n", path.shown()));
        if self.dry_run {
            let lines = text.lines().map(|line| format!("+{line}\n"));
            print_document(&String::from_iter(lines));
        }
        file.tell(edited, catalog);
        Exit::Done
    }

    /// The texts, which are in the files unless they are only tried.
    fn done(&self, file: &GraphFile<'_>, catalog: &Catalog) -> Result<Extracted, EditError> {
        if self.dry_run {
            return self.extracted(file, catalog);
        }
        let _turn = file.turn()?;
        let done = self.extracted(file, catalog)?;
        write(file, &done)?;
        Ok(done)
    }

    fn extracted(&self, file: &GraphFile<'_>, catalog: &Catalog) -> Result<Extracted, EditError> {
        let (nodes, to) = (self.nodes.clone(), self.to.clone());
        let (kind, name) = (self.name.clone(), self.node.clone());
        let extraction = Extraction { nodes, to, kind, name };
        let (text, options) = (file.text()?, file.options());
        let done = maquette_edit::extract(file.graph, &text, &extraction, catalog, &options);
        done.map_err(EditError::Refused)
    }
}

/// Writes both files, or none.
fn write(file: &GraphFile<'_>, done: &Extracted) -> Result<(), EditError> {
    let Extracted { edited, path, text, .. } = done;
    file.unchanged(&edited.before)?;
    let written = rewrite_with(file.graph, &edited.text, (path, text));
    written.map_err(|(path, error)| EditError::Write(path, error))
}
