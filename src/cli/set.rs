//! `maquette set`: values put into a graph file.

use std::path::PathBuf;

use clap::Args;

use super::{Exit, assignment, eprint, print, print_document, report};
use crate::catalog::Catalog;
use crate::graph::{Files, Graph, Options};
use crate::plain;
use crate::writing::rewrite;

#[derive(Args)]
pub(super) struct Set {
    /// The graph file.
    graph: PathBuf,
    /// A parameter's default (NAME=VALUE) or a node's field (NODE.FIELD=VALUE). Dots lead further in: red.select.distance=25,
    /// raised.steps.0.distance=3. A value that is no RON is text.
    #[arg(required = true, value_name = "NODE.FIELD=VALUE", value_parser = assignment)]
    values: Vec<(String, String)>,
    /// Print the new text; write nothing.
    #[arg(long)]
    dry_run: bool,
    /// Let the graph read files of this folder, too.
    #[arg(long = "root", value_name = "DIR")]
    roots: Vec<PathBuf>,
}

impl Set {
    pub(super) fn run(&self, catalog: &Catalog) -> Exit {
        let text = match plain::read_text(&self.graph) {
            Ok(text) => text,
            Err(error) => {
                eprint(&format!("error: cannot read {}: {error}\n", self.graph.display()));
                return Exit::Failed;
            }
        };
        let options =
            Options { roots: self.roots.clone(), files: Files::Ignored, ..Options::default() };
        let edited = Graph::edited(&self.graph, &text, &self.values, catalog, &options);
        let edited = match edited {
            Ok(edited) => edited,
            Err(problems) => {
                report(&problems);
                return Exit::Failed;
            }
        };
        if self.dry_run {
            print_document(&edited.text);
            return Exit::Done;
        }
        if edited.text != text
            && let Err(error) = rewrite(&self.graph, &edited.text)
        {
            eprint(&format!("error: cannot write {}: {error}\n", self.graph.display()));
            return Exit::Failed;
        }
        for put in &edited.changes {
            let before = put.before.as_deref().unwrap_or("left out");
            print(&format!("{}: {before} -> {}\n", put.target, put.after));
        }
        Exit::Done
    }
}
