//! A graph as the evaluator compares it with another one: who hangs on whom, and a mark for each node.

use super::GraphNode;
use crate::value::Hash;

/// What an evaluation wants to know of a graph without touching its nodes.
#[derive(Debug, Default)]
pub(crate) struct Shape {
    /// The nodes' names.
    pub(crate) names: Vec<String>,
    /// The hash of each node's name, recipe and links: equal at one place in two graphs, the same node.
    pub(crate) marks: Vec<Hash>,
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
            marks: nodes.iter().map(mark).collect(),
            readers: (0..nodes.len()).filter(|&index| !nodes[index].files.is_empty()).collect(),
            sources: sources(nodes),
            users: users(nodes),
        }
    }

    /// The nodes that are not what stands at their place in another graph.
    pub(crate) fn differences(&self, other: &Self) -> impl Iterator<Item = usize> {
        let same = std::ptr::eq(self, other);
        let marks = if same { &[][..] } else { &self.marks };
        marks
            .iter()
            .enumerate()
            .filter_map(|(index, mark)| (other.marks.get(index) != Some(mark)).then_some(index))
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

fn mark(node: &GraphNode) -> Hash {
    let mut content = node.recipe.identity.0.to_vec();
    for link in &node.links {
        content.extend_from_slice(&(link.node as u64).to_le_bytes());
        content.extend_from_slice(&(link.output as u64).to_le_bytes());
    }
    content.extend_from_slice(node.name.as_bytes());
    Hash::of(&content)
}
