//! What is known to be as it is expected: a value is not made or read again only to be judged again. That something is not as it is
//! expected is found out anew each time, with what there is to tell of it.

use std::collections::HashSet;

use maquette_graph::{Expected, Graph};
use maquette_node::CancelToken;
use maquette_value::{AnyValue, Hash};

use super::Session;
use crate::eval::Evaluation;
use crate::expect;
use crate::expect::Violation;

/// So many verdicts are kept of a graph, beside as many as it has expectations.
const MOST: usize = 1000;

#[derive(Default)]
pub(super) struct Verdicts {
    /// Hashes of expectations with the values for which they hold, the last ones first.
    held: Vec<Hash>,
    /// How many are kept.
    most: usize,
}

impl Verdicts {
    /// The expectations that are not known to hold for the values of these hashes.
    pub(super) fn open<'e>(
        &self,
        expected: &[&'e Expected],
        hash: impl Fn(usize, usize) -> Option<Hash>,
    ) -> Vec<&'e Expected> {
        let known: HashSet<&Hash> = self.held.iter().collect();
        expected
            .iter()
            .filter(|it| verdict(it, &hash).is_none_or(|it| !known.contains(&it)))
            .copied()
            .collect()
    }

    /// Judges these expectations one by one until it is told to stop, and knows from now on which of them hold. What was known of the
    /// others stays.
    pub(super) fn judge(
        &mut self,
        graph: &Graph,
        evaluation: &Evaluation,
        open: &[&Expected],
        cancel: &CancelToken,
    ) -> Vec<Violation> {
        let value = evaluation.by_place();
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
        held.append(&mut self.held);
        held.truncate(self.most);
        self.held = held;
        found
    }
}

/// The hash of an expectation with the values that it speaks of, if they are known.
fn verdict(expected: &Expected, hash: impl Fn(usize, usize) -> Option<Hash>) -> Option<Hash> {
    let mut words = format!("{:?}", expected.expectation);
    for value in &expected.values {
        let (node, output) = (*value)?;
        words += &format!(" {}", hash(node, output)?);
    }
    Some(Hash::of(words.as_bytes()))
}

impl Session {
    /// What is known of a graph, and what of these expectations is not known to hold before anything is evaluated.
    pub(super) fn unjudged<'e>(
        &mut self,
        graph: &Graph,
        expected: &[&'e Expected],
    ) -> (Verdicts, Vec<&'e Expected>) {
        if expected.is_empty() {
            return Default::default();
        }
        let note = self.note(&graph.source().name.with_extension("verdicts"));
        let held = note.and_then(|note| serde_json::from_slice(&note).ok()).unwrap_or_default();
        let verdicts = Verdicts { held, most: MOST + expected.len() };
        let known = self.evaluator.foreseen(graph, &expect::nodes_of(expected));
        let open = verdicts.open(expected, |node, output| known.hash(node, output));
        (verdicts, open)
    }

    /// Tells the next run, in this process or another one.
    pub(super) fn keep_verdicts(&self, graph: &Graph, verdicts: &Verdicts) {
        self.keep_note(&graph.source().name.with_extension("verdicts"), || {
            serde_json::to_vec(&verdicts.held).unwrap_or_default()
        });
    }
}
