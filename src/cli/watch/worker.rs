//! The thread that evaluates while the watch listens.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::{Sender, channel};
use std::time::Instant;

use crate::cli::outputs::{Outputs, Written};
use crate::cli::run::wanted;
use crate::error::{Problem, Severity, Span, code};
use crate::eval::{Disk, Evaluator, Observer, Trace};
use crate::golden;
use crate::graph::Graph;
use crate::node::CancelToken;

/// Results of several runs are kept, so that a change that is taken back costs nothing; but no more than this many times what
/// one run needs, so that a day of changes does not fill the memory.
const RUNS_KEPT: usize = 4;

/// Small graphs keep this many bytes of results in any case.
const KEPT: usize = 192 << 20;

/// What is to be evaluated.
pub(super) struct Job {
    pub(super) run: usize,
    pub(super) graph: Arc<Graph>,
    /// What the check has doubts about.
    pub(super) problems: Vec<Problem>,
    pub(super) cancel: CancelToken,
    /// Whether to compute everything, whatever is known.
    pub(super) recompute: bool,
}

/// What became of a job.
pub(super) struct Report {
    pub(super) run: usize,
    /// It was stopped; the rest says nothing then.
    pub(super) cancelled: bool,
    pub(super) trace: Trace,
    pub(super) problems: Vec<Problem>,
    pub(super) written: Vec<Written>,
    pub(super) seconds: f64,
}

/// Makes what follows the evaluation that a token stops.
pub(super) type Observe = Box<dyn Fn(&CancelToken) -> Box<dyn Observer> + Send>;

/// Evaluates one job after the other, always with the same evaluator, whose cache knows what is still valid.
pub(super) struct Worker {
    jobs: Sender<Job>,
}

impl Worker {
    pub(super) fn new(
        mut evaluator: Evaluator,
        memory: usize,
        folder: PathBuf,
        only: Vec<String>,
        observe: Observe,
        sink: impl Fn(Report) + Send + 'static,
    ) -> Self {
        let outputs = Outputs::new(folder);
        outputs.recall(&evaluator);
        let (jobs, receiver) = channel::<Job>();
        std::thread::spawn(move || {
            for job in receiver {
                if job.recompute {
                    evaluator.forget();
                }
                let observer = observe(&job.cancel);
                sink(evaluate(&job, &mut evaluator, memory, &outputs, &only, &*observer));
            }
            // The process ends here; giving the memory back piece by piece would only take time.
            std::mem::forget(evaluator);
        });
        Self { jobs }
    }

    pub(super) fn start(&self, job: Job) {
        // The thread lives as long as this.
        let _ = self.jobs.send(job);
    }
}

fn evaluate(
    job: &Job,
    evaluator: &mut Evaluator,
    memory: usize,
    outputs: &Outputs,
    only: &[String],
    observer: &dyn Observer,
) -> Report {
    let start = Instant::now();
    let graph = &*job.graph;
    let mut problems = job.problems.clone();
    let wanted = wanted(graph, only).unwrap_or_else(|why| {
        problems.push(about_graph(graph, Severity::Error, code::UNKNOWN_LINK, why));
        Vec::new()
    });
    let mut nodes: Vec<usize> = wanted.iter().map(|output| output.node).collect();
    let expectations = graph.expectations();
    let judged = golden::nodes_of(graph, &expectations);
    nodes.extend(&judged);
    evaluator.set_memory(memory);
    let mut values = outputs.nodes_to_write(&wanted, graph, evaluator);
    values.extend(judged);
    let evaluation = evaluator.evaluate(graph, &nodes, &values, observer, &job.cancel);
    let (written, unwritten) = outputs.write(&wanted, &evaluation, graph, evaluator, &job.cancel);
    outputs.keep(evaluator);
    problems.extend(evaluation.problems());
    let violations = golden::violations(graph, &evaluation, &expectations);
    problems.extend(violations.into_iter().map(|violation| violation.problem));
    let trace = evaluation.trace();
    problems.extend(unwritten);
    if let Some(trouble) = evaluator.disk().and_then(Disk::trouble) {
        let message = format!("results are not kept for the next run: {trouble}");
        problems.push(about_graph(graph, Severity::Warning, code::WARNING, message));
    }
    let cancelled = job.cancel.is_cancelled();
    if !cancelled {
        let bytes: usize = trace.0.iter().map(|node| node.bytes).sum();
        evaluator.set_memory(bytes.saturating_mul(RUNS_KEPT).max(KEPT).min(memory));
    }
    Report {
        run: job.run,
        cancelled,
        trace,
        problems,
        written,
        seconds: start.elapsed().as_secs_f64(),
    }
}

/// A problem that has no place in the graph's text.
fn about_graph(graph: &Graph, severity: Severity, code: &'static str, message: String) -> Problem {
    let (source, span) = (graph.source.clone(), Span::default());
    let (help, note, uses) = (String::new(), None, Vec::new());
    Problem { severity, code, source, span, message, help, note, uses }
}
