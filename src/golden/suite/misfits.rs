//! What of a test does not fit the graph that it is about: known without running anything.

use maquette_graph::{Checked, Expectation, Graph};
use maquette_syntax::error::{Problem, Severity, Span, code};
use maquette_syntax::{Kind, Tree, nearest_or_all, parse, with_article};

use crate::case::TestFile;

impl TestFile {
    /// An error in the file.
    pub(super) fn problem(&self, code: &'static str, span: Span, message: String) -> Problem {
        Problem::new(Severity::Error, code, (self.source.clone(), span), message)
    }

    /// Where a name in a map of a case stands.
    fn place(&self, case: usize, field: &str, name: &str) -> Span {
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

    /// The graph of a case as it is read with what the case sets; what is wrong with a value that is set is told at its place.
    pub(crate) fn loaded(
        &self,
        case: usize,
        load: impl Fn(&[(String, String)]) -> Checked,
    ) -> Checked {
        let set = &self.cases[case].1.set;
        let mut checked = load(set);
        if set.is_empty() || checked.graph.is_some() {
            return checked;
        }
        let known = load(&[]).problems;
        for one in set {
            let (target, text) = one;
            let alone = load(std::slice::from_ref(one)).problems;
            let mut place = None;
            for problem in &mut checked.problems {
                if known.contains(problem) || !alone.contains(problem) {
                    continue;
                }
                let message = problem.message.replace(&format!("--set {target}={text}: "), "");
                let span = *place.get_or_insert_with(|| self.place(case, "set", target));
                let help = std::mem::take(&mut problem.help);
                *problem = Problem { help, ..self.problem(problem.code, span, message) };
            }
        }
        checked
    }

    /// The graph of a case with those values that can be set: what else does not fit is told as well.
    pub(super) fn loaded_with_what_fits(
        &self,
        case: usize,
        load: impl Fn(&[(String, String)]) -> Checked,
    ) -> Option<Graph> {
        let mut set = self.cases[case].1.set.clone();
        if set.is_empty() {
            return None;
        }
        set.retain(|one| load(std::slice::from_ref(one)).graph.is_some());
        load(&set).graph
    }

    /// Inputs of a case that the graph does not have.
    pub(crate) fn wrong_inputs(&self, case: usize, graph: &Graph) -> Vec<Problem> {
        let known: Vec<_> = graph.inputs().iter().map(|input| &input.name[..]).collect();
        let given = self.cases[case].1.inputs.iter();
        let wrong = given.filter(|(name, _)| !known.contains(&&name[..])).map(|(name, _)| {
            let help = match known.is_empty() {
                true => "it has no inputs at all; `set` changes parameters".into(),
                false => nearest_or_all(name, "its inputs", &known),
            };
            let message = format!("the graph has no input `{name}`");
            let span = self.place(case, "inputs", name);
            Problem { help: help.into(), ..self.problem(code::UNKNOWN_FIELD, span, message) }
        });
        wrong.collect()
    }

    /// Tolerances for outputs that the graph does not have or that are of another type, and expectations that cannot hold of it. The
    /// graph has its inputs.
    pub(crate) fn misfits(&self, graph: &Graph) -> Vec<Problem> {
        let faults = self.expect.iter().filter_map(|(expectation, item)| {
            let unknown = self.unknown(expectation, item, graph);
            // Of many graphs, each is expected what it has.
            unknown.map_or_else(
                || self.fault(expectation, item, graph),
                |unknown| (self.graphs.len() == 1).then_some(unknown),
            )
        });
        self.tolerances(graph).into_iter().chain(faults).collect()
    }

    /// Expectations that may hold of the graph, and where they stand.
    pub(super) fn expected(&self, graph: &Graph) -> impl Iterator<Item = (&Expectation, Span)> {
        self.expect
            .iter()
            .filter(|(expectation, item)| {
                self.unknown(expectation, item, graph).is_none()
                    && self.fault(expectation, item, graph).is_none()
            })
            .map(|(expectation, item)| (expectation, item.span))
    }

    /// Why an expectation cannot hold.
    fn fault(&self, expectation: &Expectation, item: &Tree, graph: &Graph) -> Option<Problem> {
        let types: Vec<_> = expectation
            .values()
            .into_iter()
            .map(|name| {
                let (node, output) = graph.value_named(name)?;
                graph.nodes()[node].types[output]
            })
            .collect();
        Some(expectation.fault(&types, item)?.at(&self.source))
    }

    /// An expectation of a value that is not there.
    fn unknown(&self, expectation: &Expectation, item: &Tree, graph: &Graph) -> Option<Problem> {
        fn is_there(name: &&str, graph: &Graph) -> bool {
            let node = name.split('.').next().unwrap_or_default();
            match graph.open_loop(node) {
                // Its elements may be there when the graph is run.
                Some(each) => each.name != node || graph.output_names().any(|it| it == *name),
                None => graph.value_named(name).is_some(),
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
            let message = format!("one value is expected to be so, but `{name}` is a list");
            let help = format!("say it in the graph that makes each of them, or of one: `{first}`");
            return Some(Problem { help, ..self.problem(code::WRONG_TYPE, span, message) });
        }
        let help = graph.value_meant(name);
        let message = format!("there is no output or node `{name}`");
        Some(Problem { help, ..self.problem(code::UNKNOWN_LINK, span, message) })
    }

    fn tolerances(&self, graph: &Graph) -> Vec<Problem> {
        let mut problems = Vec::new();
        for allowed in &self.compare {
            let Some(output) = graph.outputs().iter().find(|output| output.name == allowed.output)
            else {
                if self.graphs.len() == 1 {
                    let names = Vec::from_iter(graph.output_names());
                    let help = nearest_or_all(&allowed.output, "its outputs", &names);
                    let message = format!("the graph has no output `{}`", allowed.output);
                    let problem = self.problem(code::UNKNOWN_LINK, allowed.span, message);
                    problems.push(Problem { help: help.into(), ..problem });
                }
                continue;
            };
            let kind = graph.nodes()[output.node].types[output.output];
            if let Some(kind) = kind.filter(|kind| kind.name != allowed.kind) {
                let (is, not) = (with_article(kind.name), with_article(&allowed.kind));
                let message = format!("`{}` is {is}, not {not}", allowed.output);
                problems.push(self.problem(code::WRONG_TYPE, allowed.kind_span, message));
            }
        }
        problems
    }
}
