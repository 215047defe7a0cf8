//! `maquette run`: evaluates a graph and writes its outputs.

use std::fmt::Write as _;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use clap::Args;
use maquette_engine::RequestCounts;
use maquette_engine::eval::{Forecast, Observer, RunTrace, State};
use maquette_engine::session::{OutputFile, OutputReport};
use maquette_engine::writing::Sources;
use maquette_graph::Graph;
use maquette_graph::catalog::Catalog;
use maquette_node::CancelToken;
use maquette_syntax::error::{Diagnostic, Severity, code, merge_diagnostics};
use serde_json::json;

use super::cache_options;
use super::events::{EventFormat, Events, Listener, RunEnd};
use super::openjd::JobProgress;
use super::profile;
use super::progress::Progress;
use super::replay::ProvenanceOptions;
use super::{
    EvaluationOptions, Exit, column_width, eprint, format_count, has_errors, in_bytes, interrupt,
    print, print_json, put_problems, report,
};
use crate::DisplayPath;

#[derive(Args)]
pub(crate) struct Run {
    /// The graph file.
    graph: PathBuf,
    /// The folder for the outputs [default: `out/GRAPH`; with --draft `out/GRAPH-draft`].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Write only this output. May be repeated.
    #[arg(long, value_name = "OUTPUT")]
    only: Vec<String>,
    #[command(flatten)]
    evaluation: EvaluationOptions,
    #[command(flatten)]
    provenance: ProvenanceOptions,
    /// Print which nodes would run, and why; run nothing.
    #[arg(short = 'n', long)]
    dry_run: bool,
    /// The number of threads; 0 for all.
    #[arg(long, default_value_t = 0)]
    threads: usize,
    /// Print the time and memory of each node, and write a trace for Chrome's tracing page beside the outputs.
    #[arg(long)]
    profile: bool,
    /// Print one JSON document.
    #[arg(long)]
    json: bool,
    /// Print events while the command runs: one JSON object per line, or with `openjd` the lines that an agent of Open Job Description
    /// reads.
    #[arg(long, value_name = "FORMAT", conflicts_with = "json", num_args = 0..=1, require_equals = true, default_missing_value = "json")]
    events: Option<EventFormat>,
}

