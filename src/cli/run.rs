//! `maquette run`: evaluates a graph and writes its outputs.

use std::fmt::Write as _;
use std::path::PathBuf;
use std::time::Instant;

use clap::Args;
use serde_json::json;

use super::caching::{self, CacheOptions};
use super::events::{self, Ending, Events};
use super::outputs::{Outputs, Written};
use super::profile;
use super::progress::Progress;
use super::why::reason_with_place;
use super::{
    Exit, GraphOptions, counted, eprint, in_bytes, interrupt, print, print_json, put_problems,
    report,
};
use crate::catalog::Catalog;
use crate::error::{Problem, Severity};
use crate::eval::{Evaluation, Forecast, Observer, State, Trace};
use crate::golden;
use crate::graph::{Graph, GraphOutput};
use crate::node::CancelToken;
use crate::text::unknown;
use crate::writing::Sources;

#[derive(Args)]
pub(super) struct Run {
    /// The graph file.
    graph: PathBuf,
    /// The folder for the outputs; `out/GRAPH` if left out.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Write only this output; may be given several times.
    #[arg(long, value_name = "OUTPUT")]
    only: Vec<String>,
    #[command(flatten)]
    options: GraphOptions,
    #[command(flatten)]
    cache: CacheOptions,
    /// Only say what would run, and why.
    #[arg(short = 'n', long)]
    dry_run: bool,
    /// How many threads to use; 0 is all.
    #[arg(long, default_value_t = 0)]
    threads: usize,
    /// Print where the time and the memory went, and write a trace for Chrome's tracing page beside the outputs.
    #[arg(long)]
    profile: bool,
    /// Print one JSON document.
    #[arg(long)]
    json: bool,
    /// Print what happens as it happens, one JSON object a line.
    #[arg(long, conflicts_with = "json")]
    events: bool,
}

impl Run {
    pub(super) fn run(&self, catalog: &Catalog) -> Exit {
        let start = Instant::now();
        let cancel = CancelToken::default();
        interrupt::cancels(&cancel);
        let events = self.events.then(|| Events::new(cancel.clone()));
        let checked = self.options.load(&self.graph, catalog);
        let reading_graph = start.elapsed().as_secs_f64();
        let mut problems = checked.problems;
        let Some(graph) = checked.graph else {
            self.print(None, &[], &problems, start);
            return Exit::Failed;
        };
        let outputs = match wanted(&graph, &self.only) {
            Ok(outputs) => outputs,
            Err(why) => return Exit::Usage(why),
        };
        let mut evaluator = match self.cache.evaluator(self.threads, catalog) {
            Ok(evaluator) => evaluator,
            Err(why) => return Exit::Usage(why),
        };
        let mut nodes: Vec<usize> = outputs.iter().map(|output| output.node).collect();
        let expectations = graph.expectations();
        let judged = golden::nodes_of(&graph, &expectations);
        nodes.extend(&judged);
        if self.dry_run {
            print(&forecast(&graph, &evaluator.forecast(&graph, &nodes)));
            return Exit::Done;
        }
        let progress = Progress::new(graph.nodes.len());
        let observer: &dyn Observer = events.as_ref().map_or(&progress, |events| events);
        let into = Outputs::new(self.out.as_deref(), &self.graph);
        into.recall(&evaluator);
        let mut values = into.nodes_to_write(&outputs, &graph, &mut evaluator);
        values.extend(judged);
        let evaluation = evaluator.evaluate(&graph, &nodes, &values, observer, &cancel);
        let (files, unwritten) = into.write(&outputs, &evaluation, &graph, &evaluator, &cancel);
        into.keep(&evaluator);
        progress.end();
        if cancel.is_cancelled() {
            caching::finish(&evaluator);
            return Exit::Interrupted;
        }
        problems.extend(evaluation.problems());
        let violations = golden::violations(&graph, &evaluation, &expectations);
        problems.extend(violations.into_iter().map(|violation| violation.problem));
        problems.extend(unwritten);
        self.print(Some(&evaluation), &files, &problems, start);
        if self.profile {
            let trace = evaluation.trace();
            // With --json, stdout is for one document.
            let tell: fn(&str) = if self.json { eprint } else { print };
            let read = profile::Read { graph: reading_graph, files: evaluation.seconds_of_files() };
            tell(&profile::table(&trace, &read, &files));
            if let Err(error) = profile::write_trace(
                &trace,
                &self.graph,
                into.folder(),
                &into.place(&Sources::of(&graph)),
            ) {
                eprint(&format!("error: cannot write the trace: {error}\n"));
            }
        }
        caching::finish(&evaluator);
        // The process ends here; giving the memory back piece by piece would only take time.
        std::mem::forget((evaluator, evaluation, graph));
        let failed = problems.iter().any(|problem| problem.severity == Severity::Error);
        if failed { Exit::Failed } else { Exit::Done }
    }

