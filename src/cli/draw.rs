//! `maquette draw`: a graph as a picture.

use std::path::PathBuf;

use clap::Args;
use maquette_diagram::Drawing;
use maquette_engine::writing::{Destination, Sources};
use maquette_graph::catalog::Catalog;
use maquette_graph::{Files, Graph, Options};
use maquette_value::plain::ending;

use super::{Exit, print_document, report};
use crate::Shown;

#[derive(Args)]
pub(crate) struct Draw {
    /// The graph file.
    graph: PathBuf,
    /// The file to write, by its ending SVG (`.svg`) or Graphviz's language (`.dot` or `.gv`); the terminal if left out.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Write Graphviz's language instead of SVG.
    #[arg(long)]
    dot: bool,
}

impl Draw {
    pub(super) fn run(&self, catalog: &Catalog) -> Exit {
        let dot = match self.out.as_deref().map(ending).as_deref() {
            None => self.dot,
            Some("dot" | "gv") => true,
            Some("svg") if !self.dot => false,
            Some(_) if self.dot => return Exit::Usage("--dot writes `.dot` or `.gv` files".into()),
            Some(_) => return Exit::Usage("--out names a `.svg`, `.dot` or `.gv` file".into()),
        };
        let options = Options { files: Files::Ignored, ..Options::default() };
        let checked = Graph::load(&self.graph, catalog, &options).as_far_as_known();
        report(&checked.problems);
        let Some(graph) = checked.graph else { return Exit::Failed };
        let drawing = Drawing::new(&graph, catalog);
        let text = if dot { drawing.to_dot() } else { drawing.to_svg() };
        let Some(path) = &self.out else {
            print_document(&text);
            return Exit::Done;
        };
        match Destination::anywhere(&Sources::of(&graph)).put(path, text.as_bytes()) {
            Ok(()) => Exit::Done,
            Err(error) => Exit::Usage(format!("cannot write {}: {error}", path.shown())),
        }
    }
}
