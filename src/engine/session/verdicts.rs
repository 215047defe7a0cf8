//! Stores which values meet which expectations (verdicts). A value with a stored verdict is not computed or read again to check it.
//! Violations are not stored: their details are needed, so they are found again each time.

use std::collections::HashSet;

use maquette_graph::{Graph, GraphExpectation};
use maquette_node::CancelToken;
use maquette_value::{AnyValue, Hash};

use super::Session;
use crate::eval::Evaluation;
use crate::expect;
use crate::expect::Violation;

/// The maximum number of verdicts about earlier values that are stored for a graph, in addition to one verdict for each expectation.
const MAX_SPARE_VERDICTS: usize = 1000;

#[derive(Default)]
pub(super) struct Verdicts {
    /// For each stored verdict, a hash of the expectation and of the values that meet it. The latest verdict comes first.
    valid: Vec<Hash>,
    /// The maximum number of verdicts that are stored for the graph.
    max_verdicts: usize,
}

impl Verdicts {
    /// Returns those expectations that must be checked, because no verdict about the values with the given hashes is stored.
    pub(super) fn open<'e>(
        &self,
        expected: &[&'e GraphExpectation],
        hash: impl Fn(usize, usize) -> Option<Hash>,
    ) -> Vec<&'e GraphExpectation> {
        let known: HashSet<&Hash> = self.valid.iter().collect();
        expected
            .iter()
            .filter(|it| verdict(it, &hash).is_none_or(|it| !known.contains(&it)))
            .copied()
            .collect()
    }

    /// Checks the expectations `open` one after the other until the run is cancelled. Stores verdicts for those that hold, and returns the
    /// violations of the others. Verdicts about other expectations are kept.
    pub(super) fn judge(
        &mut self,
        graph: &Graph,
        evaluation: &Evaluation,
        open: &[&GraphExpectation],
        cancel: &CancelToken,
    ) -> Vec<Violation> {
        let value = evaluation.values_by_output();
        let (mut found, mut held) = (Vec::new(), Vec::new());
        for expected in open.iter().take_while(|_| !cancel.is_cancelled()) {
            let violations = expect::violations(graph, &value, &[*expected]);
            let mut values = expected.values.iter().flatten();
            let is_judged = values.all(|&(node, output)| value(node, output).is_some());
            if violations.is_empty() && is_judged {
                held.extend(verdict(expected, |node, output| {
                    value(node, output).map(AnyValue::hash)
                }));
            }
            found.extend(violations);
        }
        held.append(&mut self.valid);
        held.truncate(self.max_verdicts);
        self.valid = held;
        found
    }
}

/// Returns a hash of an expectation and of the values that it is about, or `None` if some of these values are unknown.
fn verdict(
    expected: &GraphExpectation,
    hash: impl Fn(usize, usize) -> Option<Hash>,
) -> Option<Hash> {
    let mut words = format!("{:?}", expected.expectation);
    for value in &expected.values {
        let (node, output) = (*value)?;
        words += &format!(" {}", hash(node, output)?);
    }
    Some(Hash::compute(words.as_bytes()))
}

impl Session {
    /// Returns the stored verdicts of a graph, and the expectations that they do not cover. Nothing is evaluated.
    pub(super) fn open_expectations<'e>(
        &mut self,
        graph: &Graph,
        expected: &[&'e GraphExpectation],
    ) -> (Verdicts, Vec<&'e GraphExpectation>) {
        if expected.is_empty() {
            return Default::default();
        }
        let note = self.note(&graph.source().name.with_extension("verdicts"));
        let held = note.and_then(|note| serde_json::from_slice(&note).ok()).unwrap_or_default();
        let verdicts = Verdicts { valid: held, max_verdicts: MAX_SPARE_VERDICTS + expected.len() };
        let known = self.evaluator.predict(graph, &expect::nodes_of(expected));
        let open = verdicts.open(expected, |node, output| known.hash(node, output));
        (verdicts, open)
    }

    /// Stores the verdicts for later runs, in this process or another one.
    pub(super) fn keep_verdicts(&self, graph: &Graph, verdicts: &Verdicts) {
        self.keep_note(&graph.source().name.with_extension("verdicts"), || {
            serde_json::to_vec(&verdicts.valid).unwrap_or_default()
        });
    }
}
