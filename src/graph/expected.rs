//! Expectations of a flat graph: those in the file of the root graph, and those in the files of the graphs that it uses.

use std::ops::Range;
use std::sync::Arc;

use maquette_syntax::error::{Diagnostic, Position, Severity, Source, Span, Use, code};
use maquette_syntax::{Kind, Tree};

use super::check::Check;
use super::definition::Port;
use super::expectation::Expectation;
use super::link::Names;
use super::{Graph, GraphOutput};
use crate::definition::{BoundExpectation, ParsedNode};

/// A condition on values of the flat graph. The names of the values are those of the flat graph, such as `nose/mask`.
#[derive(Clone)]
pub struct GraphExpectation {
    pub expectation: Expectation,
    /// For each value, its node and output in the flat graph. `None` for a value that does not exist.
    pub values: Vec<Option<(usize, usize)>>,
    /// The file that contains the expectation; `span` is its position in that file.
    pub(crate) source: Arc<Source>,
    pub(crate) span: Span,
    /// The node that uses the graph whose file contains the expectation. `None` if the file is that of the root graph.
    pub(super) of: Option<ExpectingUse>,
    /// True if a value belongs to the example that represents the elements of a `ForEach`. Such an expectation is not evaluated.
    pub(super) is_example: bool,
}

/// A node that uses another graph whose file contains expectations.
#[derive(Clone)]
pub(super) struct ExpectingUse {
    /// The path from the root graph to the used graph, outermost use first.
    pub(super) uses: Arc<[Use]>,
    /// The range of nodes of the flat graph that were made from the used graph.
    pub(super) inside: Range<usize>,
    /// The nodes of the flat graph that compute the outputs of the used graph.
    pub(super) givers: Vec<usize>,
}

impl GraphExpectation {
    /// Returns the error for a violated expectation. If a used graph contains the expectation, the position is that of the outermost use.
    pub fn diagnostic(&self, message: String) -> Diagnostic {
        let (source, span) = (self.source.clone(), self.span);
        let (severity, code) = (Severity::Error, code::EXPECTED);
        let uses = self.of.as_ref().map_or(&[][..], |of| &of.uses);
        let Some((outermost, inner)) = uses.split_first() else {
            return Diagnostic::new(severity, code, (source, span), message);
        };
        let Position { line, column } = Position::from_offset(&source.text, span.start);
        let help = format!("this is expected at {}:{line}:{column}", source.name.display());
        let (source, span) = (outermost.source.clone(), outermost.span);
        let uses = inner.to_vec();
        Diagnostic { help, uses, ..Diagnostic::new(severity, code, (source, span), message) }
    }

    /// Returns the nodes whose values are the subject of the expectation.
    fn nodes(&self) -> impl Iterator<Item = usize> {
        self.values.iter().flatten().map(|(node, _)| *node)
    }

    /// Returns true for an expectation of the root graph. For an expectation of a used graph, returns true if at least one node that was
    /// made from this used graph is needed.
    fn is_use_needed(&self, needed: &[bool]) -> bool {
        let Some(of) = &self.of else { return true };
        of.inside.clone().chain(of.givers.iter().copied()).any(|node| needed[node])
    }
}

impl Graph {
    /// Returns the expectations to test if the given nodes are evaluated: all expectations of the root graph, and those of each used graph
    /// of which a node is needed.
    pub fn expectations_for(&self, wanted: &[usize]) -> Vec<&GraphExpectation> {
        self.expectations_where(wanted, |_| true)
    }

    /// Returns the expectations to test if only the given nodes are evaluated. Expectations of the root graph are left out if they concern
    /// other values.
    pub fn expectations_for_only(&self, wanted: &[usize]) -> Vec<&GraphExpectation> {
        let needed = self.topology.needed_by(wanted);
        self.expectations_where(wanted, |expected| {
            let subject = expected.values.first().copied().flatten();
            subject.is_some_and(|(node, _)| needed[node])
        })
    }

    /// Returns the expectations to test if the given nodes are evaluated. Expectations of the root graph are included only if `is_meant`
    /// accepts them.
    fn expectations_where(
        &self,
        wanted: &[usize],
        is_meant: impl Fn(&GraphExpectation) -> bool,
    ) -> Vec<&GraphExpectation> {
        let mut wanted = wanted.to_vec();
        let mut live = vec![false; self.expect.len()];
        // The values of an expectation may need nodes of further used graphs, whose expectations then apply too.
        loop {
            let needed = self.topology.needed_by(&wanted);
            let is_new = |&at: &usize| {
                let it = &self.expect[at];
                !live[at] && if it.of.is_some() { it.is_use_needed(&needed) } else { is_meant(it) }
            };
            let new: Vec<_> = (0..live.len()).filter(is_new).collect();
            if new.is_empty() {
                break;
            }
            for at in new {
                live[at] = true;
                wanted.extend(self.expect[at].nodes());
            }
        }
        self.expect.iter().zip(live).filter(|(_, live)| *live).map(|(it, _)| it).collect()
    }

