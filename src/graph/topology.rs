//! The parts of a graph that the evaluator compares between two versions: the dependencies and the identity of nodes.

use std::sync::Arc;

use maquette_value::Hash;

use super::GraphNode;
use super::dependencies::Dependencies;

/// The names, hashes and dependencies of the nodes of a graph, without the nodes themselves.
#[derive(Debug)]
pub struct Topology {
    /// The names of the nodes, in the order of the graph.
    pub names: Arc<[String]>,
    /// For each node, a hash of its name, its recipe and its links.
    pub identities: Arc<[Hash]>,
    /// A hash of the names, recipes and links of all nodes. If two graphs have equal hashes, they are equal.
    pub identity: Hash,
    /// The indices of the nodes that read files.
    pub readers: Vec<usize>,
    needs: Dependencies,
}

impl Topology {
    pub(crate) fn new(nodes: &[GraphNode]) -> Self {
        let (mut content, mut identities) = (Vec::new(), Vec::with_capacity(nodes.len()));
        for node in nodes {
            let start = content.len();
            describe(node, &mut content);
            identities.push(Hash::compute(&content[start..]));
        }
        Self {
            names: nodes.iter().map(|node| node.name.clone()).collect(),
            identity: Hash::compute(&content),
            identities: identities.into(),
            readers: (0..nodes.len()).filter(|&index| !nodes[index].files.is_empty()).collect(),
            needs: needs(nodes),
        }
    }

    pub fn reads_files(&self, node: usize) -> bool {
        self.readers.binary_search(&node).is_ok()
    }

    /// Returns the nodes that depend on a node, in the order of the nodes. A user appears once per link.
    pub fn users(&self, node: usize) -> impl Iterator<Item = usize> {
        self.needs.users(node)
    }

    /// Returns the nodes on which a node depends, in the order of its links. A source appears once per link.
    pub fn sources(&self, node: usize) -> impl Iterator<Item = usize> {
        self.needs.sources(node)
    }

    /// For each node, returns true if it is one of `roots` or if a root depends on it.
    pub fn needed_by(&self, roots: &[usize]) -> Vec<bool> {
        self.needs.closure_of(roots.iter().copied())
    }
}

fn needs(nodes: &[GraphNode]) -> Dependencies {
    // Add the links in reverse order, because petgraph lists neighbors from the last edge to the first.
    let links = nodes.iter().enumerate().rev().flat_map(|(user, node)| {
        let links = node.links.iter().rev();
        links.map(move |link| (user, link.node))
    });
    Dependencies::new(nodes.len(), links)
}

/// Appends the name, the recipe and the links of a node to the bytes that are hashed.
fn describe(node: &GraphNode, content: &mut Vec<u8>) {
    // Each part has a fixed length or is preceded by its length, so that different graphs have different bytes.
    content.extend_from_slice(&node.recipe.identity.0);
    content.extend_from_slice(&(node.links.len() as u64).to_le_bytes());
    for link in &node.links {
        content.extend_from_slice(&(link.node as u64).to_le_bytes());
        content.extend_from_slice(&(link.output as u64).to_le_bytes());
    }
    content.extend_from_slice(&(node.name.len() as u64).to_le_bytes());
    content.extend_from_slice(node.name.as_bytes());
}