    fn print(
        &self,
        evaluation: Option<&Evaluation>,
        written: &[Written],
        problems: &[Problem],
        start: Instant,
    ) {
        let trace = evaluation.map(Evaluation::trace).unwrap_or_default();
        let traces = &trace.0;
        let seconds = start.elapsed().as_secs_f64();
        if self.events {
            events::problems(problems);
            let trace = evaluation.map(|_| &trace);
            return events::end(&Ending { run: 1, trace, written, problems, seconds });
        }
        if self.json {
            let outputs = written.iter().map(Written::to_json);
            let mut document = json!({
                "nodes": traces.iter().map(|node| node.to_json()).collect::<Vec<_>>(),
                "outputs": outputs.collect::<Vec<_>>(),
                "problems": [],
                "seconds": seconds,
            });
            put_problems(&mut document, problems);
            print_json(&document);
            return;
        }
        report(problems);
        if evaluation.is_none() {
            return;
        }
        let mut text = String::new();
        let longest = traces.iter().map(|node| node.name.len()).max().unwrap_or(0);
        for node in traces {
            let time = match node.state {
                State::Computed => format!("{:8.1} ms", node.seconds * 1e3),
                _ => String::new(),
            };
            let _ = writeln!(
                text,
                "{:<8}  {:<longest$}  {:<14}{time}",
                node.state.word(),
                node.name,
                node.node
            );
        }
        for file in written {
            let word = if file.unchanged { "as it was" } else { "wrote    " };
            let (path, bytes) = (file.path.display(), in_bytes(file.bytes));
            let _ = writeln!(text, "{word} {path}  {bytes}");
        }
        let _ = match traces.len() {
            0 => writeln!(text, "nothing to do: the graph has no outputs"),
            nodes => {
                let counts = counts(&trace);
                writeln!(text, "{}: {counts}; {seconds:.2} s", counted(nodes, "node"))
            }
        };
        print(&text);
    }
}

/// What each node would do, and why.
fn forecast(graph: &Graph, forecasts: &[Forecast]) -> String {
    let name = |forecast: &Forecast| &graph.nodes[forecast.index].name;
    let longest = forecasts.iter().map(|forecast| name(forecast).len()).max().unwrap_or(0);
    let mut text = String::new();
    for forecast in forecasts {
        let (word, reason) = (forecast.word(), reason_with_place(graph, forecast));
        let _ = writeln!(text, "{word:<8}  {:<longest$}  {reason}", name(forecast));
    }
    text
}

/// The outputs of these names; all if there are none.
pub(super) fn wanted<'g>(
    graph: &'g Graph,
    only: &[String],
) -> Result<Vec<&'g GraphOutput>, String> {
    if only.is_empty() {
        return Ok(graph.outputs.iter().collect());
    }
    let find = |name: &String| {
        let found = graph.outputs.iter().find(|output| output.name == *name);
        found.ok_or_else(|| {
            let known = Vec::from_iter(graph.output_names());
            unknown(format!("the graph has no output `{name}`"), name, "its outputs", &known)
        })
    };
    only.iter().map(find).collect()
}

/// `2 computed, 12 cached`.
pub(super) fn counts(trace: &Trace) -> String {
    let states = [State::Computed, State::Equal, State::Cached, State::Failed, State::Skipped];
    let counts = states.into_iter().filter_map(|state| match trace.count(state) {
        0 => None,
        count => Some(format!("{count} {}", state.word())),
    });
    Vec::from_iter(counts).join(", ")
}
