//! One case of one graph: evaluated, compared, judged.

use std::path::PathBuf;
use std::time::Instant;

use maquette_engine::eval::RunTrace;
use maquette_engine::session::{Finished, Run, Session, Wanted};
use maquette_engine::six::six;
use maquette_engine::writing;
use maquette_engine::writing::Sources;
use maquette_graph::{Expected, Graph, GraphOutput, Options};
use maquette_syntax::error::{Problem, Severity, code};
use maquette_value::AnyValue;

use super::nodes::nodes_of;
use super::orphans::goldens;
use super::{Case, Compared, State, beside};
use crate::case::{Allowed, TestFile};
use crate::compare::{Comparison, Measure, Tolerance, Verdict, limit_of};
use crate::parts::GoldenParts;
use crate::store;
use crate::store::{Golden, NoGolden, Written};

/// A tolerance this many times wider than what was ever needed is worth a word.
const TOO_WIDE: f64 = 10.0;

/// How much a measure's values differ at least, with its name; none if rounding alone may be what differs.
fn surely(measure: &Measure) -> Option<(String, f64)> {
    let least = measure.max - measure.error;
    (0.0 < least && least < f64::INFINITY).then(|| (measure.name.clone(), least))
}

/// What of a case's goldens would be kept otherwise now, although the values are the same.
fn outdated(outputs: &[Compared]) -> Vec<String> {
    let same = outputs.iter().filter(|output| output.comparison.verdict == Verdict::Identical);
    let told = same.filter_map(|output| {
        Some(format!("{}: the golden {}; --bless keeps it anew", output.name, output.outdated?))
    });
    told.collect()
}

