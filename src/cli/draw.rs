//! `maquette draw`: a graph as a picture.

use std::path::PathBuf;

use clap::Args;

use super::{Exit, print_document, report};
use crate::catalog::Catalog;
use crate::draw::Drawing;
use crate::graph::{Files, Graph, Options};
use crate::plain::ending;
use crate::writing::{Destination, Sources};

#[derive(Args)]
pub(super) struct Draw {
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
        let checked = Graph::load(&self.graph, catalog, &options);
        report(&checked.problems);
        // What can be understood of a graph with unknown nodes is drawn, and is still a failure.
        let done = if checked.graph.is_some() { Exit::Done } else { Exit::Failed };
        let Some(graph) = checked.graph.or(checked.partial) else { return Exit::Failed };
        let drawing = Drawing::new(&graph, catalog);
        let text = if dot { drawing.to_dot() } else { drawing.to_svg() };
        let Some(path) = &self.out else {
            print_document(&text);
            return done;
        };
        match Destination::anywhere(&Sources::of(&graph)).put(path, text.as_bytes()) {
            Ok(()) => done,
            Err(error) => Exit::Usage(format!("cannot write {}: {error}", path.display())),
        }
    }
}
