//! Describes the nodes of a graph as text. Goldens store this text, so that a report can explain why a result has changed.

use maquette_engine::eval::RunTrace;
use maquette_graph::{Graph, parameter_difference, parameter_name, short_text};
use maquette_syntax::{FILE, with_article};
use serde_json::Value as Json;

/// The start of each line that contains a warning.
const WARNING: &str = "warning  ";

/// Describes warnings of nodes that are new or missing. A warning whose node was only renamed does not count.
pub(super) fn changed_warnings(before: &str, now: &str) -> Vec<String> {
    fn warning_lines(text: &str) -> Vec<&str> {
        text.lines().filter_map(|line| line.strip_prefix(WARNING)).collect()
    }
    let (old, new) = (warning_lines(before), warning_lines(now));
    let mut missing: Vec<_> = old.iter().filter(|line| !new.contains(line)).collect();
    let mut added: Vec<_> = new.iter().filter(|line| !old.contains(line)).collect();
    missing.retain(|was| {
        let renamed = added.iter().position(|is| is_renamed((before, was), (now, is)));
        renamed.map(|at| added.remove(at)).is_none()
    });
    let gone = missing.into_iter().map(|line| format!("missing warning {line}"));
    gone.chain(added.into_iter().map(|line| format!("new warning {line}"))).collect()
}

/// Returns true if the node of a warning was only renamed: the warnings are equal, the nodes have the same type, and only the first node
/// existed before and only the second exists now.
fn is_renamed((before, was): (&str, &str), (now, is): (&str, &str)) -> bool {
    fn split_warning(line: &str) -> Option<(&str, &str)> {
        line.strip_prefix('`')?.split_once("`: ")
    }
    let (Some((old, was)), Some((new, is))) = (split_warning(was), split_warning(is)) else {
        return false;
    };
    fn kind<'t>(text: &'t str, name: &str) -> Option<&'t str> {
        let (_, line) = nodes(text).map(split).find(|(other, _)| *other == name)?;
        line.split(' ').next()
    }
    let is_gone = kind(now, old).is_none() && kind(before, new).is_none();
    was == is && is_gone && kind(before, old) == kind(now, new)
}

fn split(line: &str) -> (&str, &str) {
    line.split_once("  ").unwrap_or((line, ""))
}

fn nodes(text: &str) -> impl Iterator<Item = &str> {
    text.lines().filter(|line| !line.starts_with(WARNING))
}

/// Describes the nodes whose lines differ, for example "node `raised`: parameter `distance` 12 -> 15".
pub(super) fn changed_lines(before: &str, now: &str) -> Vec<String> {
    let (mut old, new) =
        (nodes(before).map(split).collect::<Vec<_>>(), nodes(now).map(split).collect::<Vec<_>>());
    // Natural sort: compare numeric path segments as numbers.
    old.sort_by_cached_key(|(name, _)| {
        name.split('/').map(|part| (part.parse::<usize>().ok(), part)).collect::<Vec<_>>()
    });
    let mut changes = Vec::new();
    for (name, was) in &old {
        match new.iter().find(|(other, _)| other == name) {
            None => changes.push(format!("node `{name}` is gone")),
            Some((_, is)) if is != was => {
                let difference =
                    Line::read(was).zip(Line::read(is)).and_then(|(was, is)| was.difference(is));
                let difference = difference.unwrap_or_else(|| "it has changed".to_owned());
                changes.push(format!("node `{name}`: {difference}"));
            }
            Some(_) => {}
        }
    }
    changes.extend(
        new.iter()
            .filter(|(name, _)| !old.iter().any(|(other, _)| other == name))
            .map(|(name, _)| format!("node `{name}` is new")),
    );
    changes
}

/// The parsed line about a node, without the name of the node.
struct Line<'a> {
    kind: &'a str,
    parameters: Json,
    links: &'a str,
    /// The names of the node's files, each followed by a hash.
    files: Vec<&'a str>,
}

impl<'a> Line<'a> {
    fn read(text: &'a str) -> Option<Self> {
        let (kind, rest) = text.split_once(' ')?;
        let mut values = serde_json::Deserializer::from_str(rest).into_iter();
        let parameters = values.next()?.ok()?;
        let rest = rest[values.byte_offset()..].strip_prefix(" (")?;
        let (links, files) = rest.split_once(')')?;
        Some(Self { kind, parameters, links, files: files.split_whitespace().collect() })
    }

