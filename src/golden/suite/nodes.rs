//! The nodes of a graph as they were when its golden was accepted, and how they differ now: why a result changed.

use maquette_engine::eval::RunTrace;
use maquette_graph::{Graph, in_short, parameter_difference, parameter_name};
use maquette_syntax::{FILE, with_article};
use serde_json::Value as Json;

/// Begins the line of a warning, among those of the nodes.
const WARNING: &str = "warning  ";

/// Which warnings of nodes came or went, in words. That of a node which only got another name did neither.
pub(super) fn changed_warnings(before: &str, now: &str) -> Vec<String> {
    fn of(text: &str) -> Vec<&str> {
        text.lines().filter_map(|line| line.strip_prefix(WARNING)).collect()
    }
    let (old, new) = (of(before), of(now));
    let mut gone: Vec<_> = old.iter().filter(|line| !new.contains(line)).collect();
    let mut came: Vec<_> = new.iter().filter(|line| !old.contains(line)).collect();
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

/// What of the nodes' lines differs: "node `raised`: parameter `distance` 12 -> 15".
pub(super) fn changed_lines(before: &str, now: &str) -> Vec<String> {
    let (mut old, new) =
        (nodes(before).map(split).collect::<Vec<_>>(), nodes(now).map(split).collect::<Vec<_>>());
    // The tenth element stands behind the ninth.
    old.sort_by_cached_key(|(name, _)| {
        name.split('/').map(|part| (part.parse::<usize>().ok(), part)).collect::<Vec<_>>()
    });
    let mut changes = Vec::new();
    for (name, was) in &old {
        match new.iter().find(|(other, _)| other == name) {
            None => changes.push(format!("node `{name}` is gone")),
            Some((_, is)) if is != was => {
                let told = Line::read(was).zip(Line::read(is)).and_then(|(was, is)| was.told(is));
                let told = told.unwrap_or_else(|| "it is another one".to_owned());
                changes.push(format!("node `{name}`: {told}"));
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

/// What a line says of a node behind its name.
struct Line<'a> {
    kind: &'a str,
    parameters: Json,
    links: &'a str,
    /// The names of files, each with a hash behind it.
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

    /// How a later one differs, as `why` says it; none if that cannot be seen.
    fn told(mut self, now: Self) -> Option<String> {
        const MOST: usize = 3;
        let mut told = Vec::new();
        if self.kind != now.kind {
            return Some(format!(
                "it is {}, and was {} before",
                with_article(now.kind),
                with_article(self.kind)
            ));
        }
        while let Some((path, was, is)) = parameter_difference(&self.parameters, &now.parameters) {
            if told.len() == MOST {
                told.push("and more".to_owned());
                break;
            }
            let change = format!("{} -> {}", in_short(&was), in_short(&is));
            if path.is_empty() {
                return Some(format!("its parameters {change}"));
            }
            told.push(format!("parameter `{}` {change}", parameter_name(&path)));
            let steps = path.iter().map(|step| step.replace('~', "~0").replace('/', "~1"));
            let steps = String::from_iter(steps.map(|step| format!("/{step}")));
            *self.parameters.pointer_mut(&steps)? = is;
        }
        if self.links != now.links {
            told.push(format!("links ({}) -> ({})", short(self.links), short(now.links)));
        }
        let same_names = self.files.iter().step_by(2).eq(now.files.iter().step_by(2));
        match same_names {
            true => {
                let pairs = self.files.chunks(2).zip(now.files.chunks(2));
                let changed = pairs.filter(|(was, is)| was != is);
                told.extend(changed.map(|(was, _)| format!("file {} changed", was[0])));
            }
            false => told.push("it reads other files".to_owned()),
        }
        (!told.is_empty()).then(|| told.join(", "))
    }
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
            let hash = maquette_value::Hash::of(&maquette_value::plain::read(&file.path).ok()?);
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
    fn what_changed_is_told_in_words() {
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
        let told = ["node `posts/2`: links (mesh: m.mesh) -> (mesh: n.mesh)"];
        assert_eq!(changed_lines(&line("2", "2.0", "1"), &other), told);
    }
}
