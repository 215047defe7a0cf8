//! `maquette run`: evaluates a graph and writes its outputs.

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use rayon::prelude::*;
use serde_json::json;

use super::caching::{self, CacheOptions};
use super::profile;
use super::progress::Progress;
use super::why::reason_with_place;
use super::{Exit, GraphOptions, counted, eprint, in_bytes, print, print_json, report};
use crate::catalog::Catalog;
use crate::error::{Problem, Severity, code};
use crate::eval::{Evaluation, Forecast, State};
use crate::graph::{Graph, GraphOutput, nearest};
use crate::node::CancelToken;
use crate::value::Hash;

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
}

/// A file that has been written.
struct Written {
    output: String,
    path: PathBuf,
    bytes: usize,
    hash: Hash,
}

impl Run {
    pub(super) fn run(&self, catalog: &Catalog) -> Exit {
        let start = Instant::now();
        let checked = self.options.load(&self.graph, catalog);
        let mut problems = checked.problems;
        let Some(graph) = checked.graph else {
            self.print(None, &[], &problems, start);
            return Exit::Failed;
        };
        let outputs = match self.wanted(&graph) {
            Ok(outputs) => outputs,
            Err(why) => return Exit::Usage(why),
        };
        let mut evaluator = match self.cache.evaluator(self.threads, catalog) {
            Ok(evaluator) => evaluator,
            Err(why) => return Exit::Usage(why),
        };
        let nodes: Vec<usize> = outputs.iter().map(|output| output.node).collect();
        if self.dry_run {
            print(&forecast(&graph, &evaluator.forecast(&graph, &nodes)));
            return Exit::Done;
        }
        let progress = Progress::new(graph.nodes.len());
        let evaluation = evaluator.evaluate(&graph, &nodes, &progress, &CancelToken::default());
        let folder = self.out.clone().unwrap_or_else(|| default_folder(&self.graph));
        let write = |output: &&GraphOutput| write_output(output, &evaluation, &graph, &folder);
        let written: Vec<_> = evaluator.install(|| outputs.par_iter().map(write).collect());
        progress.end();
        problems.extend(evaluation.problems());
        let mut files = Vec::new();
        for result in written {
            match result {
                Ok(written) => files.extend(written),
                Err(problem) => problems.push(*problem),
            }
        }
        self.print(Some(&evaluation), &files, &problems, start);
        if self.profile {
            let trace = evaluation.trace();
            // With --json, stdout is for one document.
            let tell: fn(&str) = if self.json { eprint } else { print };
            tell(&profile::table(&trace));
            if let Err(error) = profile::write_trace(&trace, &self.graph, &folder) {
                eprint(&format!("error: cannot write the trace: {error}\n"));
            }
        }
        caching::finish(&evaluator);
        // The process ends here; giving the memory back piece by piece would only take time.
        std::mem::forget((evaluator, evaluation, graph));
        let failed = problems.iter().any(|problem| problem.severity == Severity::Error);
        if failed { Exit::Failed } else { Exit::Done }
    }

    fn wanted<'g>(&self, graph: &'g Graph) -> Result<Vec<&'g GraphOutput>, String> {
        if self.only.is_empty() {
            return Ok(graph.outputs.iter().collect());
        }
        let find = |name: &String| {
            let found = graph.outputs.iter().find(|output| output.name == *name);
            found.ok_or_else(|| {
                format!("the graph has no output `{name}`; {}", nearest(name, graph.output_names()))
            })
        };
        self.only.iter().map(find).collect()
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
        if self.json {
            let outputs = written.iter().map(|file| {
                json!({
                    "name": file.output,
                    "path": file.path.display().to_string(),
                    "bytes": file.bytes,
                    "hash": file.hash.to_string(),
                })
            });
            print_json(&json!({
                "nodes": traces.iter().map(|node| node.to_json()).collect::<Vec<_>>(),
                "outputs": outputs.collect::<Vec<_>>(),
                "problems": problems.iter().map(Problem::to_json).collect::<Vec<_>>(),
                "seconds": seconds,
            }));
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
            let _ = writeln!(text, "wrote     {}  {}", file.path.display(), in_bytes(file.bytes));
        }
        let states = [State::Computed, State::Equal, State::Cached, State::Failed, State::Skipped];
        let counts = states.into_iter().filter_map(|state| match trace.count(state) {
            0 => None,
            count => Some(format!("{count} {}", state.word())),
        });
        let counts = Vec::from_iter(counts).join(", ");
        let _ = writeln!(text, "{}: {counts}; {seconds:.2} s", counted(traces.len(), "node"));
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

/// `out/doll` for `graphs/doll.ron`.
fn default_folder(graph: &Path) -> PathBuf {
    Path::new("out").join(graph.file_stem().unwrap_or_default())
}

/// Writes the files of an output; nothing if its node failed, which has been reported.
fn write_output(
    output: &GraphOutput,
    evaluation: &Evaluation,
    graph: &Graph,
    folder: &Path,
) -> Result<Vec<Written>, Box<Problem>> {
    let problem = |message: String, help: &str| {
        Box::new(Problem {
            severity: Severity::Error,
            code: code::FAILED,
            source: graph.source.clone(),
            span: output.span,
            message,
            help: help.into(),
            note: None,
        })
    };
    let files = match evaluation.files(output) {
        None => return Ok(Vec::new()),
        Some(Ok(files)) => files,
        Some(Err(error)) => {
            return Err(problem(format!("cannot write `{}`: {error}", output.name), ""));
        }
    };
    let folder = folder.join(Path::new(&output.name).parent().unwrap_or(Path::new("")));
    let mut written = Vec::new();
    for file in files {
        let path = folder.join(&file.name);
        write_whole(&path, &file.bytes).map_err(|error| {
            let help = "the file that was there before is untouched; --out chooses another folder";
            problem(format!("cannot write {}: {error}", path.display()), help)
        })?;
        written.push(Written {
            output: output.name.clone(),
            path,
            bytes: file.bytes.len(),
            hash: Hash::of(&file.bytes),
        });
    }
    Ok(written)
}

/// Writes a file beside its place and moves it there: it appears whole or not at all.
pub(super) fn write_whole(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    let folder = folder.unwrap_or(Path::new("."));
    std::fs::create_dir_all(folder)?;
    let mut builder = tempfile::Builder::new();
    builder.prefix(".maquette-");
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // What the user's umask leaves of it, as for any new file.
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    let mut file = builder.tempfile_in(folder)?;
    file.write_all(bytes)?;
    file.persist(path).map_err(|error| error.error)?;
    Ok(())
}
