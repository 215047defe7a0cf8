//! What a graph computes, whatever its nodes are called: by this an edit that only moves nodes is judged.

use maquette_graph::expectation::Expectation;
use maquette_graph::{Checked, Graph, GraphNode};
use maquette_syntax::error::{Problem, Severity};
use maquette_syntax::paths::without_dots;
use maquette_value::Hash;

use crate::Judge;

/// What a graph computes: equal for two graphs whose nodes have equal keys, whatever they are called and in which order they come.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Computed {
    nodes: Vec<Hash>,
    outputs: Vec<(String, Hash)>,
    expected: Vec<String>,
    /// What is promised and does not follow.
    pub(crate) promised: Vec<String>,
}

/// What a graph computes for final results, and for drafts.
pub(crate) type Sides = [Computed; 2];

impl Judge<'_> {
    /// What the text of a graph says.
    ///
    /// # Errors
    /// Everything that is wrong with it.
    pub(crate) fn computed(&self, text: &str) -> Result<Sides, Vec<Problem>> {
        self.sides(text, &self.checked(text, false))
    }

    /// The same of a text that has been checked for final results.
    pub(super) fn sides(&self, text: &str, checked: &Checked) -> Result<Sides, Vec<Problem>> {
        let by = Computed::of(checked)?;
        fn has_draft(text: &str) -> bool {
            text.contains("Draft")
        }
        let draft = match has_draft(text)
            || checked
                .subgraphs
                .iter()
                .any(|path| self.options.text(path).is_ok_and(|text| has_draft(&text)))
        {
            true => Computed::of(&self.checked(text, true))?,
            false => by.clone(),
        };
        Ok([by, draft])
    }
}

impl Computed {
    fn of(checked: &Checked) -> Result<Self, Vec<Problem>> {
        let errors: Vec<_> = checked
            .problems
            .iter()
            .filter(|problem| problem.severity == Severity::Error)
            .cloned()
            .collect();
        let graph = checked.graph.as_ref().filter(|_| errors.is_empty());
        graph.map(Self::by).ok_or(errors)
    }

    fn by(graph: &Graph) -> Self {
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

/// What a node is, and what all that it hangs on is.
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
    Hash::of(&content)
}

fn hash_of_value(node: Hash, output: usize) -> Hash {
    Hash::of(&[&node.0[..], &(output as u64).to_le_bytes()].concat())
}
