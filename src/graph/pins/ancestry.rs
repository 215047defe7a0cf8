//! What a pinned result was computed from: the node and all that it hangs on, each with its type, parameters, links and files.

use std::collections::HashMap;
use std::sync::LazyLock;

use maquette_node::reading::Readers;
use maquette_value::Hash;
use serde::{Deserialize, Serialize};
use serde_json::Value as Json;

use crate::difference::{in_short, parameter_difference, parameter_name};
use crate::files::{Known, Reads};
use crate::{GraphNode, Link};

/// What a result was computed from.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Ancestry {
    /// The hash of all of it. No name of a node counts.
    made: String,
    /// The node, and what it hangs on: the nearest first.
    steps: Vec<Step>,
}

/// A node as it was.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Step {
    name: String,
    #[serde(rename = "type")]
    kind: String,
    /// Without the paths of files.
    parameters: Json,
    /// What each port is linked to, `node.output`.
    links: Vec<(String, String)>,
    /// The name of each file as the graph has it, and the hash of its content and of the files that it names.
    files: Vec<(String, Option<String>)>,
}

impl Ancestry {
    /// Of nodes that stand after what they hang on.
    pub fn of(nodes: &[GraphNode], index: usize, readers: &Readers) -> Self {
        static KNOWN: LazyLock<Known> = LazyLock::new(Known::default);
        let reads = Reads::new(&KNOWN, readers);
        let mut needed = vec![false; nodes.len()];
        needed[index] = true;
        let mut steps = Vec::new();
        for at in (0..=index).rev() {
            if !needed[at] {
                continue;
            }
            nodes[at].links.iter().for_each(|link| needed[link.node] = true);
            steps.push((at, Step::of(nodes, at, &reads)));
        }
        let mut made: HashMap<usize, Hash> = HashMap::new();
        for (at, step) in steps.iter().rev() {
            let GraphNode { recipe, links, .. } = &nodes[*at];
            let mut content = recipe.identity.0.to_vec();
            for Link { node, output, .. } in links {
                content.extend_from_slice(&made[node].0);
                content.extend_from_slice(&(*output as u64).to_le_bytes());
            }
            for (_, hash) in &step.files {
                content.extend_from_slice(hash.as_ref().map_or("none", |hash| hash).as_bytes());
            }
            made.insert(*at, Hash::of(&content));
        }
        let steps = steps.into_iter().map(|(_, step)| step).collect();
        Self { made: made[&index].to_string(), steps }
    }

    /// In words, what of the node or of what it hangs on is not as it was: what is nearest to it.
    pub fn change(&self, nodes: &[GraphNode], index: usize, readers: &Readers) -> Option<String> {
        let now = Self::of(nodes, index, readers);
        if self.made == now.made {
            return None;
        }
        let (before, names) = (self.by_name(), self.names_before(&now));
        let changed = now.steps.iter().enumerate().find_map(|(place, step)| {
            // A node that is new here is told of by the link to it.
            let owner = if place == 0 { String::new() } else { format!("{}.", step.name) };
            before.get(names.get(&step.name[..])?)?.change(step, &owner, &names)
        });
        Some(changed.unwrap_or_else(|| "something that it hangs on changed".into()))
    }

    fn by_name(&self) -> HashMap<&str, &Step> {
        self.steps.iter().map(|step| (&step.name[..], step)).collect()
    }

    /// What the nodes of now were called: a new name is that of the node of the same type that is gone from the same link.
    fn names_before<'a>(&'a self, now: &'a Self) -> HashMap<&'a str, &'a str> {
        let (before, later) = (self.by_name(), now.by_name());
        let mut names: HashMap<&str, &str> = before.keys().map(|&name| (name, name)).collect();
        for step in &now.steps {
            let Some(old) = names.get(&step.name[..]).map(|name| before[name]) else { continue };
            for ((port, to), (old_port, from)) in step.links.iter().zip(&old.links) {
                let (Some((to, output)), Some((from, old_output))) =
                    (to.rsplit_once('.'), from.rsplit_once('.'))
                else {
                    continue;
                };
                if (port, output) == (old_port, old_output)
                    && !later.contains_key(from)
                    && before
                        .get(from)
                        .is_some_and(|old| later.get(to).is_some_and(|now| now.kind == old.kind))
                {
                    names.entry(to).or_insert(from);
                }
            }
        }
        names
    }
}

impl Step {
    fn of(nodes: &[GraphNode], index: usize, reads: &Reads<'_>) -> Self {
        let node = &nodes[index];
        Self {
            name: node.name.clone(),
            kind: node.kind().to_owned(),
            parameters: node.recipe.without_paths(),
            links: node
                .links
                .iter()
                .map(|link| {
                    let source = &nodes[link.node];
                    (link.port.clone(), format!("{}.{}", source.name, source.outputs[link.output]))
                })
                .collect(),
            files: node
                .files
                .iter()
                .map(|file| {
                    let hash = reads.hash(file).ok().flatten();
                    (file.given.clone(), hash.map(|hash| hash.to_string()))
                })
                .collect(),
        }
    }

    fn change(&self, now: &Self, owner: &str, names: &HashMap<&str, &str>) -> Option<String> {
        if self.kind != now.kind {
            return Some(format!("`{}` became a {} (it was a {})", now.name, now.kind, self.kind));
        }
        if let Some((path, before, now)) = parameter_difference(&self.parameters, &now.parameters) {
            let (name, before, now) = (parameter_name(&path), in_short(&before), in_short(&now));
            return Some(format!("`{owner}{name}` changed ({before} -> {now})"));
        }
        let links: Vec<_> = now
            .links
            .iter()
            .map(|(port, to)| {
                let (to, output) = to.rsplit_once('.').unwrap_or((to, ""));
                (port.clone(), format!("{}.{output}", names.get(to).unwrap_or(&to)))
            })
            .collect();
        if self.links != links {
            fn port(a: &[(String, String)], b: &[(String, String)]) -> Option<String> {
                a.iter().find(|link| !b.contains(link)).map(|(port, _)| port.clone())
            }
            let port = port(&links, &self.links).or_else(|| port(&self.links, &links));
            let port = port.unwrap_or_default();
            return Some(format!("what is linked to `{}.{port}` changed", now.name));
        }
        let changed = now.files.iter().zip(&self.files).find(|(now, before)| now.1 != before.1);
        changed.map(|((name, _), _)| format!("file {name} changed"))
    }
}
