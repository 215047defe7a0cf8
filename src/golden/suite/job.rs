//! Runs one case of one graph: evaluates the graph and compares its outputs with the goldens.

use std::path::PathBuf;
use std::time::Instant;

use maquette_engine::digits::six_digits;
use maquette_engine::eval::RunTrace;
use maquette_engine::session::{Run, RunResult, Session, Targets};
use maquette_engine::writing;
use maquette_engine::writing::Sources;
use maquette_graph::{Graph, GraphExpectation, GraphNode, GraphOutput, Options};
use maquette_syntax::error::{Diagnostic, Severity, code};
use maquette_value::AnyValue;

use super::nodes::nodes_of;
use super::orphans::goldens;
use super::{Case, OutputComparison, State, test_folder};
use crate::case::{OutputTolerance, TestFile};
use crate::compare::{Comparison, Measure, Tolerance, Verdict, limit_of};
use crate::parts::GoldenParts;
use crate::store;
use crate::store::{Golden, GoldenError, WrittenFile};

/// If a tolerance is more than this many times the largest difference ever accepted, the user is told that the tolerance is too large.
const MAX_EXCESS: f64 = 10.0;

/// Returns the name of a measure and the part of its difference that cannot come from rounding. `None` if rounding alone can explain the
/// difference.
fn certain_difference(measure: &Measure) -> Option<(String, f64)> {
    let least = measure.max - measure.error;
    (0.0 < least && least < f64::INFINITY).then(|| (measure.name.clone(), least))
}

/// Returns the name of the golden for an output of a node: `node`, or `node.output` if the node has several outputs. Slashes, which the
/// names of nodes inside of used graphs contain, become dots: all goldens of a case are in one folder.
fn expected_name(node: &GraphNode, output: usize) -> String {
    let name = match node.outputs.len() {
        1 => node.name.clone(),
        _ => format!("{}.{}", node.name, node.outputs[output]),
    };
    name.replace('/', ".")
}

/// Describes the goldens that should be stored again although their values are equal.
fn outdated_notes(outputs: &[OutputComparison]) -> Vec<String> {
    let same = outputs.iter().filter(|output| output.comparison.verdict == Verdict::Identical);
    let notes = same.filter_map(|output| {
        Some(format!(
            "{}: the golden {}; --bless stores it again",
            output.name, output.outdated_reason?
        ))
    });
    notes.collect()
}

/// A case to be run: the test file, the tested graph, and the index of the case in the test file.
#[derive(Clone)]
pub(super) struct Job<'a> {
    pub(super) test: &'a TestFile,
    pub(super) graph: PathBuf,
    pub(super) case: usize,
    pub(super) folder: PathBuf,
}

