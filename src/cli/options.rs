//! Options of commands that load a graph.

use std::path::{Path, PathBuf};

use clap::Args;
use maquette_engine::session::OutputFolder;
use maquette_graph::catalog::Catalog;
use maquette_graph::{CheckedGraph, Graph, Options};

use crate::cache_options::CacheOptions;
use crate::inputs::InputOptions;

/// Options for evaluating a graph.
#[derive(Args)]
pub(crate) struct EvaluationOptions {
    #[command(flatten)]
    pub(crate) inputs: InputOptions,
    #[command(flatten)]
    pub(crate) graph: GraphOptions,
    #[command(flatten)]
    pub(crate) cache: CacheOptions,
}

/// Options for loading a graph.
#[derive(Args)]
pub(crate) struct GraphOptions {
    /// Set a parameter (NAME=VALUE) or a field of a node (NODE.FIELD=VALUE). A value that is not RON is text.
    #[arg(long = "set", value_name = "NAME=VALUE", value_parser = parse_assignment)]
    pub(crate) set: Vec<(String, String)>,
    /// Let the graph read files of this folder, too.
    #[arg(long = "root", value_name = "DIR")]
    pub(crate) roots: Vec<PathBuf>,
    /// Use the draft value of each `Draft(final: .., draft: ..)` for a quick preview.
    #[arg(long)]
    pub(crate) draft: bool,
    /// Reject the graph if a used graph differs from the lock file.
    #[arg(long)]
    pub(crate) locked: bool,
    /// Ignore pins: run the pinned nodes, too.
    #[arg(long)]
    pub(crate) no_pins: bool,
}

pub(crate) fn parse_assignment(text: &str) -> Result<(String, String), String> {
    let (name, value) = text.split_once('=').ok_or("expected NAME=VALUE or NODE.FIELD=VALUE")?;
    Ok((name.trim().to_owned(), value.trim().to_owned()))
}

impl GraphOptions {
    pub(crate) fn load(&self, path: &Path, catalog: &Catalog) -> CheckedGraph {
        Graph::load(path, catalog, &self.to_options())
    }

    pub(crate) fn to_options(&self) -> Options {
        let (roots, set) = (self.roots.clone(), self.set.clone());
        let Self { draft, locked, no_pins, .. } = *self;
        Options { roots, set, draft, locked, pins: !no_pins, ..Options::default() }
    }

    /// Returns the folder for the outputs of a graph: `named` if it is given, otherwise the default folder. Drafts have another default
    /// folder.
    pub(crate) fn output_folder(&self, named: Option<&Path>, graph: &Path) -> OutputFolder {
        if self.draft {
            OutputFolder::of_draft(named, graph)
        } else {
            OutputFolder::new(named, graph)
        }
    }
}
