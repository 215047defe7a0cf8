//! `maquette pin`: stores results of nodes next to the graph file, so that the nodes need not run. `--remove` removes them.

use std::path::PathBuf;
use std::sync::Arc;

use clap::Args;
use maquette_engine::session::{PinError, Run, Targets, matches_pin, pinnable, unpin};
use maquette_graph::catalog::Catalog;
use maquette_graph::{Graph, Options, Pins};
use maquette_syntax::unknown_name_message;

use super::cache_options::{self, CacheOptions};
use super::{Exit, eprint, has_errors, print, report};
use crate::DisplayPath;

#[derive(Args)]
pub(crate) struct Pin {
    /// The graph file.
    graph: PathBuf,
    /// The nodes. NOSE/MASK is a node inside of a used graph. For a use of a graph, the nodes that compute its outputs are pinned.
    #[arg(required_unless_present = "list", value_name = "NODE")]
    nodes: Vec<String>,
    /// Remove the pins of these nodes, or all pins inside of these uses: the nodes run again.
    #[arg(long)]
    remove: bool,
    /// List the pinned nodes and the outdated pins.
    #[arg(long, conflicts_with_all = ["nodes", "remove"])]
    list: bool,
    /// Let the graph read files of this folder, too.
    #[arg(long = "root", value_name = "DIR")]
    roots: Vec<PathBuf>,
    #[command(flatten)]
    cache: CacheOptions,
}

impl Pin {
    pub(super) fn run(&self, catalog: &Arc<Catalog>) -> Exit {
        let options = Options { roots: self.roots.clone(), ..Options::default() };
        match (self.list, self.remove) {
            (true, _) => self.print_list(catalog, options),
            (false, true) => self.remove_pins(),
            (false, false) => self.pin(catalog, &options),
        }
    }

    /// Runs the nodes and stores their results.
    fn pin(&self, catalog: &Arc<Catalog>, options: &Options) -> Exit {
        // Ignore existing pins, because the stored results must come from the nodes themselves.
        let checked = Graph::load(&self.graph, catalog, options).without_unknown_nodes();
        report(&checked.diagnostics);
        let Some(graph) = checked.graph else { return Exit::Failed };
        let mut names = Vec::new();
        for node in &self.nodes {
            match pinnable(&graph, node) {
                Ok(inner) => {
                    let new: Vec<_> = inner.into_iter().filter(|it| !names.contains(it)).collect();
                    names.extend(new);
                }
                Err(why) => return Exit::Usage(why),
            }
        }
        let mut session = match self.cache.session(0, catalog) {
            Ok(session) => session,
            Err(why) => return Exit::Usage(why),
        };
        let wanted = Targets::Nodes(self.nodes.clone());
        let finished = match session.run(&graph, &Run { targets: wanted, ..Run::default() }) {
            Ok(finished) => finished,
            Err(diagnostics) => {
                report(&diagnostics);
                return Exit::Failed;
            }
        };
        let diagnostics = finished.diagnostics();
        report(&diagnostics);
        if has_errors(&diagnostics) {
            return Exit::Failed;
        }
        let kept = finished.pin(&graph, &names);
        cache_options::finish(&session);
        match kept {
            Ok(files) => {
                for (name, file) in names.iter().zip(files) {
                    print(&format!("pinned {name}  {}\n", file.for_display()));
                }
                Exit::Done
            }
            Err(error) => report_failure(&error),
        }
    }

    fn print_list(&self, catalog: &Catalog, options: Options) -> Exit {
        match Pins::read(&self.graph) {
            Ok(pins) => {
                for (name, pin) in &pins.pins {
                    let kinds: Vec<_> = pin.outputs.iter().map(|(kind, _)| &kind[..]).collect();
                    print(&format!("{name}  {}\n", kinds.join(", ")));
                }
            }
            Err(diagnostic) => {
                report(&[*diagnostic]);
                return Exit::Failed;
            }
        }
        let options = Options { pins: true, ..options };
        let checked = Graph::load(&self.graph, catalog, &options).without_unknown_nodes();
        report(&checked.diagnostics);
        if checked.graph.is_some() { Exit::Done } else { Exit::Failed }
    }

    fn remove_pins(&self) -> Exit {
        let removed = match unpin(&self.graph, &self.nodes) {
            Ok(removed) => removed,
            Err(error) => return report_failure(&error),
        };
        removed.iter().for_each(|name| print(&format!("unpinned {name}\n")));
        match self.nodes.iter().find(|name| !removed.iter().any(|pin| matches_pin(name, pin))) {
            None => Exit::Done,
            Some(name) => {
                let pins = Pins::read(&self.graph).unwrap_or_default();
                let known: Vec<_> = pins.pins.keys().map(|name| &name[..]).collect();
                Exit::Usage(unknown_name_message(
                    format!("`{name}` is not pinned"),
                    name,
                    "pinned are",
                    &known,
                ))
            }
        }
    }
}

fn report_failure(error: &PinError) -> Exit {
    match error {
        PinError::Unread(diagnostic) => report(std::slice::from_ref(&**diagnostic)),
        error => eprint(&format!("error: {error}\n")),
    }
    Exit::Failed
}
