//! `maquette run`: evaluates a graph and writes its outputs.

use std::fmt::Write as _;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use clap::Args;
use maquette_engine::Exchange;
use maquette_engine::eval::{Forecast, Observer, RunTrace, State};
use maquette_engine::session::{Produced, Written};
use maquette_engine::writing::Sources;
use maquette_graph::Graph;
use maquette_graph::catalog::Catalog;
use maquette_node::CancelToken;
use maquette_syntax::error::{Problem, Severity, code, with_those_of_run};
use serde_json::json;

use super::caching::{self, CacheOptions};
use super::events::{Ending, EventFormat, Events, Listener};
use super::inputs::InputOptions;
use super::openjd::JobProgress;
use super::profile;
use super::progress::Progress;
use super::replay::ProvenanceOptions;
use super::{
    Exit, GraphOptions, column_width, counted, eprint, in_bytes, interrupt, print, print_json,
    put_problems, report,
};
use crate::Shown;

#[derive(Args)]
pub(crate) struct Run {
    /// The graph file.
    graph: PathBuf,
    /// The folder for the outputs; `out/GRAPH` if left out, `out/GRAPH-draft` with --draft.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Write only this output; may be given several times.
    #[arg(long, value_name = "OUTPUT")]
    only: Vec<String>,
    #[command(flatten)]
    inputs: InputOptions,
    #[command(flatten)]
    options: GraphOptions,
    #[command(flatten)]
    cache: CacheOptions,
    #[command(flatten)]
    provenance: ProvenanceOptions,
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
    /// Print what happens as it happens: one JSON object a line, or, by `openjd`, lines for an agent of Open Job Description.
    #[arg(long, value_name = "FORMAT", conflicts_with = "json", num_args = 0..=1, require_equals = true, default_missing_value = "json")]
    events: Option<EventFormat>,
}

impl Run {
    pub(super) fn run(&self, catalog: &Arc<Catalog>) -> Exit {
        let start = Instant::now();
        let cancel = CancelToken::default();
        interrupt::cancels(&cancel);
        let events = Events::new(Listener::of_stdout(), cancel.clone());
        let job = JobProgress::new(1, cancel.clone());
        let checked = self.options.load(&self.graph, catalog).without_missing_files();
        let reading_graph = start.elapsed().as_secs_f64();
        let mut problems = checked.problems;
        let Some(graph) = checked.graph.or(checked.partial) else {
            self.print(None, &[], &problems, start);
            return Exit::Failed;
        };
        let mut session = match self.cache.session(self.threads, catalog) {
            Ok(session) => session,
            Err(why) => return Exit::Usage(why),
        };
        let fed = match self.dry_run {
            true => self.inputs.foreseen(&session, &graph),
            false => self.inputs.fed(&session, &graph),
        };
        let graph = match fed {
            Ok((graph, warnings)) => {
                problems.extend(warnings);
                graph
            }
            Err(wrong) => {
                self.print(None, &[], &wrong, start);
                return Exit::Failed;
            }
        };
        let into = self.options.folder(self.out.as_deref(), &self.graph);
        let into = self.provenance.applied(into.keeping(self.inputs.files()));
        session.recall(&into);
        if self.dry_run {
            let graph = session.as_last_known(&graph);
            return match session.dry_run(&graph, &self.only, &into) {
                Ok(forecasts) => {
                    report(
                        &problems
                            .iter()
                            .filter(|problem| problem.code == code::MISSING_FILE)
                            .cloned()
                            .collect::<Vec<_>>(),
                    );
                    print(&forecast(&graph, &forecasts));
                    if forecasts.iter().any(|it| {
                        graph.nodes()[it.index].files.iter().any(|file| file.missing.is_some())
                    }) {
                        Exit::Failed
                    } else {
                        Exit::Done
                    }
                }
                Err(why) => Exit::Usage(why),
            };
        }
        let progress = Progress::new(graph.nodes().len());
        let observer: &dyn Observer = match self.events {
            Some(EventFormat::Json) => &events,
            Some(EventFormat::Openjd) => &job,
            None => &progress,
        };
        let produced = session.produce(&graph, &self.only, &into, observer, &cancel);
        progress.end();
        let produced = match produced {
            Ok(produced) => produced,
            Err(why) => return Exit::Usage(why),
        };
        if cancel.is_cancelled() {
            caching::finish(&session);
            return Exit::Interrupted;
        }
        problems = with_those_of_run(problems, produced.problems.clone());
        self.print(Some((&produced, session.exchange())), &produced.written, &problems, start);
        if self.profile {
            let trace = produced.trace();
            // With --json, stdout is for one document.
            let tell: fn(&str) = if self.json { eprint } else { print };
            let read = profile::Read { graph: reading_graph, files: produced.seconds_of_files() };
            tell(&profile::table(&trace, &read, &produced.written));
            session.exchange().into_iter().for_each(|exchange| tell(&profile::exchange(&exchange)));
            if let Err(error) = profile::write_trace(
                &trace,
                &self.graph,
                into.path(),
                &into.destination(&Sources::of(&graph)),
            ) {
                eprint(&format!("error: cannot write the trace: {error}\n"));
            }
        }
        caching::finish(&session);
        // The process ends here; giving the memory back piece by piece would only take time.
        std::mem::forget((session, produced, graph));
        let failed = problems.iter().any(|problem| problem.severity == Severity::Error);
        if failed { Exit::Failed } else { Exit::Done }
    }