    /// Describes the difference between the line of a node before and now, in the words of `maquette why`. Returns `None` if there is no
    /// visible difference.
    fn difference(mut self, now: Self) -> Option<String> {
        const MAX_PARAMETERS: usize = 3;
        let mut changes = Vec::new();
        if self.kind != now.kind {
            return Some(format!(
                "it is {}, and was {} before",
                with_article(now.kind),
                with_article(self.kind)
            ));
        }
        while let Some((path, was, is)) = parameter_difference(&self.parameters, &now.parameters) {
            if changes.len() == MAX_PARAMETERS {
                changes.push("and more".to_owned());
                break;
            }
            let change = format!("{} -> {}", short_text(&was), short_text(&is));
            if path.is_empty() {
                return Some(format!("its parameters {change}"));
            }
            changes.push(format!("parameter `{}` {change}", parameter_name(&path)));
            let steps = path.iter().map(|step| step.replace('~', "~0").replace('/', "~1"));
            let steps = String::from_iter(steps.map(|step| format!("/{step}")));
            *self.parameters.pointer_mut(&steps)? = is;
        }
        if self.links != now.links {
            changes.push(format!("links ({}) -> ({})", short(self.links), short(now.links)));
        }
        let same_names = self.files.iter().step_by(2).eq(now.files.iter().step_by(2));
        match same_names {
            true => {
                let pairs = self.files.chunks(2).zip(now.files.chunks(2));
                let changed = pairs.filter(|(was, is)| was != is);
                changes.extend(changed.map(|(was, _)| format!("file {} changed", was[0])));
            }
            false => changes.push("it reads other files".to_owned()),
        }
        (!changes.is_empty()).then(|| changes.join(", "))
    }
}

fn short(text: &str) -> String {
    match text.char_indices().nth(60) {
        Some((end, _)) => format!("{}..", &text[..end]),
        None => text.to_owned(),
    }
}

/// Returns all needed nodes as text. First comes one line for each node with its type, parameters and links, sorted; then one line for each
/// warning.
pub(super) fn nodes_of(graph: &Graph, needed: &RunTrace) -> String {
    let mut lines = Vec::new();
    for node in
        graph.nodes().iter().filter(|node| needed.0.iter().any(|trace| trace.name == node.name))
    {
        let links = node
            .links
            .iter()
            .map(|link| {
                let target = &graph.nodes()[link.node];
                format!("{}: {}.{}", link.port, target.name, target.outputs[link.output])
            })
            .collect::<Vec<_>>()
            .join(", ");
        let mut parameters = node.recipe.parameters.clone();
        without_machine(&mut parameters);
        let files = node.files.iter().filter_map(|file| {
            let hash = maquette_value::Hash::compute(&maquette_value::fs::read(&file.path).ok()?);
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

/// Removes the paths of files from parameters, because they depend on the location of the graph. The line of the node lists its files
/// separately.
fn without_machine(parameters: &mut Json) {
    match parameters {
        Json::Object(entries) => {
            entries.retain(|key, _| key != FILE);
            entries.values_mut().for_each(without_machine);
        }
        Json::Array(items) => items.iter_mut().for_each(without_machine),
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::changed_lines;

    #[test]
    fn changed_nodes_are_described_in_words() {
        fn line(at: &str, step: &str, hash: &str) -> String {
            format!(
                "posts/{at}  Transform {{\"rotate\":[0.0,5.0],\"translate\":[{step},0.0]}} (mesh: m.mesh) a.obj {hash}\n"
            )
        }
        fn text(step: &str, hash: &str) -> String {
            line("10", step, "1") + &line("2", step, hash)
        }
        assert_eq!(
            changed_lines(&text("2.0", "1"), &text("2.5", "2")),
            [
                "node `posts/2`: parameter `translate[0]` 2 -> 2.5, file a.obj changed",
                "node `posts/10`: parameter `translate[0]` 2 -> 2.5",
            ]
        );
        let other = line("2", "2.0", "1").replace("m.mesh", "n.mesh");
        let expected = ["node `posts/2`: links (mesh: m.mesh) -> (mesh: n.mesh)"];
        assert_eq!(changed_lines(&line("2", "2.0", "1"), &other), expected);
    }
}
