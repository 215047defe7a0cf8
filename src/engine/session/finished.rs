//! What a run gave, and what became of its outputs.

use maquette_graph::catalog::Catalog;
use maquette_graph::{Expected, Graph, GraphOutput};
use maquette_node::pack::NewFile;
use maquette_node::provenance::{Provenance, Signature};
use maquette_syntax::error::{Error, Problem};
use maquette_syntax::with_article;
use maquette_value::{AnyValue, Value};

use super::{Teller, Written};
use crate::eval::{Evaluation, RunTrace};
use crate::expect;
use crate::expect::Violation;

/// What a run gave.
pub struct Finished {
    pub(super) graph: Graph,
    pub(super) evaluation: Evaluation,
    pub violations: Vec<Violation>,
}

impl Finished {
    /// The value of an output, a node (its first output) or an output of a node, `node.output`, if it was wanted and did not fail.
    pub fn value(&self, name: &str) -> Option<&AnyValue> {
        let (node, output) = self.graph.value_named(name)?;
        self.evaluation.value(node, output)
    }

    /// The same as a value of the type `T`.
    ///
    /// # Errors
    /// In words: there is no such value, or it is of another type.
    pub fn get<T: Value>(&self, name: &str) -> Result<&T, String> {
        let value = self.value(name).ok_or_else(|| format!("there is no value `{name}`"))?;
        let kind = with_article(value.kind().name);
        value.get().ok_or_else(|| format!("`{name}` is {kind}, not {}", with_article(T::NAME)))
    }

    /// The value at this node and output of the graph that was run.
    pub fn value_at(&self, (node, output): (usize, usize)) -> Option<&AnyValue> {
        self.evaluation.value(node, output)
    }

    /// The value of this output of this node, or of a use of a graph, whatever outputs of the graph are called the same; if it was
    /// wanted and did not fail.
    pub fn value_of(&self, node: &str, output: &str) -> Option<&AnyValue> {
        self.evaluation.find(&self.graph, node, output)
    }

    /// The values of all outputs of a node, if they are all there.
    pub(crate) fn values_of_node(&self, name: &str) -> Option<Vec<AnyValue>> {
        let node = self.graph.find(name)?;
        let outputs = 0..self.graph.nodes()[node].outputs.len();
        outputs.map(|output| self.evaluation.value(node, output).cloned()).collect()
    }

    /// The files that an output of the graph would be written to, all in one folder; none if its value is not there.
    ///
    /// # Errors
    /// If the value cannot be written in the output's format.
    pub fn files(&self, output: &str) -> Option<Result<Vec<NewFile>, Error>> {
        let output = self.graph.outputs().iter().find(|known| known.name == output)?;
        self.evaluation.files(output, None)
    }

    /// Where an output of the graph, which was wanted, comes from.
    pub fn provenance(&self, output: &GraphOutput, catalog: &Catalog) -> Provenance {
        let teller = Teller::new(&self.graph, catalog);
        teller.provenance(output, |node| self.evaluation.read_by(node))
    }

    /// The files of an output, signed; none if its value is not there.
    pub fn signed_files(
        &self,
        output: &GraphOutput,
        signature: Option<&Signature>,
    ) -> Option<Result<Vec<NewFile>, Error>> {
        self.evaluation.files(output, signature)
    }

    /// What happened to each node, each after those that it hangs on.
    pub fn trace(&self) -> RunTrace {
        self.evaluation.trace()
    }

    /// What failed, what nodes warn of, and what the graph expects that does not hold; also nodes of unknown types that something
    /// wanted hangs on.
    pub fn problems(&self) -> Vec<Problem> {
        let violations = self.violations.iter().map(|violation| violation.problem.clone());
        self.evaluation.unknown().chain(self.failures()).chain(violations).collect()
    }

    /// What failed, and what nodes warn of.
    pub fn failures(&self) -> Vec<Problem> {
        self.evaluation.problems()
    }

    /// What of these expectations does not hold.
    pub fn judged(&self, expected: &[&Expected]) -> Vec<Violation> {
        expect::violations(&self.graph, self.evaluation.by_place(), expected)
    }

    /// The graph that was run, with its inputs.
    pub fn graph(&self) -> &Graph {
        &self.graph
    }
}

/// What became of outputs that were to be written.
pub struct Produced {
    pub(super) evaluation: Evaluation,
    /// The files of the outputs that are right now, those that were before included.
    pub written: Vec<Written>,
    /// Whether every file could be written whose value is there.
    pub complete: bool,
    /// Whether something failed for want of memory or disk space, or because a file could not be read or written: the same run may
    /// succeed another time.
    pub may_pass: bool,
    /// What failed, what nodes warn of, what does not hold, and what could not be written.
    pub problems: Vec<Problem>,
}

impl Produced {
    /// What happened to each node, each after those that it hangs on.
    pub fn trace(&self) -> RunTrace {
        self.evaluation.trace()
    }

    /// How long reading the files of nodes took, in seconds, on all threads together.
    pub fn seconds_of_files(&self) -> f64 {
        self.evaluation.seconds_of_files()
    }
}
