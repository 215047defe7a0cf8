//! The nodes of a graph as they were when its golden was accepted, and how they differ now: why a result changed.

use crate::eval::RunTrace;
use crate::graph::{Graph, Link};
use crate::text::FILE;

/// Begins the line of a warning, among those of the nodes.
const WARNING: &str = "warning  ";

/// Which warnings of nodes came or went, in words. That of a node which only got another name did neither.
pub(super) fn changed_warnings(before: &str, now: &str) -> Vec<String> {
    fn of(text: &str) -> Vec<&str> {
        text.lines().filter_map(|line| line.strip_prefix(WARNING)).collect()
    }
    let (old, new) = (of(before), of(now));
    let mut gone = Vec::from_iter(old.iter().filter(|line| !new.contains(line)));
    let mut came = Vec::from_iter(new.iter().filter(|line| !old.contains(line)));
    gone.retain(|was| {
        let renamed = came.iter().position(|is| is_renamed((before, was), (now, is)));
        renamed.map(|at| came.remove(at)).is_none()
    });
    let gone = gone.into_iter().map(|line| format!("there is no longer the warning {line}"));
    gone.chain(came.into_iter().map(|line| format!("there is a new warning {line}"))).collect()
}

/// Whether two lines of warnings say the same of nodes of one type, of which one is gone and the other one new.
fn is_renamed((before, was): (&str, &str), (now, is): (&str, &str)) -> bool {
    fn named(line: &str) -> Option<(&str, &str)> {
        line.strip_prefix('`')?.split_once("`: ")
    }
    let (Some((old, was)), Some((new, is))) = (named(was), named(is)) else { return false };
    let kind = |text: &'_ str, name: &str| {
        let line = nodes(text).map(split).find(|(other, _)| *other == name)?;
        line.1.split(' ').next().map(str::to_owned)
    };
    let is_gone = kind(now, old).is_none() && kind(before, new).is_none();
    was == is && is_gone && kind(before, old) == kind(now, new)
}

fn split(line: &str) -> (&str, &str) {
    line.split_once("  ").unwrap_or((line, ""))
}

fn nodes(text: &str) -> impl Iterator<Item = &str> {
    text.lines().filter(|line| !line.starts_with(WARNING))
}

/// What of the nodes' lines differs: `raised: {..12..} -> {..15..}`.
pub(super) fn changed_lines(before: &str, now: &str) -> Vec<String> {
    let (old, new) =
        (Vec::from_iter(nodes(before).map(split)), Vec::from_iter(nodes(now).map(split)));
    let mut changes = Vec::new();
    for (name, was) in &old {
        match new.iter().find(|(other, _)| other == name) {
            None => changes.push(format!("node `{name}` is gone")),
            Some((_, is)) if is != was => {
                // Only what lies between the common start and end is told.
                let (was, is) = (between(was, is), between(is, was));
                changes.push(format!("node `{name}`: {} -> {}", short(was), short(is)));
            }
            Some(_) => {}
        }
    }
    let is_new = |(name, _): &&(&str, &str)| !old.iter().any(|(other, _)| other == name);
    changes.extend(new.iter().filter(is_new).map(|(name, _)| format!("node `{name}` is new")));
    changes
}

/// The part of a text that another one does not have, as whole words.
fn between<'a>(text: &'a str, other: &str) -> &'a str {
    const MARKS: [char; 8] = [' ', ',', '{', '}', '[', ']', '(', ')'];
    let start = text.char_indices().zip(other.chars()).find(|((_, a), b)| a != b);
    let start = start.map_or(text.len().min(other.len()), |((at, _), _)| at);
    let start = text.get(..start).and_then(|before| before.rfind(MARKS)).map_or(0, |at| at + 1);
    let same = text.chars().rev().zip(other.chars().rev()).take_while(|(a, b)| a == b);
    let same: usize = same.map(|(c, _)| c.len_utf8()).sum();
    let end = (text.len() - same).max(start);
    let end = text[end..].find(MARKS).map_or(text.len(), |more| end + more);
    &text[start..end]
}

fn short(text: &str) -> String {
    match text.char_indices().nth(60) {
        Some((end, _)) => format!("{}..", &text[..end]),
        None => text.to_owned(),
    }
}

/// Each node's type, parameters and links on a line, sorted; then each warning.
pub(super) fn nodes_of(graph: &Graph, needed: &RunTrace) -> String {
    let mut lines = Vec::new();
    for node in
        graph.nodes.iter().filter(|node| needed.0.iter().any(|trace| trace.name == node.name))
    {
        let link = |link: &Link| {
            let target = &graph.nodes[link.node];
            format!("{}: {}.{}", link.port, target.name, target.outputs[link.output])
        };
        let links = Vec::from_iter(node.links.iter().map(link)).join(", ");
        let mut parameters = node.recipe.parameters.clone();
        without_machine(&mut parameters);
        let files = node.files.iter().filter_map(|file| {
            let hash = crate::Hash::of(&crate::plain::read(&file.path).ok()?);
            Some(format!(" {} {}", file.given, hash.short()))
        });
        let files: String = files.collect();
        lines.push(format!("{}  {} {parameters} ({links}){files}", node.name, node.kind()));
    }
    lines.sort();
    for node in &needed.0 {
        lines.extend(node.warnings.iter().map(|text| format!("{WARNING}`{}`: {text}", node.name)));
    }
    lines.join("\n") + "\n"
}

/// Takes away what depends on where the graph is: the paths of files, which are named apart.
fn without_machine(parameters: &mut serde_json::Value) {
    match parameters {
        serde_json::Value::Object(entries) => {
            entries.retain(|key, _| key != FILE);
            entries.values_mut().for_each(without_machine);
        }
        serde_json::Value::Array(items) => items.iter_mut().for_each(without_machine),
        _ => {}
    }
}