    fn print(
        &self,
        produced: Option<(&Produced, Option<Exchange>)>,
        written: &[Written],
        problems: &[Problem],
        start: Instant,
    ) {
        let trace = produced.map(|(produced, _)| produced.trace()).unwrap_or_default();
        let traces = &trace.0;
        let seconds = start.elapsed().as_secs_f64();
        if self.events == Some(EventFormat::Openjd) {
            report(problems);
            let job = JobProgress::new(1, CancelToken::default());
            match problems.iter().find(|problem| problem.severity == Severity::Error) {
                Some(problem) => job.fail(&problem.message),
                None => job.task_ended(),
            }
            return job.status(&format!("{}: {}", counted(traces.len(), "node"), counts(&trace)));
        }
        if self.events == Some(EventFormat::Json) {
            let listener = Listener::of_stdout();
            listener.tell_problems(problems);
            let trace = produced.map(|_| &trace);
            return listener.tell_end(&Ending { run: 1, trace, written, problems, seconds });
        }
        if self.json {
            let outputs = written.iter().map(Written::to_json);
            let mut document = json!({
                "nodes": traces.iter().map(|node| node.to_json()).collect::<Vec<_>>(),
                "outputs": outputs.collect::<Vec<_>>(),
                "problems": [],
                "seconds": seconds,
            });
            if let Some((_, Some(exchange))) = produced {
                let Exchange { found, missing, damaged, .. } = exchange;
                document["server"] =
                    json!({ "found": found, "missing": missing, "damaged": damaged });
            }
            put_problems(&mut document, problems);
            print_json(&document);
            return;
        }
        report(problems);
        if produced.is_none() {
            return;
        }
        let mut text = String::new();
        let longest = column_width(traces.iter().map(|node| node.name.len()));
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
            let (path, bytes) = (file.path.shown(), in_bytes(file.bytes));
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
    let name = |forecast: &Forecast| &graph.nodes()[forecast.index].name;
    let longest = column_width(forecasts.iter().map(|forecast| name(forecast).len()));
    let mut text = String::new();
    for forecast in forecasts {
        let (word, reason) = (forecast.word(), forecast.reason_in(graph));
        let _ = writeln!(text, "{word:<8}  {:<longest$}  {reason}", name(forecast));
    }
    text
}

/// `2 computed, 12 cached`.
pub(super) fn counts(trace: &RunTrace) -> String {
    let states = [State::Computed, State::Equal, State::Cached, State::Failed, State::Skipped];
    let counts = states.into_iter().filter_map(|state| match trace.count(state) {
        0 => None,
        count => Some(format!("{count} {}", state.word())),
    });
    Vec::from_iter(counts).join(", ")
}
