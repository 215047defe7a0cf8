//! A graph as the evaluator compares it with another one: who hangs on whom, and its identity.

use std::sync::Arc;

use maquette_value::Hash;

use super::GraphNode;
use super::needs::Needs;

/// What an evaluation wants to know of a graph without touching its nodes.
#[derive(Debug)]
pub struct Shape {
    /// The nodes' names.
    pub names: Arc<[String]>,
    /// Of each node the hash of its name, recipe and links.
    pub identities: Arc<[Hash]>,
    /// The hash of all nodes' names, recipes and links: equal for two graphs, the same graph.
    pub identity: Hash,
    /// The nodes that read files.
    pub readers: Vec<usize>,
    needs: Needs,
}

impl Shape {
    pub(crate) fn new(nodes: &[GraphNode]) -> Self {
        let (mut content, mut identities) = (Vec::new(), Vec::with_capacity(nodes.len()));
        for node in nodes {
            let start = content.len();
            describe(node, &mut content);
            identities.push(Hash::of(&content[start..]));
        }
        Self {
            names: nodes.iter().map(|node| node.name.clone()).collect(),
            identity: Hash::of(&content),
            identities: identities.into(),
            readers: (0..nodes.len()).filter(|&index| !nodes[index].files.is_empty()).collect(),
            needs: needs(nodes),
        }
    }

    pub fn reads_files(&self, node: usize) -> bool {
        self.readers.binary_search(&node).is_ok()
    }

    /// The nodes that are linked to a node, once per link, in their order.
    pub fn users(&self, node: usize) -> impl Iterator<Item = usize> {
        self.needs.users(node)
    }

    /// The nodes that a node is linked to, once per link.
    pub fn sources(&self, node: usize) -> impl Iterator<Item = usize> {
        self.needs.sources(node)
    }

    /// These nodes and all that they hang on: whether each node is one of them.
    pub fn needed_by(&self, roots: &[usize]) -> Vec<bool> {
        self.needs.of(roots.iter().copied())
    }
}

fn needs(nodes: &[GraphNode]) -> Needs {
    // From the last to the first, so that neighbors are told from the first to the last.
    let links = nodes.iter().enumerate().rev().flat_map(|(user, node)| {
        let links = node.links.iter().rev();
        links.map(move |link| (user, link.node))
    });
    Needs::new(nodes.len(), links)
}

/// Adds what a node is: its name, its recipe and its links.
fn describe(node: &GraphNode, content: &mut Vec<u8>) {
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
