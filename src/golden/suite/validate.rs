//! Finds parts of a test file that do not fit the tested graph. No node is run.

use maquette_graph::{CheckedGraph, Expectation, Graph};
use maquette_syntax::error::{Diagnostic, Severity, Span, code};
use maquette_syntax::{Kind, Tree, nearest_or_all, parse, with_article};

use crate::case::TestFile;

impl TestFile {
    /// Creates an error at a position in the test file.
    pub(super) fn diagnostic(&self, code: &'static str, span: Span, message: String) -> Diagnostic {
        Diagnostic::new(Severity::Error, code, (self.source.clone(), span), message)
    }

    /// Returns the span of the name `name` in the map `field` of the case with the index `case`.
    fn span_of(&self, case: usize, field: &str, name: &str) -> Span {
        let (case, known) = &self.cases[case];
        let (tree, _) = parse(&self.source.text);
        let mut at = tree;
        let mut span = None;
        for (field, name) in [("cases", &case[..]), (field, name)] {
            let fields = at.fields().unwrap_or_default();
            let map = fields.iter().find(|found| found.name.text == field);
            let Some(Kind::Map(entries)) = map.map(|found| &found.value.kind) else { break };
            let entry = entries.iter().find(|(key, _)| key.text() == Some(name));
            let Some((key, value)) = entry.cloned() else { break };
            (span, at) = (Some(key.span), value);
        }
        span.unwrap_or(known.span)
    }

    /// Loads the graph of a case with the values that the case sets. Errors in these values are reported at their position in the test
    /// file.
    pub(crate) fn load_case(
        &self,
        case: usize,
        load: impl Fn(&[(String, String)]) -> CheckedGraph,
    ) -> CheckedGraph {
        let set = &self.cases[case].1.set;
        let mut checked = load(set);
        if set.is_empty() || checked.graph.is_some() {
            return checked;
        }
        let known = load(&[]).diagnostics;
        for one in set {
            let (target, text) = one;
            let alone = load(std::slice::from_ref(one)).diagnostics;
            let mut place = None;
            for diagnostic in &mut checked.diagnostics {
                if known.contains(diagnostic) || !alone.contains(diagnostic) {
                    continue;
                }
                let message = diagnostic.message.replace(&format!("--set {target}={text}: "), "");
                let span = *place.get_or_insert_with(|| self.span_of(case, "set", target));
                let help = std::mem::take(&mut diagnostic.help);
                *diagnostic =
                    Diagnostic { help, ..self.diagnostic(diagnostic.code, span, message) };
            }
        }
        checked
    }

    /// Loads the graph of a case with only the valid ones of the values that the case sets, so that further errors can be found.
    pub(super) fn load_valid_settings(
        &self,
        case: usize,
        load: impl Fn(&[(String, String)]) -> CheckedGraph,
    ) -> Option<Graph> {
        let mut set = self.cases[case].1.set.clone();
        if set.is_empty() {
            return None;
        }
        set.retain(|one| load(std::slice::from_ref(one)).graph.is_some());
        load(&set).graph
    }

    /// Returns an error for each input that a case sets but the graph does not have.
    pub(crate) fn wrong_inputs(&self, case: usize, graph: &Graph) -> Vec<Diagnostic> {
        let known: Vec<_> = graph.inputs().iter().map(|input| &input.name[..]).collect();
        let given = self.cases[case].1.inputs.iter();
        let wrong = given.filter(|(name, _)| !known.contains(&&name[..])).map(|(name, _)| {
            let help = match known.is_empty() {
                true => "it has no inputs; use `set` to change parameters".into(),
                false => nearest_or_all(name, "its inputs", &known),
            };
            let message = format!("the graph has no input `{name}`");
            let span = self.span_of(case, "inputs", name);
            Diagnostic { help: help.into(), ..self.diagnostic(code::UNKNOWN_FIELD, span, message) }
        });
        wrong.collect()
    }

