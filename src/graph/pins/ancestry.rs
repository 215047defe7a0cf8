//! The ancestry of a pinned result: the node and all its dependencies, with their types, parameters, links and files.

use std::collections::HashMap;
use std::sync::LazyLock;

use maquette_node::importers::Readers;
use maquette_value::Hash;
use serde::{Deserialize, Serialize};
use serde_json::Value as Json;

use crate::difference::{parameter_difference, parameter_name, short_text};
use crate::files::{KnownFiles, Reads};
use crate::{GraphNode, Link};

/// The nodes from which a result was computed.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Ancestry {
    /// The hash of the data of all nodes. The names of the nodes do not affect it.
    made: String,
    /// The node and its dependencies, the nearest first.
    steps: Vec<Step>,
}

/// The state of a node when its result was pinned.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Step {
    name: String,
    #[serde(rename = "type")]
    kind: String,
    /// The parameters of the node, without the paths of files.
    parameters: Json,
    /// For each port, its link as `node.output`.
    links: Vec<(String, String)>,
    /// For each file, its path as the graph contains it, and the hash of its content and companions.
    files: Vec<(String, Option<String>)>,
}

impl Ancestry {
    /// Collects the dependencies of the node at `index`. In `nodes`, each node must come after those on which it depends.
    pub fn trace(nodes: &[GraphNode], index: usize, readers: &Readers) -> Self {
        static KNOWN: LazyLock<KnownFiles> = LazyLock::new(KnownFiles::default);
        let reads = Reads::new(&KNOWN, readers);
        let mut needed = vec![false; nodes.len()];
        needed[index] = true;
        let mut steps = Vec::new();
        for at in (0..=index).rev() {
            if !needed[at] {
                continue;
            }
            nodes[at].links.iter().for_each(|link| needed[link.node] = true);
            steps.push((at, Step::new(nodes, at, &reads)));
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
            made.insert(*at, Hash::compute(&content));
        }
        let steps = steps.into_iter().map(|(_, step)| step).collect();
        Self { made: made[&index].to_string(), steps }
    }

    /// Describes the change of the node or its dependencies that is nearest to the node. `None` if nothing has changed.
    pub fn change(&self, nodes: &[GraphNode], index: usize, readers: &Readers) -> Option<String> {
        let now = Self::trace(nodes, index, readers);
        if self.made == now.made {
            return None;
        }
        let (before, names) = (self.by_name(), self.names_before(&now));
        let changed = now.steps.iter().enumerate().find_map(|(place, step)| {
            // For an added node, the change is reported at the link to that node.
            let owner = if place == 0 { String::new() } else { format!("{}.", step.name) };
            before.get(names.get(&step.name[..])?)?.change(step, &owner, &names)
        });
        Some(changed.unwrap_or_else(|| "a node that it depends on changed".into()))
    }

    fn by_name(&self) -> HashMap<&str, &Step> {
        self.steps.iter().map(|step| (&step.name[..], step)).collect()
    }

    /// Returns the previous name of each current node. A node counts as renamed if a removed node had its type and was linked in the same
    /// way.
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
    fn new(nodes: &[GraphNode], index: usize, reads: &Reads<'_>) -> Self {
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
            let (name, before, now) =
                (parameter_name(&path), short_text(&before), short_text(&now));
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