impl Run {
    pub(super) fn run(&self, catalog: &Arc<Catalog>) -> Exit {
        let start = Instant::now();
        let cancel = CancelToken::default();
        interrupt::cancel_on_interrupt(&cancel);
        let events = Events::new(Listener::of_stdout(), cancel.clone());
        let job = JobProgress::new(1, cancel.clone());
        let checked = self.evaluation.graph.load(&self.graph, catalog).without_missing_files();
        let reading_graph = start.elapsed().as_secs_f64();
        let mut diagnostics = checked.diagnostics;
        let Some(graph) = checked.graph.or(checked.partial) else {
            self.print(None, &[], &diagnostics, start);
            return Exit::Failed;
        };
        let mut session = match self.evaluation.cache.session(self.threads, catalog) {
            Ok(session) => session,
            Err(why) => return Exit::Usage(why),
        };
        let fed = match self.dry_run {
            true => self.evaluation.inputs.feed_for_forecast(&session, &graph),
            false => self.evaluation.inputs.feed(&session, &graph),
        };
        let graph = match fed {
            Ok((graph, warnings)) => {
                diagnostics.extend(warnings);
                graph
            }
            Err(wrong) => {
                self.print(None, &[], &wrong, start);
                return Exit::Failed;
            }
        };
        let into = self.evaluation.graph.output_folder(self.out.as_deref(), &self.graph);
        let into = self.provenance.apply_to(into.keeping(self.evaluation.inputs.files()));
        session.recall(&into);
        if self.dry_run {
            let graph = session.with_last_counts(&graph);
            return match session.dry_run(&graph, &self.only, &into) {
                Ok(forecasts) => {
                    report(
                        &diagnostics
                            .iter()
                            .filter(|diagnostic| diagnostic.code == code::MISSING_FILE)
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
            cache_options::finish(&session);
            return Exit::Interrupted;
        }
        diagnostics = merge_diagnostics(diagnostics, produced.diagnostics.clone());
        self.print(Some((&produced, session.exchange())), &produced.written, &diagnostics, start);
        if self.profile {
            let trace = produced.trace();
            // With --json, write all other text to stderr, because stdout contains only the JSON document.
            let tell: fn(&str) = if self.json { eprint } else { print };
            let read =
                profile::ReadTimes { graph: reading_graph, files: produced.seconds_of_files() };
            tell(&profile::profile_table(&trace, &read, &produced.written));
            session
                .exchange()
                .into_iter()
                .for_each(|exchange| tell(&profile::describe_exchange(&exchange)));
            if let Err(error) = profile::write_trace(
                &trace,
                &self.graph,
                into.path(),
                &into.destination(&Sources::of_graph(&graph)),
            ) {
                eprint(&format!("error: cannot write the trace: {error}\n"));
            }
        }
        cache_options::finish(&session);
        // Do not free the memory, which takes time: the process is about to end.
        std::mem::forget((session, produced, graph));
        let failed = has_errors(&diagnostics);
        if failed { Exit::Failed } else { Exit::Done }
    }

    fn print(
        &self,
        produced: Option<(&OutputReport, Option<RequestCounts>)>,
        written: &[OutputFile],
        diagnostics: &[Diagnostic],
        start: Instant,
    ) {
        let trace = produced.map(|(produced, _)| produced.trace()).unwrap_or_default();
        let traces = &trace.0;
        let seconds = start.elapsed().as_secs_f64();
        if self.events == Some(EventFormat::Openjd) {
            report(diagnostics);
            let job = JobProgress::new(1, CancelToken::default());
            match diagnostics.iter().find(|diagnostic| diagnostic.severity == Severity::Error) {
                Some(diagnostic) => job.fail(&diagnostic.message),
                None => job.end_task(),
            }
            return job.status(&format!(
                "{}: {}",
                format_count(traces.len(), "node"),
                counts(&trace)
            ));
        }
        if self.events == Some(EventFormat::Json) {
            let listener = Listener::of_stdout();
            listener.send_problems(diagnostics);
            let trace = produced.map(|_| &trace);
            return listener.send_end(&RunEnd { run: 1, trace, written, diagnostics, seconds });
        }
        if self.json {
            let outputs = written.iter().map(OutputFile::to_json);
            let mut document = json!({
                "nodes": traces.iter().map(|node| node.to_json()).collect::<Vec<_>>(),
                "outputs": outputs.collect::<Vec<_>>(),
                "problems": [],
                "seconds": seconds,
            });
            if let Some((_, Some(exchange))) = produced {
                let RequestCounts { found, missing, damaged, .. } = exchange;
                document["server"] =
                    json!({ "found": found, "missing": missing, "damaged": damaged });
            }
            put_problems(&mut document, diagnostics);
            print_json(&document);
            return;
        }
        report(diagnostics);
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
            let word = if file.unchanged { "unchanged" } else { "wrote    " };
            let (path, bytes) = (file.path.for_display(), in_bytes(file.bytes));
            let _ = writeln!(text, "{word} {path}  {bytes}");
        }
        let _ = match traces.len() {
            0 => writeln!(text, "nothing to do: the graph has no outputs"),
            nodes => {
                let counts = counts(&trace);
                writeln!(text, "{}: {counts}; {seconds:.2} s", format_count(nodes, "node"))
            }
        };
        print(&text);
    }
}

/// Formats the forecast of a run: what would happen to each node, and why.
fn forecast(graph: &Graph, forecasts: &[Forecast]) -> String {
    let names: Vec<_> = forecasts.iter().map(|it| &graph.nodes()[it.index].name).collect();
    let longest = column_width(names.iter().map(|name| name.len()));
    let mut text = String::new();
    for (forecast, name) in forecasts.iter().zip(names) {
        let (word, reason) = (forecast.word(), forecast.reason_in(graph));
        let _ = writeln!(text, "{word:<8}  {:<longest$}  {reason}", name);
    }
    text
}

/// Formats the number of nodes by state, such as `2 computed, 12 cached`.
pub(super) fn counts(trace: &RunTrace) -> String {
    let states = [State::Computed, State::Equal, State::Cached, State::Failed, State::Skipped];
    let counts = states.into_iter().filter_map(|state| match trace.count(state) {
        0 => None,
        count => Some(format!("{count} {}", state.word())),
    });
    Vec::from_iter(counts).join(", ")
}
