//! `maquette edit`: changes nodes, links, values, names and outputs of a graph file.

mod extract;
pub(crate) mod graph_file;
mod inline;
mod migrate;
mod set;

use std::path::PathBuf;

use clap::{Args, Subcommand};
use maquette_edit::Edit as GraphEdit;
use maquette_graph::catalog::Catalog;

use self::graph_file::GraphFile;
use super::{Exit, parse_assignment};

/// Every byte outside of the edited items stays. An edit that would leave an error in the graph is refused.
#[derive(Args)]
pub(crate) struct Edit {
    /// The graph file; for `migrate` a folder, too.
    graph: PathBuf,
    #[command(subcommand)]
    verb: Verb,
    /// Write nothing; print the lines that would change (`set`: the new text; `extract`: the new file, too).
    #[arg(long, global = true)]
    dry_run: bool,
    /// Let the graph read files of this folder, too.
    #[arg(long = "root", value_name = "DIR", global = true)]
    roots: Vec<PathBuf>,
}

#[derive(Subcommand)]
enum Verb {
    #[command(flatten)]
    Single(SingleEdit),
    /// Set values in a graph file: edit G set growth=20 red.select.distance=25
    Set(set::Set),
    /// Move nodes into a new graph file and use it in their place: edit G extract red spots --to lib/nose.ron
    Extract(extract::Extract),
    /// Replace a use of a graph by the nodes of that graph: edit G inline nose
    Inline(inline::Inline),
    /// Replace former names of nodes and fields by the present ones: edit G migrate --write
    Migrate(migrate::Migrate),
}

/// An `edit` subcommand that makes a single edit of the graph.
#[derive(Subcommand)]
enum SingleEdit {
    /// Add a node: edit G add mask Threshold image=scan.color 'select=Near(color: "#c33923")' --after scan
    Add {
        /// The name of the node.
        name: String,
        /// The type: a node type, a graph that this one uses, ForEach or Switch.
        node: String,
        /// The fields. A value that is not RON is text.
        #[arg(value_name = "FIELD=VALUE", value_parser = parse_assignment)]
        fields: Vec<(String, String)>,
        /// The existing node after which the new one is inserted; the last one if omitted.
        #[arg(long, value_name = "NODE")]
        after: Option<String>,
    },
    /// Remove a node, an input or a parameter with its comments.
    Remove {
        /// The name, or nodes.NAME or params.NAME if both exist.
        name: String,
        /// Remove all references, too: links to optional ports, entries of lists of links, outputs, expectations.
        #[arg(long)]
        and_links: bool,
    },
    /// Rename a node, an input or a parameter, with all references in this file.
    Rename {
        /// The name, or nodes.NAME or params.NAME if both exist.
        from: String,
        /// The new name.
        to: String,
    },
    /// Link a port: edit G link label.mask threshold
    Link {
        /// The port. A list of links gets one more; NODE.PORT.0 is its first link.
        #[arg(value_name = "NODE.PORT")]
        port: String,
        /// The linked output.
        #[arg(value_name = "NODE[.OUTPUT]")]
        to: String,
    },
    /// Remove the link of a port.
    Unlink {
        /// The port. All links of a list are removed; NODE.PORT.0 is its first link.
        #[arg(value_name = "NODE.PORT")]
        port: String,
    },
    /// Add or change an output: edit G output model.glb skin. Without a link the output is removed.
    Output {
        /// The file, or the port of a graph that others use.
        name: String,
        /// The node whose value is written.
        #[arg(value_name = "NODE[.OUTPUT]")]
        to: Option<String>,
    },
}

impl SingleEdit {
    fn to_edit(&self) -> GraphEdit {
        match self {
            Self::Add { name, node, fields, after } => GraphEdit::Add {
                name: name.clone(),
                node: node.clone(),
                fields: fields.clone(),
                after: after.clone(),
            },
            Self::Remove { name, and_links } => {
                GraphEdit::Remove { name: name.clone(), and_links: *and_links }
            }
            Self::Rename { from, to } => GraphEdit::Rename { from: from.clone(), to: to.clone() },
            Self::Link { port, to } => GraphEdit::Link { port: port.clone(), to: to.clone() },
            Self::Unlink { port } => GraphEdit::Unlink { port: port.clone() },
            Self::Output { name, to } => GraphEdit::Output { name: name.clone(), to: to.clone() },
        }
    }
}

impl Edit {
    pub(super) fn run(&self, catalog: &Catalog) -> Exit {
        let file = GraphFile {
            graph: &self.graph,
            roots: &self.roots,
            draft: false,
            dry_run: self.dry_run,
        };
        match &self.verb {
            Verb::Single(edit) => {
                let edits = [edit.to_edit()];
                let Some(edited) = file.edit(&edits, catalog) else { return Exit::Failed };
                file.print_changes(edited, catalog);
                Exit::Done
            }
            Verb::Set(set) => set.run(file, catalog),
            Verb::Extract(extract) => extract.run(&file, catalog),
            Verb::Inline(inline) => inline.run(&file, catalog),
            Verb::Migrate(migrate) => migrate.run(&file, catalog),
        }
    }
}
