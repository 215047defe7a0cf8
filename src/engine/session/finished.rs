//! The result of a run, and the report of writing its outputs.

use maquette_graph::catalog::Catalog;
use maquette_graph::{Graph, GraphExpectation, GraphOutput};
use maquette_node::pack::NewFile;
use maquette_node::provenance::{Provenance, Signature};
use maquette_syntax::error::{Diagnostic, Error};
use maquette_syntax::with_article;
use maquette_value::{AnyValue, Value};

use super::{OutputFile, ProvenanceBuilder};
use crate::eval::{Evaluation, RunTrace};
use crate::expect;
use crate::expect::Violation;

/// The values, trace and diagnostics of a run.
pub struct RunResult {
    pub(super) graph: Graph,
    pub(super) evaluation: Evaluation,
    pub violations: Vec<Violation>,
}

impl RunResult {
    /// Returns the value with this name, or `None` if it was not requested or failed. The name is that of an output of the graph, of a node
    /// (meaning its first output), or of an output of a node: `node.output`.
    pub fn value(&self, name: &str) -> Option<&AnyValue> {
        let (node, output) = self.graph.find_value(name)?;
        self.evaluation.value(node, output)
    }

    /// Returns the value with this name as a value of type `T`.
    ///
    /// # Errors
    /// A message if there is no such value or it has another type.
    pub fn get<T: Value>(&self, name: &str) -> Result<&T, String> {
        let value = self.value(name).ok_or_else(|| format!("there is no value `{name}`"))?;
        let kind = with_article(value.kind().name);
        value.get().ok_or_else(|| format!("`{name}` is {kind}, not {}", with_article(T::NAME)))
    }

    /// Returns the value of an output, given the indices of the node and of the output in the node. Returns `None` if the value was not
    /// requested or failed.
    pub fn value_at(&self, (node, output): (usize, usize)) -> Option<&AnyValue> {
        self.evaluation.value(node, output)
    }

    /// Returns the value of an output of a node, or `None` if it was not requested or failed. The node may be one that uses another graph.
    /// The names in the section `outputs` of the graph are not searched.
    pub fn value_of(&self, node: &str, output: &str) -> Option<&AnyValue> {
        self.evaluation.find(&self.graph, node, output)
    }

    /// Returns the values of all outputs of a node, or `None` if one of them is missing.
    pub(crate) fn values_of_node(&self, name: &str) -> Option<Vec<AnyValue>> {
        let node = self.graph.find(name)?;
        let outputs = 0..self.graph.nodes()[node].outputs.len();
        outputs.map(|output| self.evaluation.value(node, output).cloned()).collect()
    }

    /// Returns the files that writing an output of the graph would create, all in one folder. Returns `None` if the output was not
    /// requested or failed.
    ///
    /// # Errors
    /// If the value cannot be written in the output's format.
    pub fn files(&self, output: &str) -> Option<Result<Vec<NewFile>, Error>> {
        let output = self.graph.outputs().iter().find(|known| known.name == output)?;
        self.evaluation.files(output, None)
    }

    /// Returns the provenance of an output of the graph: everything from which it was made. The output must have been requested.
    pub fn provenance(&self, output: &GraphOutput, catalog: &Catalog) -> Provenance {
        let builder = ProvenanceBuilder::new(&self.graph, catalog);
        builder.provenance(output, |node| self.evaluation.files_read_by(node))
    }

    /// Returns the files of an output, with the signature of its provenance written into them. Returns `None` if the value is missing.
    pub fn signed_files(
        &self,
        output: &GraphOutput,
        signature: Option<&Signature>,
    ) -> Option<Result<Vec<NewFile>, Error>> {
        self.evaluation.files(output, signature)
    }

    /// Returns the trace of the nodes. Each node comes after its dependencies.
    pub fn trace(&self) -> RunTrace {
        self.evaluation.trace()
    }

    /// Returns all errors and warnings: those of nodes, violated expectations, and nodes of unknown types on which requested nodes depend.
    pub fn diagnostics(&self) -> Vec<Diagnostic> {
        let violations = self.violations.iter().map(|violation| violation.diagnostic.clone());
        self.evaluation.unknown_types().chain(self.failures()).chain(violations).collect()
    }

    /// Returns the errors and warnings of nodes.
    pub fn failures(&self) -> Vec<Diagnostic> {
        self.evaluation.diagnostics()
    }

    /// Returns the violations of the given expectations.
    pub fn check_expectations(&self, expected: &[&GraphExpectation]) -> Vec<Violation> {
        expect::violations(&self.graph, self.evaluation.values_by_output(), expected)
    }

    /// Returns the graph that was run, with the values of its inputs.
    pub fn graph(&self) -> &Graph {
        &self.graph
    }
}

/// The files and diagnostics of a run that wrote outputs.
pub struct OutputReport {
    pub(super) evaluation: Evaluation,
    /// The files that are up to date now. Includes files that did not need to be written.
    pub written: Vec<OutputFile>,
    /// True if every output whose value exists is up to date on disk.
    pub complete: bool,
    /// True if something failed because memory or disk space was short, or because a file could not be read or written. The same run may
    /// then succeed later.
    pub may_succeed_later: bool,
    /// The errors and warnings of nodes, expectations and files.
    pub diagnostics: Vec<Diagnostic>,
}

impl OutputReport {
    /// Returns the trace of the nodes. Each node comes after its dependencies.
    pub fn trace(&self) -> RunTrace {
        self.evaluation.trace()
    }

    /// Returns the time spent reading the input files of nodes, in seconds, summed over all threads.
    pub fn seconds_of_files(&self) -> f64 {
        self.evaluation.seconds_of_files()
    }
}