/// One case of one graph.
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

    /// What comes of it; with `locked`, used graphs must be what lock files say.
    pub(super) fn run(&self, session: &mut Session, locked: bool) -> Case {
        let start = Instant::now();
        let (name, test_case) = &self.test.cases[self.case];
        let mut case = Case {
            graph: self.graph.clone(),
            name: name.clone(),
            folder: self.folder.clone(),
            beside: beside(self.test).to_owned(),
            sources: Sources::default(),
            state: State::Broken,
            outputs: Vec::new(),
            problems: Vec::new(),
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
                case.problems.push(self.test.problem(
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
        let checked = self.test.loaded(self.case, |set| {
            session.load(&self.graph, &Options { set: set.to_vec(), ..options.clone() })
        });
        case.sources = Sources::of_checked(&self.graph, &checked);
        case.problems = checked.problems;
        let Some(graph) = checked.graph else { return case };
        let wrong = self.test.wrong_inputs(self.case, &graph);
        if !wrong.is_empty() {
            case.problems.extend(wrong);
            return case;
        }
        let graph = match self.fed(graph, &test_case.inputs, session) {
            Ok(graph) => graph,
            Err(problems) => {
                case.problems.extend(problems);
                return case;
            }
        };
        let expected = self.test.expect.iter().flat_map(|(expectation, _)| expectation.values());
        let names: Vec<_> = graph.output_names().chain(expected).collect();
        let idle = Run::default();
        let graph = session.resolved_for(&graph, &names, idle.observer, &idle.cancel);
        case.problems.extend(self.test.misfits(&graph));
        let expectations = self.expectations(&graph);
        let values = expectations.iter().flat_map(|expected| expected.expectation.values());
        let values = values.filter(|name| graph.value_named(name).is_some());
        let wanted = Wanted::OutputsAnd(values.map(str::to_owned).collect());
        let broken = case.problems.iter().any(|problem| problem.severity == Severity::Error);
        let mut finished = match session.run(&graph, &Run { wanted, ..Run::default() }) {
            Ok(finished) => finished,
            Err(problems) => {
                case.problems.extend(problems);
                return case;
            }
        };
        case.problems.extend(finished.failures());
        case.violations = std::mem::take(&mut finished.violations);
        case.trace = finished.trace();
        case.nodes = Some(nodes_of(&graph, &case.trace));
        let session = &*session;
        case.outputs = session.install(|| self.outputs(&graph, &finished, session, &mut case));
        case.violations.extend(finished.judged(&Vec::from_iter(&expectations)));
        // A golden whose output has no value belongs to that output.
        let compared: usize = case.outputs.iter().map(|output| output.files.len()).sum();
        if compared == graph.outputs().len() {
            case.orphans = self.orphans(&case.outputs);
        }
        case.notes = self.wide(&case.outputs);
        case.notes.extend(outdated(&case.outputs));
        self.judge_budget(&mut case);
        case.judge_warnings();
        let failed = case.problems.iter().any(|problem| problem.severity == Severity::Error)
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

    /// The graph with the values in some files at its inputs.
    fn fed(
        &self,
        graph: Graph,
        inputs: &[(String, PathBuf)],
        session: &Session,
    ) -> Result<Graph, Vec<Problem>> {
        if inputs.is_empty() {
            return Ok(graph);
        }
        let (values, _) = session.read_inputs(&graph, inputs)?;
        session.fed(&graph, &values)
    }

    /// What the test expects, beside the graph itself.
    fn expectations(&self, graph: &Graph) -> Vec<Expected> {
        let source = &self.test.source;
        let expected = self.test.expected(graph);
        expected.map(|(expectation, span)| graph.expecting(expectation, source, span)).collect()
    }

    fn allowed(&self, files: &[String]) -> Option<&Allowed> {
        self.test.compare.iter().find(|allowed| files.contains(&allowed.output))
    }

    /// Every value that some output gives, compared with its golden.
    fn outputs(
        &self,
        graph: &Graph,
        finished: &Finished,
        session: &Session,
        case: &mut Case,
    ) -> Vec<Compared> {
        let mut places: Vec<(usize, usize)> =
            graph.outputs().iter().map(|o| (o.node, o.output)).collect();
        places.sort_unstable();
        places.dedup();
        // A node inside of a use is named by the way to it; its golden is a file beside the others.
        let name_of = |(node, output): (usize, usize)| {
            let (name, outputs) = (&graph.nodes()[node].name, &graph.nodes()[node].outputs);
            let name = match outputs.len() {
                1 => name.clone(),
                _ => format!("{name}.{}", outputs[output]),
            };
            name.replace('/', ".")
        };
        let named: Vec<_> = places.iter().copied().map(name_of).collect();
        let mut compared = Vec::new();
        for (node, output) in places {
            let mine = graph.outputs().iter().filter(|o| (o.node, o.output) == (node, output));
            let mine: Vec<&GraphOutput> = mine.collect();
            let Some(value) = finished.value(&mine[0].name) else { continue };
            let names: Vec<String> = mine.iter().map(|output| output.name.clone()).collect();
            let start = Instant::now();
            let files = self.written(&mine, value, finished, session, &mut case.problems);
            case.file_seconds += start.elapsed().as_secs_f64();
            let tolerance =
                self.allowed(&names).map(|allowed| allowed.tolerance.clone()).unwrap_or_default();
            let name = self.golden_name(name_of((node, output)), &names, &named);
            compared.push(self.compare(name, names, value, &files, &tolerance));
        }
        compared
    }

    /// The name of the golden of some outputs: that of the node which gives them, or of the one that did so when it was accepted, if the
    /// node has another name now.
    /// A golden belongs to outputs: its file has the node's name of the day it was accepted, and after a rename the files that its summary
    /// names identify it.
    fn golden_name(&self, name: String, outputs: &[String], named: &[String]) -> String {
        if !matches!(store::read(&self.folder, &name), Err(NoGolden::Missing)) {
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

    /// The files that a value is written to. This program writes equal values to equal files: what it wrote of one before is
    /// noted on disk, where no other program's notes are, and is not written again.
    fn written(
        &self,
        outputs: &[&GraphOutput],
        value: &AnyValue,
        finished: &Finished,
        session: &Session,
        problems: &mut Vec<Problem>,
    ) -> Vec<Written> {
        let names = outputs.iter().map(|output| format!("/{}", output.name));
        let key = PathBuf::from(format!("written/{}{}", value.hash(), String::from_iter(names)));
        let known = session.note(&key).and_then(|note| Written::read(&note));
        if let Some(known) = known {
            return known;
        }
        let (mut files, mut complete) = (Vec::new(), true);
        for output in outputs {
            match finished.files(&output.name) {
                Some(Ok(written)) => files.extend(written.iter().map(Written::of)),
                Some(Err(error)) => {
                    complete = false;
                    let message = format!("cannot write `{}`: {error}", output.name);
                    problems.push(Problem {
                        source: finished.graph().source().clone(),
                        ..self.test.problem(code::FAILED, output.span, message)
                    });
                }
                None => complete = false,
            }
        }
        if complete {
            session.keep_note(&key, || Written::note(&files));
        }
        files
    }

    fn compare(
        &self,
        name: String,
        names: Vec<String>,
        value: &AnyValue,
        files: &[Written],
        tolerance: &Tolerance,
    ) -> Compared {
        let golden = store::read(&self.folder, &name);
        let comparison = match &golden {
            Ok(golden) => golden.compare(value, files, tolerance),
            Err(NoGolden::Missing) => Comparison::new(
                vec!["there is no golden; look at the result, then bless it".into()],
                Vec::new(),
            ),
            Err(NoGolden::Damaged(why)) => {
                Comparison::new(vec![format!("the golden {why}")], Vec::new())
            }
        };
        let identical = comparison.verdict == Verdict::Identical;
        let mut needed = golden.as_ref().map(Golden::needed).unwrap_or_default();
        if comparison.verdict == Verdict::Within {
            for (name, most) in comparison.measures.iter().filter_map(surely) {
                match needed.iter_mut().find(|(known, _)| *known == name) {
                    Some((_, before)) => *before = before.max(most),
                    None => needed.push((name, most)),
                }
            }
        }
        let outdated = golden.as_ref().ok().and_then(|golden| golden.outdated(tolerance));
        Compared {
            name,
            files: names,
            comparison,
            golden,
            outdated,
            value: value.clone(),
            changed: !identical || outdated.is_some(),
            written: files.to_vec(),
            needed,
            tolerance: tolerance.clone(),
        }
    }

    /// Goldens in the case's folder that no output asks for.
    fn orphans(&self, outputs: &[Compared]) -> Vec<PathBuf> {
        let sources = Sources::default();
        if writing::Destination::own(beside(self.test), &sources)
            .judge_folder(&self.folder)
            .is_err()
        {
            return Vec::new();
        }
        let mut goldens = goldens(&self.folder);
        outputs.iter().for_each(|output| drop(goldens.remove(&output.name)));
        goldens.into_values().flatten().collect()
    }

    /// Tolerances that are much wider than any difference was, now or when a golden was accepted.
    fn wide(&self, outputs: &[Compared]) -> Vec<String> {
        let mut notes = Vec::new();
        for output in outputs {
            let Some(allowed) = self.allowed(&output.files) else { continue };
            let before = output.golden.as_ref().map(Golden::needed).unwrap_or_default();
            let now = output.comparison.measures.iter().filter_map(surely);
            let needed: Vec<(String, f64)> = before.into_iter().chain(now).collect();
            let parts = GoldenParts::of(&output.value).unwrap_or_default();
            for (name, limit) in allowed.tolerance.limits() {
                fn is_of(
                    measure: &str,
                    name: &str,
                    parts: &GoldenParts,
                    allowed_tolerance: &Tolerance,
                ) -> bool {
                    match parts.column(measure) {
                        Some(part) => limit_of(part, allowed_tolerance) == Some(name),
                        None => name == "max" && measure.starts_with("surface,"),
                    }
                }
                let of_limit = needed
                    .iter()
                    .filter(|(measure, _)| is_of(measure, name, &parts, &allowed.tolerance));
                let most = of_limit.map(|(_, needed)| *needed).fold(0.0, f64::max);
                if most > 0.0 && most * TOO_WIDE < limit {
                    let (limit, most) = (six(limit), six(most));
                    notes.push(format!(
                        "{}: the tolerance `{name}` of {limit} is more than ten times wider than ever needed ({most})",
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
                case.problems.push(self.test.problem(code::EXPECTED, span, message));
            }
        }
    }
}