impl Job<'_> {
    pub(super) fn title(&self) -> String {
        format!("{} {}", self.graph.display(), self.test.cases[self.case].0)
    }

    /// Runs the case. If `locked` is true, used graphs must match the lock files.
    pub(super) fn run(&self, session: &mut Session, locked: bool) -> Case {
        let start = Instant::now();
        let (name, test_case) = &self.test.cases[self.case];
        let mut case = Case {
            graph: self.graph.clone(),
            name: name.clone(),
            folder: self.folder.clone(),
            test_folder: test_folder(self.test).to_owned(),
            sources: Sources::default(),
            state: State::Broken,
            outputs: Vec::new(),
            diagnostics: Vec::new(),
            violations: Vec::new(),
            warnings: Vec::new(),
            orphans: Vec::new(),
            notes: Vec::new(),
            trace: RunTrace::default(),
            seconds: 0.0,
            file_seconds: 0.0,
            nodes: None,
        };
        match &test_case.skip {
            Some(why) if why.trim().is_empty() => {
                case.diagnostics.push(self.test.diagnostic(
                    code::WRONG_VALUE,
                    test_case.span,
                    format!("case `{name}` is skipped without a reason"),
                ));
                return case;
            }
            Some(why) => {
                case.state = State::Skipped(why.clone());
                return case;
            }
            None => {}
        }
        let options = Options { locked, ..Options::default() };
        let checked = self.test.load_case(self.case, |set| {
            session.load(&self.graph, &Options { set: set.to_vec(), ..options.clone() })
        });
        case.sources = Sources::of_checked(&self.graph, &checked);
        case.diagnostics = checked.diagnostics;
        let Some(graph) = checked.graph else { return case };
        let wrong = self.test.wrong_inputs(self.case, &graph);
        if !wrong.is_empty() {
            case.diagnostics.extend(wrong);
            return case;
        }
        let graph = match self.bind_inputs(graph, &test_case.inputs, session) {
            Ok(graph) => graph,
            Err(diagnostics) => {
                case.diagnostics.extend(diagnostics);
                return case;
            }
        };
        let expected = self.test.expect.iter().flat_map(|(expectation, _)| expectation.values());
        let names: Vec<_> = graph.output_names().chain(expected).collect();
        let idle = Run::default();
        let graph = session.resolve_for(&graph, &names, idle.observer, &idle.cancel);
        case.diagnostics.extend(self.test.validate(&graph));
        let expectations = self.expectations(&graph);
        let values = expectations.iter().flat_map(|expected| expected.expectation.values());
        let values = values.filter(|name| graph.find_value(name).is_some());
        let wanted = Targets::OutputsAnd(values.map(str::to_owned).collect());
        let broken =
            case.diagnostics.iter().any(|diagnostic| diagnostic.severity == Severity::Error);
        let mut finished = match session.run(&graph, &Run { targets: wanted, ..Run::default() }) {
            Ok(finished) => finished,
            Err(diagnostics) => {
                case.diagnostics.extend(diagnostics);
                return case;
            }
        };
        case.diagnostics.extend(finished.failures());
        case.violations = std::mem::take(&mut finished.violations);
        case.trace = finished.trace();
        case.nodes = Some(nodes_of(&graph, &case.trace));
        let session = &*session;
        case.outputs = session.install(|| self.outputs(&graph, &finished, session, &mut case));
        case.violations.extend(finished.check_expectations(&Vec::from_iter(&expectations)));
        // Look for orphans only if every output has a value, because the golden of an output without a value is still needed.
        let compared: usize = case.outputs.iter().map(|output| output.files.len()).sum();
        if compared == graph.outputs().len() {
            case.orphans = self.orphans(&case.outputs);
        }
        case.notes = self.wide_tolerances(&case.outputs);
        case.notes.extend(outdated_notes(&case.outputs));
        self.judge_budget(&mut case);
        case.judge_warnings();
        let failed = case
            .diagnostics
            .iter()
            .any(|diagnostic| diagnostic.severity == Severity::Error)
            || case.outputs.iter().any(|o| o.comparison.verdict == Verdict::Different)
            || !(case.violations.is_empty() && case.warnings.is_empty() && case.orphans.is_empty());
        case.state = if broken {
            State::Broken
        } else if failed {
            State::Failed
        } else {
            State::Passed
        };
        case.seconds = start.elapsed().as_secs_f64();
        case
    }

    /// Returns the graph with the values of the case's input files as its inputs.
    fn bind_inputs(
        &self,
        graph: Graph,
        inputs: &[(String, PathBuf)],
        session: &Session,
    ) -> Result<Graph, Vec<Diagnostic>> {
        if inputs.is_empty() {
            return Ok(graph);
        }
        let (values, _) = session.read_inputs(&graph, inputs)?;
        session.bind_inputs(&graph, &values)
    }

    /// Returns the expectations that the test adds to those of the graph.
    fn expectations(&self, graph: &Graph) -> Vec<GraphExpectation> {
        let source = &self.test.source;
        let expected = self.test.valid_expectations(graph);
        expected
            .map(|(expectation, span)| graph.bind_expectation(expectation, source, span))
            .collect()
    }

    fn tolerance_of(&self, files: &[String]) -> Option<&OutputTolerance> {
        self.test.compare.iter().find(|allowed| files.contains(&allowed.output))
    }

    /// Compares the value of each output with its golden.
    fn outputs(
        &self,
        graph: &Graph,
        finished: &RunResult,
        session: &Session,
        case: &mut Case,
    ) -> Vec<OutputComparison> {
        let mut places: Vec<(usize, usize)> =
            graph.outputs().iter().map(|o| (o.node, o.output)).collect();
        places.sort_unstable();
        places.dedup();
        let named: Vec<_> = places
            .iter()
            .map(|&(node, output)| expected_name(&graph.nodes()[node], output))
            .collect();
        let mut compared = Vec::new();
        for ((node, output), name) in places.into_iter().zip(&named) {
            let same = graph.outputs().iter().filter(|o| (o.node, o.output) == (node, output));
            let outputs: Vec<&GraphOutput> = same.collect();
            let Some(value) = finished.value(&outputs[0].name) else { continue };
            let names: Vec<String> = outputs.iter().map(|output| output.name.clone()).collect();
            let start = Instant::now();
            let files =
                self.write_outputs(&outputs, value, finished, session, &mut case.diagnostics);
            case.file_seconds += start.elapsed().as_secs_f64();
            let tolerance = self
                .tolerance_of(&names)
                .map(|allowed| allowed.tolerance.clone())
                .unwrap_or_default();
            let name = self.golden_name(name.clone(), &names, &named);
            compared.push(self.compare(name, names, value, &files, &tolerance));
        }
        compared
    }

    /// Returns the name of the golden for some outputs of a node. If the node was renamed since the golden was accepted, the result
    /// contains the node's former name.
    fn golden_name(&self, name: String, outputs: &[String], named: &[String]) -> String {
        if !matches!(store::read(&self.folder, &name), Err(GoldenError::Missing)) {
            return name;
        }
        fn is_of(golden: &Golden, outputs: &[String]) -> bool {
            outputs.iter().any(|output| golden.line(&format!("file {output}")).is_some())
        }
        let mut others = goldens(&self.folder).into_keys().filter(|other| !named.contains(other));
        let before = others
            .find(|other| store::read(&self.folder, other).is_ok_and(|it| is_of(&it, outputs)));
        before.unwrap_or(name)
    }

    /// Returns descriptions of the files to which a value is written. They are cached on disk for this build of the program, because one
    /// build writes equal values to equal files. So a value is encoded only if no equal value was encoded before.
    fn write_outputs(
        &self,
        outputs: &[&GraphOutput],
        value: &AnyValue,
        finished: &RunResult,
        session: &Session,
        diagnostics: &mut Vec<Diagnostic>,
    ) -> Vec<WrittenFile> {
        let names = outputs.iter().map(|output| format!("/{}", output.name));
        let key = PathBuf::from(format!("written/{}{}", value.hash(), String::from_iter(names)));
        let known = session.note(&key).and_then(|note| WrittenFile::read(&note));
        if let Some(known) = known {
            return known;
        }
        let (mut files, mut complete) = (Vec::new(), true);
        for output in outputs {
            match finished.files(&output.name) {
                Some(Ok(written)) => files.extend(written.iter().map(WrittenFile::from_file)),
                Some(Err(error)) => {
                    complete = false;
                    let message = format!("cannot write `{}`: {error}", output.name);
                    diagnostics.push(Diagnostic {
                        source: finished.graph().source().clone(),
                        ..self.test.diagnostic(code::FAILED, output.span, message)
                    });
                }
                None => complete = false,
            }
        }
        if complete {
            session.keep_note(&key, || WrittenFile::note(&files));
        }
        files
    }

    fn compare(
        &self,
        name: String,
        names: Vec<String>,
        value: &AnyValue,
        files: &[WrittenFile],
        tolerance: &Tolerance,
    ) -> OutputComparison {
        let golden = store::read(&self.folder, &name);
        let comparison = match &golden {
            Ok(golden) => golden.compare(value, files, tolerance),
            Err(GoldenError::Missing) => Comparison::new(
                vec!["there is no golden; check the result, then bless it".into()],
                Vec::new(),
            ),
            Err(GoldenError::Damaged(why)) => {
                Comparison::new(vec![format!("the golden {why}")], Vec::new())
            }
        };
        let identical = comparison.verdict == Verdict::Identical;
        let mut needed = golden.as_ref().map(Golden::accepted_differences).unwrap_or_default();
        if comparison.verdict == Verdict::Within {
            for (name, most) in comparison.measures.iter().filter_map(certain_difference) {
                match needed.iter_mut().find(|(known, _)| *known == name) {
                    Some((_, before)) => *before = before.max(most),
                    None => needed.push((name, most)),
                }
            }
        }
        let outdated = golden.as_ref().ok().and_then(|golden| golden.outdated_reason(tolerance));
        OutputComparison {
            name,
            files: names,
            comparison,
            golden,
            outdated_reason: outdated,
            value: value.clone(),
            changed: !identical || outdated.is_some(),
            files_written: files.to_vec(),
            accepted_differences: needed,
            tolerance: tolerance.clone(),
        }
    }

    /// Returns the goldens in the folder of the case that belong to no output.
    fn orphans(&self, outputs: &[OutputComparison]) -> Vec<PathBuf> {
        let sources = Sources::default();
        if writing::Destination::without_links(test_folder(self.test), &sources)
            .check_folder(&self.folder)
            .is_err()
        {
            return Vec::new();
        }
        let mut goldens = goldens(&self.folder);
        outputs.iter().for_each(|output| drop(goldens.remove(&output.name)));
        goldens.into_values().flatten().collect()
    }

    /// Returns a note for each tolerance that is much larger than the differences of this run and all differences ever accepted.
    fn wide_tolerances(&self, outputs: &[OutputComparison]) -> Vec<String> {
        let mut notes = Vec::new();
        for output in outputs {
            let Some(allowed) = self.tolerance_of(&output.files) else { continue };
            let before =
                output.golden.as_ref().map(Golden::accepted_differences).unwrap_or_default();
            let now = output.comparison.measures.iter().filter_map(certain_difference);
            let needed: Vec<(String, f64)> = before.into_iter().chain(now).collect();
            let parts = GoldenParts::from_value(&output.value).unwrap_or_default();
            for (name, limit) in allowed.tolerance.limits() {
                let of_limit = needed.iter().filter(|(measure, _)| match parts.column(measure) {
                    Some(part) => limit_of(part, &allowed.tolerance) == Some(name),
                    None => name == "max" && measure.starts_with("surface,"),
                });
                let most = of_limit.map(|(_, needed)| *needed).fold(0.0, f64::max);
                if most > 0.0 && most * MAX_EXCESS < limit {
                    let (limit, most) = (six_digits(limit), six_digits(most));
                    notes.push(format!(
                        "{}: the tolerance `{name}` of {limit} is more than ten times the largest difference so far ({most})",
                        output.name
                    ));
                }
            }
        }
        notes
    }

    fn judge_budget(&self, case: &mut Case) {
        let budget = self.test.budget;
        let seconds: f64 = case.trace.0.iter().map(|node| node.seconds).sum();
        let memory = case.trace.0.iter().map(|node| node.bytes as f64).sum::<f64>() / 1e6;
        let spent = [
            ("the nodes took", seconds, budget.seconds, "s"),
            ("the nodes' results take", memory, budget.memory, "MB"),
        ];
        for (what, spent, budget, unit) in spent {
            if let Some(budget) = budget.filter(|budget| spent > *budget) {
                let span = self.test.cases[self.case].1.span;
                let message = format!("{what} {spent:.2} {unit}; the budget is {budget} {unit}");
                case.diagnostics.push(self.test.diagnostic(code::EXPECTED, span, message));
            }
        }
    }
}
