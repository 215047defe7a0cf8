//! What shapes the reading of a graph, as words of a command.

use std::path::{Path, PathBuf};

use clap::Args;
use maquette_engine::session::OutputFolder;
use maquette_graph::catalog::Catalog;
use maquette_graph::{Checked, Graph, Options};

/// What shapes the reading of a graph.
#[derive(Args)]
pub(crate) struct GraphOptions {
    /// Put a value in place of a parameter's default (NAME=VALUE) or of a node's field (NODE.FIELD=VALUE). A value that is no
    /// RON is text.
    #[arg(long = "set", value_name = "NAME=VALUE", value_parser = assignment)]
    pub(crate) set: Vec<(String, String)>,
    /// Let the graph read files of this folder, too.
    #[arg(long = "root", value_name = "DIR")]
    pub(crate) roots: Vec<PathBuf>,
    /// Take the draft of each `Draft(final: .., draft: ..)`, for a first look.
    #[arg(long)]
    pub(crate) draft: bool,
    /// Refuse the graph if one that it uses is not what the lock file says.
    #[arg(long)]
    pub(crate) locked: bool,
    /// Run the nodes that are pinned, too, as if there were no pins.
    #[arg(long)]
    pub(crate) no_pins: bool,
}

pub(crate) fn assignment(text: &str) -> Result<(String, String), String> {
    let (name, value) = text.split_once('=').ok_or("write NAME=VALUE or NODE.FIELD=VALUE")?;
    Ok((name.trim().to_owned(), value.trim().to_owned()))
}

impl GraphOptions {
    pub(crate) fn load(&self, path: &Path, catalog: &Catalog) -> Checked {
        Graph::load(path, catalog, &self.all())
    }

    pub(crate) fn all(&self) -> Options {
        let (roots, set) = (self.roots.clone(), self.set.clone());
        let Self { draft, locked, no_pins, .. } = *self;
        Options { roots, set, draft, locked, pins: !no_pins, ..Options::default() }
    }

    /// The folder for the outputs of a graph: the one that was named, else one that drafts have apart.
    pub(crate) fn folder(&self, named: Option<&Path>, graph: &Path) -> OutputFolder {
        if self.draft {
            OutputFolder::of_draft(named, graph)
        } else {
            OutputFolder::new(named, graph)
        }
    }
}
