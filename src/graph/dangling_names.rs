//! Error messages for names that do not exist in a graph. In some names, such as `spots/9`, the number of the element is too large. Other
//! names refer to a node inside of a used graph: `inspect` shows these names, but links and expectations can only refer to outputs.

use maquette_syntax::{Help, nearest_or_all, unknown_name_message};

use super::Graph;
use super::check::Check;
use super::definition::Definition;
use super::for_each::element_name;
use super::link::{NamedTarget, Names};
use crate::definition::{NodeKind, ParsedNode};

impl Check<'_, '_> {
    /// Returns the message and help for a link to an unknown node whose name contains `/`. `None` if no special message applies.
    pub(super) fn dangling_link(
        &self,
        link: &str,
        parsed_nodes: &[ParsedNode],
        names: &Names<'_>,
    ) -> Option<(String, Help)> {
        let name = link.split('.').next().unwrap_or_default();
        let (outer, inner) = name.split_once('/')?;
        let number = inner.split('/').next().unwrap_or_default();
        let (parsed, node) = match names.find(outer)? {
            NamedTarget::ForEach(each) => {
                let each = &names.for_each_nodes[each];
                let count = each.elements.len();
                if count == 0 && each.outputs.is_none() {
                    return None;
                }
                let Some(place) = element_index(number, count) else {
                    return Some(missing_element(name, outer, count));
                };
                (&parsed_nodes[each.elements[place]], element_name(outer, place))
            }
            NamedTarget::Node(index) if parsed_nodes[index].repeat.is_some() => {
                if number.parse::<usize>().is_err() {
                    let help = format!("the elements of `{outer}` are `{outer}/1` and so on");
                    return Some((format!("there is no node `{name}`"), help.into()));
                }
                (&parsed_nodes[index], format!("{outer}/{number}"))
            }
            NamedTarget::Node(index) => (&parsed_nodes[index], outer.to_owned()),
        };
        match &parsed.what {
            NodeKind::Use(kind, graph) => Some(inside_use_message(link, &node, kind, graph)),
            what if what.outputs().contains(&inner) && link == name => {
                let meant = format!("{outer}.{inner}");
                let help = Help::rename(format!("did you mean `{meant}`?"), link, &meant);
                Some((format!("there is no node `{name}`"), help))
            }
            _ => None,
        }
    }
}

/// Returns the message and help for a link that refers to a node inside of a used graph. Only the outputs of a used graph can be linked.
fn inside_use_message(link: &str, node: &str, kind: &str, graph: &Definition) -> (String, Help) {
    let (name, wanted) = link.split_once('.').map_or((link, None), |(name, it)| (name, Some(it)));
    let message =
        format!("`{name}` is inside the graph `{kind}`, of which only outputs can be named");
    if let Some(port) = graph.ports.iter().find(|port| {
        port.target.is_some_and(|(index, output): (usize, usize)| {
            let parsed = &graph.parsed_nodes[index];
            name.strip_prefix(node).and_then(|it| it.strip_prefix('/')) == Some(&parsed.name.text)
                && wanted.map_or(output == 0, |wanted| {
                    parsed.what.outputs().get(output) == Some(&wanted)
                })
        })
    }) {
        let same = format!("{node}.{}", port.name);
        return (message, Help::rename(format!("write `{same}`, which is the same"), link, &same));
    }
    let known = graph.ports.iter().map(|port| format!("`{node}.{}`", port.name));
    let known = Vec::from_iter(known).join(", ");
    let help =
        format!("name one of {known}, or add an output or an expectation to the file of `{kind}`");
    (message, help.into())
}

/// Returns the index, from 0, of the element with this number, from 1. `None` if there are fewer elements.
fn element_index(number: &str, count: usize) -> Option<usize> {
    number.parse::<usize>().ok()?.checked_sub(1).filter(|place| *place < count)
}

/// Returns the message and help for an element number that is too large.
pub(super) fn missing_element(name: &str, each: &str, count: usize) -> (String, Help) {
    let message = format!("there is no `{name}`: {}", element_count_text(each, count));
    let help = match count {
        0 => String::new(),
        1 => format!("it is `{each}/1`"),
        _ => format!("they are `{each}/1` to `{each}/{count}`"),
    };
    (message, help.into())
}

/// Returns a sentence that states the number of elements.
pub(super) fn element_count_text(each: &str, count: usize) -> String {
    match count {
        0 => format!("`{each}` has no elements"),
        1 => format!("`{each}` has 1 element"),
        _ => format!("`{each}` has {count} elements"),
    }
}

impl Graph {
    /// Returns a one-line message for an unknown name. It ends with the number of elements that exist, or with a suggestion of a similar
    /// name.
    pub fn unknown(&self, what: &str, name: &str, listed: &str, known: &[&str]) -> String {
        let message = format!("the graph has no {what} `{name}`");
        match self.element_count_help(name) {
            Some(count) => format!("{message}: {count}"),
            None => unknown_name_message(message, name, listed, known),
        }
    }

    /// Returns the help for a name that is not an output or a node of the graph.
    pub fn value_help(&self, name: &str) -> String {
        if let Some(count) = self.element_count_help(name) {
            return count;
        }
        // Compare a name inside of a used graph, such as `nose/maks`, only with the other names inside of that graph.
        let outer = name.split_once('/').map(|(outer, _)| format!("{outer}/"));
        let outer = outer.filter(|outer| self.node_names().any(|name| name.starts_with(outer)));
        let known = self.output_names().chain(self.node_names()).filter(|name| match &outer {
            Some(outer) => name.starts_with(outer),
            None => !name.contains('/'),
        });
        nearest_or_all(name, "its outputs and nodes", &Vec::from_iter(known)).into()
    }

    /// If the name contains an element number that is too large, returns a sentence that states the number of elements. Otherwise `None`.
    fn element_count_help(&self, name: &str) -> Option<String> {
        let name = name.split('.').next().unwrap_or_default();
        let slashes = name.match_indices('/').map(|(at, _)| (&name[..at], &name[at + 1..]));
        slashes.filter(|(each, _)| self.open_loop(each).is_none()).find_map(|(each, inner)| {
            self.uses.iter().find(|it| it.name == each && it.kind.starts_with("ForEach("))?;
            let count = self
                .names()
                .filter_map(|name| {
                    let inner = name.strip_prefix(each)?.strip_prefix('/')?;
                    inner.split('/').next()?.parse::<usize>().ok()
                })
                .max()
                .unwrap_or(0);
            let wanted = inner.split('/').next()?;
            wanted.parse::<usize>().ok()?;
            element_index(wanted, count).is_none().then(|| element_count_text(each, count))
        })
    }
}
