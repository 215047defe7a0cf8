//! Fingerprints of the computations of a graph. They do not depend on the names of nodes. Equal fingerprints show that an edit has moved
//! nodes without changing results.

use maquette_graph::expectation::Expectation;
use maquette_graph::{CheckedGraph, Graph, GraphNode};
use maquette_syntax::error::{Diagnostic, Severity};
use maquette_syntax::paths::without_dots;
use maquette_value::Hash;

use crate::Editor;

/// A fingerprint of the computations of a graph. Two graphs have equal fingerprints if their nodes have equal cache keys. The names and the
/// order of the nodes are irrelevant.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Fingerprint {
    nodes: Vec<Hash>,
    outputs: Vec<(String, Hash)>,
    expected: Vec<String>,
    /// The promises of the graph that do not follow from the promises of its nodes.
    pub(crate) promised: Vec<String>,
}

/// The fingerprint for final results, and the fingerprint for drafts.
pub(crate) type Fingerprints = [Fingerprint; 2];

impl Editor<'_> {
    /// Computes the fingerprints of the text of a graph.
    ///
    /// # Errors
    /// All errors of the graph.
    pub(crate) fn fingerprints(&self, text: &str) -> Result<Fingerprints, Vec<Diagnostic>> {
        self.fingerprints_of_checked(text, &self.check(text, false))
    }

    /// Computes the fingerprints of a text. `checked` is the result of checking the text for final results.
    pub(super) fn fingerprints_of_checked(
        &self,
        text: &str,
        checked: &CheckedGraph,
    ) -> Result<Fingerprints, Vec<Diagnostic>> {
        let finals = Fingerprint::from_checked(checked)?;
        fn has_draft(text: &str) -> bool {
            text.contains("Draft")
        }
        let draft = match has_draft(text)
            || checked
                .subgraphs
                .iter()
                .any(|path| self.options.text(path).is_ok_and(|text| has_draft(&text)))
        {
            true => Fingerprint::from_checked(&self.check(text, true))?,
            false => finals.clone(),
        };
        Ok([finals, draft])
    }
}

impl Fingerprint {
    fn from_checked(checked: &CheckedGraph) -> Result<Self, Vec<Diagnostic>> {
        let errors: Vec<_> = checked
            .diagnostics
            .iter()
            .filter(|diagnostic| diagnostic.severity == Severity::Error)
            .cloned()
            .collect();
        let graph = checked.graph.as_ref().filter(|_| errors.is_empty());
        graph.map(Self::from_graph).ok_or(errors)
    }

    fn from_graph(graph: &Graph) -> Self {
        let mut hashes: Vec<Hash> = Vec::with_capacity(graph.nodes().len());
        for node in graph.nodes().iter() {
            hashes.push(hash_of(node, &hashes));
        }
        fn value(node: usize, output: usize, hashes: &[Hash]) -> Hash {
            hash_of_value(hashes[node], output)
        }
        let files =
            graph.outputs().iter().map(|it| (it.name.clone(), value(it.node, it.output, &hashes)));
        let ports =
            graph.ports().iter().map(|it| (it.name.clone(), value(it.node, it.output, &hashes)));
        let outputs = files.chain(ports).collect();
        let (mut expected, mut promised) = (Vec::new(), Vec::new());
        for it in graph.expectations().iter() {
            let mut expectation = it.expectation.clone();
            expectation.values_mut().into_iter().for_each(String::clear);
            let values =
                it.values.iter().map(|target| target.map(|(node, at)| value(node, at, &hashes)));
            let words = format!("{expectation:?} {:?}", Vec::from_iter(values));
            match expectation {
                Expectation::Promised { .. } => promised.push(words),
                _ => expected.push(words),
            }
        }
        hashes.sort_unstable_by_key(|hash| hash.0);
        expected.sort_unstable();
        promised.sort_unstable();
        Self { nodes: hashes, outputs, expected, promised }
    }
}

/// Returns a hash of a node and all its dependencies. `before` contains the hashes of all earlier nodes.
fn hash_of(node: &GraphNode, before: &[Hash]) -> Hash {
    let mut content = node.recipe.identity.0.to_vec();
    for link in &node.links {
        content.extend_from_slice(link.port.as_bytes());
        content.extend_from_slice(&hash_of_value(before[link.node], link.output).0);
    }
    for file in &node.files {
        content.extend_from_slice(without_dots(&file.path).as_os_str().as_encoded_bytes());
        content.push(u8::from(file.needed));
    }
    for guard in &node.guards {
        content.extend_from_slice(&(guard.slot as u64).to_le_bytes());
        content.extend_from_slice(guard.property.as_bytes());
    }
    Hash::compute(&content)
}

fn hash_of_value(node: Hash, output: usize) -> Hash {
    Hash::compute(&[&node.0[..], &(output as u64).to_le_bytes()].concat())
}
