//! The values that pass between a set of nodes and the other nodes of a graph.

use std::collections::BTreeSet;

use maquette_graph::EditError;
use maquette_graph::canonical::node_of_link;
use maquette_syntax::error::{Span, code};

use super::{ParsedGraph, ResolvedLink, edit_error, free_name};

/// The values that pass between a set of nodes and the other nodes. Each value is listed once.
pub(super) struct Border {
    pub(super) inputs: Vec<Crossing>,
    pub(super) outputs: Vec<Crossing>,
}

/// A value that crosses the border: a node on one side computes it, and a link on the other side leads to it.
pub(super) struct Crossing {
    /// The index of the node that computes the value, and the index of the node's output.
    pub(super) target: (usize, usize),
    /// The text of the first link across the border to this value.
    pub(super) link: String,
    /// The name of the input or output of the new graph that passes the value on.
    pub(super) name: String,
    /// The name of the value's type, such as `Mesh`.
    pub(super) kind: &'static str,
    /// The positions of all links across the border to this value.
    pub(super) spans: Vec<Span>,
}

impl Border {
    /// Finds the values that enter and leave a set of nodes.
    ///
    /// # Errors
    /// A value that crosses the border is a list, or its type is unknown.
    pub(super) fn find(known: &ParsedGraph, set: &BTreeSet<usize>) -> Result<Self, EditError> {
        let (mut inputs, mut outputs) = (Vec::new(), Vec::new());
        for link in &known.links {
            fn is_in(at: Option<usize>, set: &BTreeSet<usize>) -> bool {
                at.is_some_and(|at| set.contains(&at))
            }
            let node = node_of_link(&link.text);
            match (is_in(known.owner(link.span), set), is_in(known.position("nodes", node), set)) {
                (true, false) => {
                    let help = format!("extract `{node}`, too");
                    add_crossing(known, link, &mut inputs, "inputs", help)?;
                }
                (false, true) => {
                    let help = "extract the nodes that need them, too".to_owned();
                    add_crossing(known, link, &mut outputs, "outputs", help)?;
                }
                _ => {}
            }
        }
        if outputs.is_empty() {
            outputs = end_outputs(known, set);
        }
        // Sort the values by the positions of their nodes in the text.
        outputs.sort_by_key(|output| output.target);
        let nodes = set.iter().filter_map(|&at| known.entries("nodes")[at].0.text());
        // A node that uses the new graph sets both inputs and parameters by fields, so their names must differ.
        let mut taken = BTreeSet::from_iter(nodes.chain(known.names("params")).map(str::to_owned));
        assign_names(&mut inputs, &mut taken);
        assign_names(&mut outputs, &mut BTreeSet::new());
        Ok(Self { inputs, outputs })
    }
}

fn add_crossing(
    known: &ParsedGraph,
    link: &ResolvedLink,
    crossings: &mut Vec<Crossing>,
    what: &str,
    help: String,
) -> Result<(), EditError> {
    let Some(target) = known.single_target(link) else {
        let message = format!(
            "{} takes all of `{}`, but the {what} of a graph are single values",
            link.by, link.text
        );
        return Err(edit_error(code::WRONG_TYPE, link.span, message, help));
    };
    if let Some(crossing) = crossings.iter_mut().find(|it| it.target == target) {
        crossing.spans.push(link.span);
        return Ok(());
    }
    let parsed = &known.definition().parsed_nodes[target.0];
    let Some(kind) = parsed.types.get(target.1).copied().flatten() else {
        let message = format!("nobody knows of which type `{}` is", link.text);
        return Err(edit_error(code::WRONG_TYPE, link.span, message, help));
    };
    crossings.push(Crossing {
        target,
        link: link.text.clone(),
        name: String::new(),
        kind: kind.name,
        spans: vec![link.span],
    });
    Ok(())
}

/// Returns the unused outputs of a set of nodes: the first output of each node that is not linked, unless that output is a list.
fn end_outputs(known: &ParsedGraph, set: &BTreeSet<usize>) -> Vec<Crossing> {
    let nodes = known.entries("nodes");
    let parsed_nodes = &known.definition().parsed_nodes;
    set.iter()
        .filter_map(|&at| {
            let name = nodes[at].0.text()?;
            let is_needed = known.links.iter().any(|link| node_of_link(&link.text) == name);
            let index =
                parsed_nodes.iter().position(|parsed| parsed.name.text == name && !is_needed)?;
            let kind = parsed_nodes[index].types.first().copied().flatten()?.name;
            let (target, link) = ((index, 0), name.to_owned());
            let single = !parsed_nodes[index].is_list(0);
            single.then(|| Crossing { target, link, name: String::new(), kind, spans: Vec::new() })
        })
        .collect()
}

/// Names each value after its source node or output, such as `color` for `scan.color`. If that name is taken, the name is `scan-color`.
fn assign_names(crossings: &mut [Crossing], taken: &mut BTreeSet<String>) {
    for crossing in crossings {
        let (node, output) = match crossing.link.split_once('.') {
            Some((node, output)) => (node, Some(output)),
            None => (&crossing.link[..], None),
        };
        fn join_with_hyphens(words: &[&str]) -> String {
            words.join("-").replace(['_', '/'], "-")
        }
        let wanted = match output {
            Some(output) => vec![join_with_hyphens(&[output]), join_with_hyphens(&[node, output])],
            None => vec![join_with_hyphens(&[node])],
        };
        crossing.name = free_name(
            wanted,
            |name, nth: usize| format!("{name}-{nth}"),
            |name| !taken.contains(name),
        );
        taken.insert(crossing.name.clone());
    }
}