    /// Returns an error for each tolerance whose output does not exist or has another type. Also returns an error for each expectation that
    /// cannot hold for the graph. The inputs of the graph must have values.
    pub(crate) fn validate(&self, graph: &Graph) -> Vec<Diagnostic> {
        let faults = self.expect.iter().filter_map(|(expectation, item)| {
            let unknown = self.unknown_value(expectation, item, graph);
            // If a test has several graphs, skip an expectation for the graphs that do not have its value.
            unknown.map_or_else(
                || self.invalid_expectation(expectation, item, graph),
                |unknown| (self.graphs.len() == 1).then_some(unknown),
            )
        });
        self.invalid_tolerances(graph).into_iter().chain(faults).collect()
    }

    /// Returns the expectations that apply to the graph, each with its position in the test file.
    pub(super) fn valid_expectations(
        &self,
        graph: &Graph,
    ) -> impl Iterator<Item = (&Expectation, Span)> {
        self.expect
            .iter()
            .filter(|(expectation, item)| {
                self.unknown_value(expectation, item, graph).is_none()
                    && self.invalid_expectation(expectation, item, graph).is_none()
            })
            .map(|(expectation, item)| (expectation, item.span))
    }

    /// Returns an error if an expectation can never hold, for example because of the type of its value.
    fn invalid_expectation(
        &self,
        expectation: &Expectation,
        item: &Tree,
        graph: &Graph,
    ) -> Option<Diagnostic> {
        let types: Vec<_> = expectation
            .values()
            .into_iter()
            .map(|name| {
                let (node, output) = graph.find_value(name)?;
                graph.nodes()[node].types[output]
            })
            .collect();
        Some(expectation.find_contradiction(&types, item)?.into_diagnostic(&self.source))
    }

    /// Returns an error if an expectation is about a value that does not exist.
    fn unknown_value(
        &self,
        expectation: &Expectation,
        item: &Tree,
        graph: &Graph,
    ) -> Option<Diagnostic> {
        fn is_there(name: &&str, graph: &Graph) -> bool {
            let node = name.split('.').next().unwrap_or_default();
            match graph.open_loop(node) {
                // A loop over data gets its elements only when the graph is run, so the value may exist then.
                Some(each) => each.name != node || graph.output_names().any(|it| it == *name),
                None => graph.find_value(name).is_some(),
            }
        }
        let name = expectation.values().into_iter().find(|name| !is_there(name, graph))?;
        let texts = Expectation::value_texts_of(item);
        let span = texts.into_iter().find(|text| text.text() == Some(name))?.span;
        let node = name.split('.').next().unwrap_or_default();
        let first = format!("{node}/1");
        if graph.loops().iter().any(|it| it.name == node)
            || graph.node_names().any(|name| {
                name.strip_prefix(&first)
                    .is_some_and(|it| !it.starts_with(|c: char| c.is_ascii_digit()))
            })
        {
            let message = format!("expected a single value, found the list `{name}`");
            let help = format!(
                "add the expectation to the graph of the elements, or use one element: `{first}`"
            );
            return Some(Diagnostic { help, ..self.diagnostic(code::WRONG_TYPE, span, message) });
        }
        let help = graph.value_help(name);
        let message = format!("there is no output or node `{name}`");
        Some(Diagnostic { help, ..self.diagnostic(code::UNKNOWN_LINK, span, message) })
    }

    fn invalid_tolerances(&self, graph: &Graph) -> Vec<Diagnostic> {
        let mut diagnostics = Vec::new();
        for allowed in &self.compare {
            let Some(output) = graph.outputs().iter().find(|output| output.name == allowed.output)
            else {
                if self.graphs.len() == 1 {
                    let names = Vec::from_iter(graph.output_names());
                    let help = nearest_or_all(&allowed.output, "its outputs", &names);
                    let message = format!("the graph has no output `{}`", allowed.output);
                    let diagnostic = self.diagnostic(code::UNKNOWN_LINK, allowed.span, message);
                    diagnostics.push(Diagnostic { help: help.into(), ..diagnostic });
                }
                continue;
            };
            let kind = graph.nodes()[output.node].types[output.output];
            if let Some(kind) = kind.filter(|kind| kind.name != allowed.kind) {
                let (is, not) = (with_article(kind.name), with_article(&allowed.kind));
                let message = format!("`{}` is {is}, not {not}", allowed.output);
                diagnostics.push(self.diagnostic(code::WRONG_TYPE, allowed.kind_span, message));
            }
        }
        diagnostics
    }
}
