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
    /// The users of node `n`, once per link: `users[starts[n]..starts[n + 1]]`.
    users: Vec<u32>,
    starts: Vec<u32>,
}

impl Shape {
    pub(crate) fn new(nodes: &[GraphNode]) -> Self {
        let mut starts = vec![0u32; nodes.len() + 1];
        for link in nodes.iter().flat_map(|node| &node.links) {
            starts[link.node + 1] += 1;
        }
        for index in 0..nodes.len() {
            starts[index + 1] += starts[index];
        }
        let mut next = starts.clone();
        let mut users = vec![0; starts.last().map_or(0, |&count| count as usize)];
        for (index, node) in nodes.iter().enumerate() {
            for link in &node.links {
                users[next[link.node] as usize] = index as u32;
                next[link.node] += 1;
            }
        }
        Self {
            names: nodes.iter().map(|node| node.name.clone()).collect(),
            marks: nodes.iter().map(mark).collect(),
            readers: (0..nodes.len()).filter(|&index| !nodes[index].files.is_empty()).collect(),
            users,
            starts,
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
        &self.users[self.starts[node] as usize..self.starts[node + 1] as usize]
    }
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
