//! What goes into a set of nodes and what comes out of it.

use std::collections::BTreeSet;

use maquette_graph::Refusal;
use maquette_graph::meaning::named_node;
use maquette_syntax::error::{Span, code};

use super::{Known, Linked, free_name, refusal};

/// The values that cross the border of a set of nodes, each once.
pub(super) struct Border {
    pub(super) inputs: Vec<Crossing>,
    pub(super) outputs: Vec<Crossing>,
}

/// A value that crosses the border.
pub(super) struct Crossing {
    /// The draft and the output of it.
    pub(super) target: (usize, usize),
    /// What the first of its links says.
    pub(super) link: String,
    /// The name of the input or output.
    pub(super) name: String,
    /// The type of the value.
    pub(super) kind: &'static str,
    /// Where its links stand.
    pub(super) spans: Vec<Span>,
}

impl Border {
    /// # Errors
    /// What crosses it is a list, or of no known type.
    pub(super) fn of(known: &Known, set: &BTreeSet<usize>) -> Result<Self, Refusal> {
        let (mut inputs, mut outputs) = (Vec::new(), Vec::new());
        for link in &known.links {
            fn is_in(at: Option<usize>, set: &BTreeSet<usize>) -> bool {
                at.is_some_and(|at| set.contains(&at))
            }
            let node = named_node(&link.text);
            match (is_in(known.owner(link.span), set), is_in(known.position("nodes", node), set)) {
                (true, false) => {
                    let help = format!("extract `{node}`, too");
                    cross(known, link, &mut inputs, "inputs", help)?;
                }
                (false, true) => {
                    let help = "extract what needs them, too".to_owned();
                    cross(known, link, &mut outputs, "outputs", help)?;
                }
                _ => {}
            }
        }
        if outputs.is_empty() {
            outputs = ends(known, set);
        }
        // As the nodes stand in the text.
        outputs.sort_by_key(|output| output.target);
        let nodes = set.iter().filter_map(|&at| known.entries("nodes")[at].0.text());
        // A field of a use is an input or a parameter.
        let mut taken = BTreeSet::from_iter(nodes.chain(known.names("params")).map(str::to_owned));
        name(&mut inputs, &mut taken);
        name(&mut outputs, &mut BTreeSet::new());
        Ok(Self { inputs, outputs })
    }
}

fn cross(
    known: &Known,
    link: &Linked,
    crossings: &mut Vec<Crossing>,
    what: &str,
    help: String,
) -> Result<(), Refusal> {
    let Some(target) = known.value(link) else {
        let message = format!(
            "{} takes all of `{}`, but the {what} of a graph are single values",
            link.by, link.text
        );
        return Err(refusal(code::WRONG_TYPE, link.span, message, help));
    };
    if let Some(crossing) = crossings.iter_mut().find(|it| it.target == target) {
        crossing.spans.push(link.span);
        return Ok(());
    }
    let draft = &known.definition().drafts[target.0];
    let Some(kind) = draft.types.get(target.1).copied().flatten() else {
        let message = format!("nobody knows of which type `{}` is", link.text);
        return Err(refusal(code::WRONG_TYPE, link.span, message, help));
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

/// Where nothing else needs the nodes: those that none of themselves needs, as far as they give single values.
fn ends(known: &Known, set: &BTreeSet<usize>) -> Vec<Crossing> {
    let nodes = known.entries("nodes");
    let drafts = &known.definition().drafts;
    set.iter()
        .filter_map(|&at| {
            let name = nodes[at].0.text()?;
            let is_needed = known.links.iter().any(|link| named_node(&link.text) == name);
            let draft = drafts.iter().position(|draft| draft.name.text == name && !is_needed)?;
            let kind = drafts[draft].types.first().copied().flatten()?.name;
            let (target, link) = ((draft, 0), name.to_owned());
            let single = !drafts[draft].is_list(0);
            single.then(|| Crossing { target, link, name: String::new(), kind, spans: Vec::new() })
        })
        .collect()
}

/// Names each after what it comes from: `color` of `scan.color`, or `scan-color` where that is taken.
fn name(crossings: &mut [Crossing], taken: &mut BTreeSet<String>) {
    for crossing in crossings {
        let (node, output) = match crossing.link.split_once('.') {
            Some((node, output)) => (node, Some(output)),
            None => (&crossing.link[..], None),
        };
        fn plain(words: &[&str]) -> String {
            words.join("-").replace(['_', '/'], "-")
        }
        let wanted = match output {
            Some(output) => vec![plain(&[output]), plain(&[node, output])],
            None => vec![plain(&[node])],
        };
        crossing.name = free_name(
            wanted,
            |name, nth: usize| format!("{name}-{nth}"),
            |name| !taken.contains(name),
        );
        taken.insert(crossing.name.clone());
    }
}
