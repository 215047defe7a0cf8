//! A graph as the evaluator compares it with another one: who hangs on whom, and its identity.

use std::sync::Arc;

use super::GraphNode;
use crate::value::Hash;

/// What an evaluation wants to know of a graph without touching its nodes.
#[derive(Debug)]
pub(crate) struct Shape {
    /// The nodes' names.
    pub(crate) names: Arc<[String]>,
    /// The hash of all nodes' names, recipes and links: equal for two graphs, the same graph.
    pub(crate) identity: Hash,
    /// The nodes that read files.
    pub(crate) readers: Vec<usize>,
    /// The nodes that each one is linked to, once per link.
    sources: Lists,
    /// The nodes that are linked to each one, once per link.
    users: Lists,
}

/// A list for each node: that of node `n` is `items[starts[n]..starts[n + 1]]`.
#[derive(Debug, Default)]
struct Lists {
    items: Vec<u32>,
    starts: Vec<u32>,
}

impl Lists {
    fn of(&self, node: usize) -> &[u32] {
        &self.items[self.starts[node] as usize..self.starts[node + 1] as usize]
    }
}

impl Shape {
    pub(crate) fn new(nodes: &[GraphNode]) -> Self {
        Self {
            names: nodes.iter().map(|node| node.name.clone()).collect(),
            identity: identity(nodes),
            readers: (0..nodes.len()).filter(|&index| !nodes[index].files.is_empty()).collect(),
            sources: sources(nodes),
            users: users(nodes),
        }
    }

    /// The nodes that are linked to a node, once per link.
    pub(crate) fn users(&self, node: usize) -> &[u32] {
        self.users.of(node)
    }

    /// The nodes that a node is linked to, once per link.
    pub(crate) fn sources(&self, node: usize) -> &[u32] {
        self.sources.of(node)
    }
}

fn sources(nodes: &[GraphNode]) -> Lists {
    let mut lists = Lists { items: Vec::new(), starts: vec![0] };
    for node in nodes {
        lists.items.extend(node.links.iter().map(|link| link.node as u32));
        lists.starts.push(lists.items.len() as u32);
    }
    lists
}

fn users(nodes: &[GraphNode]) -> Lists {
    let mut starts = vec![0u32; nodes.len() + 1];
    for link in nodes.iter().flat_map(|node| &node.links) {
        starts[link.node + 1] += 1;
    }
    for index in 0..nodes.len() {
        starts[index + 1] += starts[index];
    }
    let mut next = starts.clone();
    let mut items = vec![0; starts.last().map_or(0, |&count| count as usize)];
    for (index, node) in nodes.iter().enumerate() {
        for link in &node.links {
            items[next[link.node] as usize] = index as u32;
            next[link.node] += 1;
        }
    }
    Lists { items, starts }
}

fn identity(nodes: &[GraphNode]) -> Hash {
    let mut content = Vec::new();
    for node in nodes {
        // Each part has a length that is fixed or told, so that no two graphs give the same bytes.
        content.extend_from_slice(&node.recipe.identity.0);
        content.extend_from_slice(&(node.links.len() as u64).to_le_bytes());
        for link in &node.links {
            content.extend_from_slice(&(link.node as u64).to_le_bytes());
            content.extend_from_slice(&(link.output as u64).to_le_bytes());
        }
        content.extend_from_slice(&(node.name.len() as u64).to_le_bytes());
        content.extend_from_slice(node.name.as_bytes());
    }
    Hash::of(&content)
}
