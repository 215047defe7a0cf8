//! Expectations of a flat graph: those of the graph's own file and those of the graphs that it uses.

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

/// An expectation about values, which it names as in the flat graph.
#[derive(Clone)]
pub struct GraphExpectation {
    pub expectation: Expectation,
    /// The node and output of each value. `None` for a value that does not exist.
    pub values: Vec<Option<(usize, usize)>>,
    /// The position of the expectation.
    pub(crate) source: Arc<Source>,
    pub(crate) span: Span,
    /// The use of the graph that contains the expectation. `None` if it is in the graph's own file.
    pub(super) of: Option<ExpectingUse>,
    /// True if a value belongs to the example that represents the elements of a `ForEach`. Such an expectation is not evaluated.
    pub(super) is_example: bool,
}

/// A use of a graph whose file contains expectations.
#[derive(Clone)]
pub(super) struct ExpectingUse {
    /// The uses that lead to the graph, from the outermost one.
    pub(super) uses: Arc<[Use]>,
    /// The range of the flat nodes that belong to the use.
    pub(super) inside: Range<usize>,
    /// The nodes that compute the outputs of the used graph.
    pub(super) givers: Vec<usize>,
}

impl GraphExpectation {
    /// Returns the error for a violated expectation, at the position of the outermost use.
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

    /// Returns the nodes of the values of the expectation.
    fn nodes(&self) -> impl Iterator<Item = usize> {
        self.values.iter().flatten().map(|(node, _)| *node)
    }

    /// Returns true if at least one node of the use that contains the expectation is needed.
    fn is_use_needed(&self, needed: &[bool]) -> bool {
        let Some(of) = &self.of else { return true };
        of.inside.clone().chain(of.givers.iter().copied()).any(|node| needed[node])
    }
}

impl Graph {
    /// Returns the expectations that apply if the given nodes are evaluated: all expectations of the graph's own file, and those of each
    /// used graph that is needed.
    pub fn expectations_for(&self, wanted: &[usize]) -> Vec<&GraphExpectation> {
        self.expectations_where(wanted, |_| true)
    }

    /// Returns the expectations that apply if only the given nodes are evaluated. An expectation of the graph's own file about other values
    /// does not apply.
    pub fn expectations_for_only(&self, wanted: &[usize]) -> Vec<&GraphExpectation> {
        let needed = self.topology.needed_by(wanted);
        self.expectations_where(wanted, |expected| {
            let subject = expected.values.first().copied().flatten();
            subject.is_some_and(|(node, _)| needed[node])
        })
    }

    /// Returns the expectations that apply if the given nodes are evaluated. Expectations of the graph's own file are returned only if
    /// `is_meant` accepts them.
    fn expectations_where(
        &self,
        wanted: &[usize],
        is_meant: impl Fn(&GraphExpectation) -> bool,
    ) -> Vec<&GraphExpectation> {
        let mut wanted = wanted.to_vec();
        let mut live = vec![false; self.expect.len()];
        // To evaluate the values of an expectation, further uses may be needed.
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

    /// Returns the expectations of used graphs about the values on which the given nodes depend.
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

    /// Binds an expectation of another file, such as a test, to the values of this graph.
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
    /// Reads the expectations of a graph. Each of their values must be an output, an input or a node.
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

    /// Returns the node and the output of a value of an expectation. Reports a name that does not exist, and a name of a list.
    fn expected_target(
        &mut self,
        value: &str,
        span: Span,
        (ports, files): (&[Port], &[GraphOutput]),
        outputs: &[(Tree, Tree)],
        parsed_nodes: &[ParsedNode],
        names: &Names<'_>,
    ) -> Option<(usize, usize)> {
        // Errors of outputs are reported at the outputs, not again here.
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

/// Returns the first element, `spots/1.mask`, of a list of values, `spots.mask`.
fn first_of(list: &str) -> String {
    match list.split_once('.') {
        Some((each, output)) => format!("{each}/1.{output}"),
        None => format!("{list}/1"),
    }
}
