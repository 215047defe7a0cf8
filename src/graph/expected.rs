//! What must hold of a graph's values: what its own file expects, and what the graphs that it uses do.

use std::ops::Range;
use std::sync::Arc;

use maquette_syntax::error::{Place, Problem, Severity, Source, Span, Use, code};
use maquette_syntax::{Kind, Tree};

use super::check::Check;
use super::definition::Port;
use super::expectation::Expectation;
use super::link::Names;
use super::{Graph, GraphOutput};
use crate::definition::{Draft, Expecting};

/// An expectation of values of a flat graph, under the names that they have there.
#[derive(Clone)]
pub struct Expected {
    pub expectation: Expectation,
    /// The node and output of each value that it speaks of; none for one that the graph does not have.
    pub values: Vec<Option<(usize, usize)>>,
    /// Where it stands.
    pub(crate) source: Arc<Source>,
    pub(crate) span: Span,
    /// What uses the graph that expects it.
    pub(super) of: Option<Expecter>,
    /// Whether it speaks of the example that stands for the elements of a `ForEach`, of which nothing is judged.
    pub(super) is_example: bool,
}

/// A use of a graph that expects something.
#[derive(Clone)]
pub(super) struct Expecter {
    /// The uses that lead there, the outermost first.
    pub(super) uses: Arc<[Use]>,
    /// The nodes inside.
    pub(super) inside: Range<usize>,
    /// The nodes that make what it gives.
    pub(super) givers: Vec<usize>,
}

impl Expected {
    /// What is wrong if it does not hold: told where the graph that expects it is used.
    pub fn problem(&self, message: String) -> Problem {
        let (source, span) = (self.source.clone(), self.span);
        let (severity, code) = (Severity::Error, code::EXPECTED);
        let uses = self.of.as_ref().map_or(&[][..], |of| &of.uses);
        let Some((outermost, inner)) = uses.split_first() else {
            return Problem::new(severity, code, (source, span), message);
        };
        let Place { line, column } = Place::of(&source.text, span.start);
        let help = format!("this is expected at {}:{line}:{column}", source.name.display());
        let (source, span) = (outermost.source.clone(), outermost.span);
        let uses = inner.to_vec();
        Problem { help, uses, ..Problem::new(severity, code, (source, span), message) }
    }

    /// The nodes whose values it speaks of.
    fn nodes(&self) -> impl Iterator<Item = usize> {
        self.values.iter().flatten().map(|(node, _)| *node)
    }

    /// Whether something of the use that expects it is needed.
    fn is_live(&self, needed: &[bool]) -> bool {
        let Some(of) = &self.of else { return true };
        of.inside.clone().chain(of.givers.iter().copied()).any(|node| needed[node])
    }
}

impl Graph {
    /// What must hold where these nodes are wanted: what the graph's own file expects, and what each graph does of which a use is needed.
    pub fn expected(&self, wanted: &[usize]) -> Vec<&Expected> {
        self.expected_if(wanted, |_| true)
    }

    /// The same where these nodes alone are wanted: what the graph's own file expects of other values is left out.
    pub fn expected_of_only(&self, wanted: &[usize]) -> Vec<&Expected> {
        let needed = self.shape.needed_by(wanted);
        self.expected_if(wanted, |expected| {
            let subject = expected.values.first().copied().flatten();
            subject.is_some_and(|(node, _)| needed[node])
        })
    }

    /// What must hold where these nodes are wanted; of what the graph's own file expects, what `is_meant`.
    fn expected_if(
        &self,
        wanted: &[usize],
        is_meant: impl Fn(&Expected) -> bool,
    ) -> Vec<&Expected> {
        let mut wanted = wanted.to_vec();
        let mut live = vec![false; self.expect.len()];
        // What is expected of a value may need another use.
        loop {
            let needed = self.shape.needed_by(&wanted);
            let is_live = |it: &Expected| match it.of {
                Some(_) => it.is_live(&needed),
                None => is_meant(it),
            };
            let new: Vec<_> =
                (0..live.len()).filter(|at| !live[*at] && is_live(&self.expect[*at])).collect();
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

    /// The same of the graphs that it uses alone, as far as these nodes need what they speak of.
    pub fn expected_of_uses(&self, wanted: &[usize]) -> Vec<&Expected> {
        if self.expect.iter().all(|expected| expected.of.is_none()) {
            return Vec::new();
        }
        let needed = self.shape.needed_by(wanted);
        self.expect
            .iter()
            .filter(|expected| {
                expected.of.is_some()
                    && expected.is_live(&needed)
                    && expected.nodes().all(|it| needed[it])
            })
            .collect()
    }

    /// An expectation of another file, such as a test, of this graph's values.
    pub fn expecting(
        &self,
        expectation: &Expectation,
        source: &Arc<Source>,
        span: Span,
    ) -> Expected {
        let values = expectation.values().into_iter().map(|name| self.value_named(name)).collect();
        Expected {
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
    /// What the graph expects of its values, each of which must be there as an output, an input or a node.
    pub(super) fn expectations(
        &mut self,
        tree: Option<&Tree>,
        (ports, files): (&[Port], &[GraphOutput]),
        outputs: &[(Tree, Tree)],
        drafts: &[Draft],
        names: &Names<'_>,
    ) -> Vec<Expecting> {
        let Some(tree) = tree else { return Vec::new() };
        let (expectations, findings) = Expectation::read_all(tree);
        self.findings.extend(findings);
        let items = match &tree.kind {
            Kind::List(items) => &items[..],
            _ => &[],
        };
        let mut expecting = Vec::new();
        for (expectation, span) in expectations {
            let target = |value: &str| {
                // What is wrong with an output is said there.
                if outputs.iter().any(|(key, _)| key.text() == Some(value)) {
                    let port = ports.iter().find(|port| port.name == value);
                    let file = files.iter().find(|file| file.name == value);
                    return port
                        .and_then(|port| port.target)
                        .or_else(|| file.map(|file| (file.node, file.output)));
                }
                match self.target(value, span, drafts, names)?[..] {
                    [(node, output)] if !drafts[node].is_list(output) => Some((node, output)),
                    ref list => {
                        let count = match list.len() {
                            1 => String::new(),
                            count => format!(" of {count}"),
                        };
                        let message = format!(
                            "one value is expected to be so, but `{value}` is a list{count}"
                        );
                        let first = first_of(value);
                        let help = format!(
                            "say it in the graph that makes each of them, or of one: `{first}`"
                        );
                        self.find(code::WRONG_TYPE, span, message, help);
                        None
                    }
                }
            };
            let targets: Vec<_> = expectation.values().into_iter().map(target).collect();
            let kind =
                |&(node, output): &(usize, usize)| drafts[node].types.get(output).copied()?;
            let types = targets.iter().map(|target| target.as_ref().and_then(kind));
            let item = items.iter().find(|item| item.span == span);
            let fault = item.and_then(|item| expectation.fault(&Vec::from_iter(types), item));
            self.findings.extend(fault);
            expecting.push(Expecting { expectation, span, targets });
        }
        expecting
    }
}

/// The first of a list of values: `spots/1.mask` of `spots.mask`.
fn first_of(list: &str) -> String {
    match list.split_once('.') {
        Some((each, output)) => format!("{each}/1.{output}"),
        None => format!("{list}/1"),
    }
}