    /// Returns the expectations of used graphs whose values are among the dependencies of the given nodes.
    pub fn expectations_of_uses(&self, wanted: &[usize]) -> Vec<&GraphExpectation> {
        if self.expect.iter().all(|expected| expected.of.is_none()) {
            return Vec::new();
        }
        let needed = self.topology.needed_by(wanted);
        self.expect
            .iter()
            .filter(|expected| {
                expected.of.is_some()
                    && expected.is_use_needed(&needed)
                    && expected.nodes().all(|it| needed[it])
            })
            .collect()
    }

    /// Looks up the values of an expectation from another file, such as a test, in this graph.
    pub fn bind_expectation(
        &self,
        expectation: &Expectation,
        source: &Arc<Source>,
        span: Span,
    ) -> GraphExpectation {
        let values = expectation.values().into_iter().map(|name| self.find_value(name)).collect();
        GraphExpectation {
            expectation: expectation.clone(),
            values,
            source: source.clone(),
            span,
            of: None,
            is_example: false,
        }
    }
}

impl Check<'_, '_> {
    /// Reads the expectations of a graph file. Reports values that are not an output, an input or a node of the graph.
    pub(super) fn expectations(
        &mut self,
        tree: Option<&Tree>,
        (ports, files): (&[Port], &[GraphOutput]),
        outputs: &[(Tree, Tree)],
        parsed_nodes: &[ParsedNode],
        names: &Names<'_>,
    ) -> Vec<BoundExpectation> {
        let Some(tree) = tree else { return Vec::new() };
        let (expectations, diagnostics) = Expectation::read_all(tree);
        self.diagnostics.extend(diagnostics);
        let items = match &tree.kind {
            Kind::List(items) => &items[..],
            _ => &[],
        };
        let mut expecting = Vec::new();
        for (expectation, span) in expectations {
            let targets: Vec<_> = expectation
                .values()
                .into_iter()
                .map(|value| {
                    self.expected_target(value, span, (ports, files), outputs, parsed_nodes, names)
                })
                .collect();
            let types = targets.iter().map(|target| {
                target.and_then(|(node, output)| *parsed_nodes[node].types.get(output)?)
            });
            let item = items.iter().find(|item| item.span == span);
            let fault =
                item.and_then(|item| expectation.find_contradiction(&Vec::from_iter(types), item));
            self.diagnostics.extend(fault);
            expecting.push(BoundExpectation { expectation, span, targets });
        }
        expecting
    }

    /// Returns the node and output to which an expectation refers by a name. Reports an unknown name, and the name of a list of values.
    fn expected_target(
        &mut self,
        value: &str,
        span: Span,
        (ports, files): (&[Port], &[GraphOutput]),
        outputs: &[(Tree, Tree)],
        parsed_nodes: &[ParsedNode],
        names: &Names<'_>,
    ) -> Option<(usize, usize)> {
        // The value is named by an output. If the link of that output is invalid, the error has been reported at the output.
        if outputs.iter().any(|(key, _)| key.text() == Some(value)) {
            let port = ports.iter().find(|port| port.name == value);
            let file = files.iter().find(|file| file.name == value);
            return port
                .and_then(|port| port.target)
                .or_else(|| file.map(|file| (file.node, file.output)));
        }
        match self.target(value, span, parsed_nodes, names)?[..] {
            [(node, output)] if !parsed_nodes[node].is_list(output) => Some((node, output)),
            ref list => {
                let count = match list.len() {
                    1 => String::new(),
                    count => format!(" of {count}"),
                };
                let message = format!("expected a single value, found the list `{value}`{count}");
                let first = first_of(value);
                let help = format!(
                    "add the expectation to the graph of the elements, or use one element: `{first}`"
                );
                self.report(code::WRONG_TYPE, span, message, help);
                None
            }
        }
    }
}

/// Returns the first element, such as `spots/1.mask`, of a list of values, such as `spots.mask`.
fn first_of(list: &str) -> String {
    match list.split_once('.') {
        Some((each, output)) => format!("{each}/1.{output}"),
        None => format!("{list}/1"),
    }
}
