//! The thread that evaluates while the watch listens.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::{Sender, channel};
use std::time::Instant;

use crate::cli::outputs::{Outputs, Written};
use crate::cli::run::wanted;
use crate::error::{Problem, Severity, Span, code};
use crate::eval::{Disk, Evaluator, Observer, Trace, in_words};
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
    /// The folder of the outputs, if a file could not be written.
    pub(super) unwritten: Option<PathBuf>,
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
        outputs: Outputs,
        only: Vec<String>,
        observe: Observe,
        sink: impl Fn(Report) + Send + 'static,
    ) -> Self {
        outputs.recall(&evaluator);
        let (jobs, receiver) = channel::<Job>();
        std::thread::spawn(move || {
            for job in receiver {
                if job.recompute {
                    evaluator.forget();
                }
                let report = catch_unwind(AssertUnwindSafe(|| {
                    let observer = observe(&job.cancel);
                    evaluate(&job, &mut evaluator, memory, &outputs, &only, &*observer)
                }));
                sink(report.unwrap_or_else(|panic| {
                    // What it was about to remember may be half of something.
                    evaluator.forget();
                    panicked(&job, &in_words(&*panic))
                }));
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
    let not_writable = (!unwritten.is_empty()).then(|| outputs.folder().to_owned());
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
        unwritten: not_writable,
        seconds: start.elapsed().as_secs_f64(),
    }
}

/// The report of a run that a fault of the engine ended.
fn panicked(job: &Job, words: &str) -> Report {
    let message = format!("the evaluation panicked: {words}");
    let mut problem = about_graph(&job.graph, Severity::Error, code::PANIC, message);
    problem.help =
        "this is a bug; please report it with the graph. The next run starts anew".into();
    Report {
        run: job.run,
        cancelled: false,
        trace: Trace::default(),
        problems: vec![problem],
        written: Vec::new(),
        unwritten: None,
        seconds: 0.0,
    }
}

/// A problem that has no place in the graph's text.
fn about_graph(graph: &Graph, severity: Severity, code: &'static str, message: String) -> Problem {
    let (source, span) = (graph.source.clone(), Span::default());
    let (help, note, uses) = (String::new(), None, Vec::new());
    Problem { severity, code, source, span, message, help, note, uses }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::catalog::Catalog;
    use crate::graph::Options;

    #[test]
    fn a_panic_in_a_run_ends_it_with_a_message_and_the_next_run_works() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("graph.ron");
        std::fs::write(&path, "Graph(format: 1, nodes: {}, outputs: {})").unwrap();
        let graph = Graph::load(&path, &Catalog::new(&[]), &Options::default()).graph.unwrap();
        let graph = Arc::new(graph);
        let first = std::sync::atomic::AtomicBool::new(true);
        let observe: Observe = Box::new(move |_| {
            assert!(!first.swap(false, std::sync::atomic::Ordering::Relaxed), "out of order");
            Box::new(())
        });
        let (sender, reports) = channel();
        let evaluator = Evaluator::new(1, 0).unwrap();
        let outputs = Outputs::new(Some(&folder.path().join("out")), &path);
        let sink = move |report| drop(sender.send(report));
        let worker = Worker::new(evaluator, 0, outputs, Vec::new(), observe, sink);
        let messages = [1, 2].map(|run| {
            let (graph, problems, cancel) = (graph.clone(), Vec::new(), CancelToken::default());
            worker.start(Job { run, graph, problems, cancel, recompute: false });
            let report: Report = reports.recv().unwrap();
            Vec::from_iter(report.problems.into_iter().map(|problem| problem.message))
        });
        assert_eq!(messages, [vec!["the evaluation panicked: out of order".to_owned()], vec![]]);
    }
}
