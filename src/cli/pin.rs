//! `maquette pin` and `maquette unpin`: results of nodes that are kept beside the graph.

use std::path::PathBuf;
use std::sync::Arc;

use clap::Args;
use maquette_engine::session::{PinError, Run, Wanted, means, pinnable, unpin};
use maquette_graph::catalog::Catalog;
use maquette_graph::{Graph, Options, Pins};
use maquette_syntax::error::Severity;
use maquette_syntax::unknown;

use super::caching::{self, CacheOptions};
use super::{Exit, eprint, print, report};
use crate::Shown;

#[derive(Args)]
pub(crate) struct Pin {
    /// The graph file.
    graph: PathBuf,
    /// The node, which may be inside of a use (nose/mask), or a use of a graph: then the nodes that make its outputs.
    #[arg(required_unless_present = "list")]
    node: Option<String>,
    /// Print which nodes are pinned, and which pins are stale.
    #[arg(long, conflicts_with = "node")]
    list: bool,
    /// Let the graph read files of this folder, too.
    #[arg(long = "root", value_name = "DIR")]
    roots: Vec<PathBuf>,
    #[command(flatten)]
    cache: CacheOptions,
}

#[derive(Args)]
pub(crate) struct Unpin {
    /// The graph file.
    graph: PathBuf,
    /// The pinned nodes, or uses with pinned nodes in them.
    #[arg(required = true)]
    nodes: Vec<String>,
}

impl Pin {
    pub(super) fn run(&self, catalog: &Arc<Catalog>) -> Exit {
        let options = Options { roots: self.roots.clone(), ..Options::default() };
        let Some(name) = &self.node else { return self.print_list(catalog, options) };
        // What is pinned is what the graph gives by itself, whatever else is pinned.
        let checked = Graph::load(&self.graph, catalog, &options).as_far_as_known();
        report(&checked.problems);
        let Some(graph) = checked.graph else { return Exit::Failed };
        let names = match pinnable(&graph, name) {
            Ok(names) => names,
            Err(why) => return Exit::Usage(why),
        };
        let mut session = match self.cache.session(0, catalog) {
            Ok(session) => session,
            Err(why) => return Exit::Usage(why),
        };
        let wanted = Wanted::Nodes(vec![name.clone()]);
        let finished = match session.run(&graph, &Run { wanted, ..Run::default() }) {
            Ok(finished) => finished,
            Err(problems) => {
                report(&problems);
                return Exit::Failed;
            }
        };
        let problems = finished.problems();
        report(&problems);
        if problems.iter().any(|problem| problem.severity == Severity::Error) {
            return Exit::Failed;
        }
        let kept = finished.pin(&graph, &names);
        caching::finish(&session);
        match kept {
            Ok(files) => {
                for (name, file) in names.iter().zip(files) {
                    print(&format!("pinned {name}  {}\n", file.shown()));
                }
                Exit::Done
            }
            Err(error) => failed(&error),
        }
    }

    fn print_list(&self, catalog: &Catalog, options: Options) -> Exit {
        match Pins::of(&self.graph) {
            Ok(pins) => {
                for (name, pin) in &pins.pins {
                    let kinds: Vec<_> = pin.outputs.iter().map(|(kind, _)| &kind[..]).collect();
                    print(&format!("{name}  {}\n", kinds.join(", ")));
                }
            }
            Err(problem) => {
                report(&[*problem]);
                return Exit::Failed;
            }
        }
        let options = Options { pins: true, ..options };
        let checked = Graph::load(&self.graph, catalog, &options).as_far_as_known();
        report(&checked.problems);
        if checked.graph.is_some() { Exit::Done } else { Exit::Failed }
    }
}

impl Unpin {
    pub(super) fn run(&self, _: &Catalog) -> Exit {
        let taken = match unpin(&self.graph, &self.nodes) {
            Ok(taken) => taken,
            Err(error) => return failed(&error),
        };
        taken.iter().for_each(|name| print(&format!("unpinned {name}\n")));
        fn is_taken(name: &&String, taken: &[String]) -> bool {
            taken.iter().any(|pinned| means(name, pinned))
        }
        match self.nodes.iter().find(|name| !is_taken(name, &taken)) {
            None => Exit::Done,
            Some(name) => {
                let pins = Pins::of(&self.graph).unwrap_or_default();
                let known: Vec<_> = pins.pins.keys().map(|name| &name[..]).collect();
                Exit::Usage(unknown(format!("`{name}` is not pinned"), name, "pinned are", &known))
            }
        }
    }
}

fn failed(error: &PinError) -> Exit {
    match error {
        PinError::Unread(problem) => report(std::slice::from_ref(&**problem)),
        error => eprint(&format!("error: {error}\n")),
    }
    Exit::Failed
}
