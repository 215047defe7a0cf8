//! `maquette draw`: draws a graph as a diagram.

use std::path::PathBuf;

use clap::Args;
use maquette_diagram::Drawing;
use maquette_engine::writing::{Destination, Sources};
use maquette_graph::catalog::Catalog;
use maquette_graph::{Files, Graph, Options};
use maquette_value::fs::extension;

use super::{Exit, print_document, report};
use crate::DisplayPath;

#[derive(Args)]
pub(crate) struct Draw {
    /// The graph file.
    graph: PathBuf,
    /// The file to write: SVG (`.svg`) or Graphviz (`.dot` or `.gv`) [default: standard output].
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Write Graphviz instead of SVG.
    #[arg(long)]
    dot: bool,
}

impl Draw {
    pub(super) fn run(&self, catalog: &Catalog) -> Exit {
        let dot = match self.out.as_deref().map(extension).as_deref() {
            None => self.dot,
            Some("dot" | "gv") => true,
            Some("svg") if !self.dot => false,
            Some(_) if self.dot => {
                return Exit::Usage("expected a `.dot` or `.gv` file for --dot".into());
            }
            Some(_) => {
                return Exit::Usage("expected a `.svg`, `.dot` or `.gv` file for --out".into());
            }
        };
        let options = Options { files: Files::Ignored, ..Options::default() };
        let checked = Graph::load(&self.graph, catalog, &options).without_unknown_nodes();
        report(&checked.diagnostics);
        let Some(graph) = checked.graph else { return Exit::Failed };
        let drawing = Drawing::new(&graph, catalog);
        let text = if dot { drawing.to_dot() } else { drawing.to_svg() };
        let Some(path) = &self.out else {
            print_document(&text);
            return Exit::Done;
        };
        match Destination::anywhere(&Sources::of_graph(&graph)).put(path, text.as_bytes()) {
            Ok(()) => Exit::Done,
            Err(error) => Exit::Usage(format!("cannot write {}: {error}", path.for_display())),
        }
    }
}
