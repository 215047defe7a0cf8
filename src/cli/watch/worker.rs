//! The thread that evaluates graphs, while the main thread of the watch handles messages.
//!
//! The thread has one session for the whole watch. Its cached results never become invalid, because their keys cover all inputs.

use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::mpsc::{Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use maquette_engine::eval::{Observer, RunTrace};
use maquette_engine::session::{OutputFile, OutputFolder, Run, RunResult, Session, Targets};
use maquette_graph::Graph;
use maquette_node::CancelToken;
use maquette_preview::{ViewedOutput, ViewedValue, Views};
use maquette_render::picture_layer;
use maquette_syntax::error::{Diagnostic, code, merge_diagnostics, panic_message};
use maquette_value::AnyValue;

use crate::has_errors;
use crate::inputs::InputOptions;
use crate::viewpoint::ValueSource;

/// The number of runs whose results fit into the memory for results. With this number, undoing a recent change needs no computation, and
/// the results of a day of changes do not fill the memory.
const KEPT_RUNS: usize = 4;

/// The limit on the memory for results is never set below this number of bytes, unless the user has given a smaller limit.
const MIN_KEPT_BYTES: usize = 192 << 20;

/// An evaluation that the watch requests.
pub(super) struct Job {
    pub(super) run: usize,
    pub(super) graph: Arc<Graph>,
    /// The warnings from checking the graph.
    pub(super) diagnostics: Vec<Diagnostic>,
    pub(super) cancel: CancelToken,
    /// True if all nodes are computed and no cached results are used.
    pub(super) recompute: bool,
    pub(super) purpose: Purpose,
    /// The outputs whose values live pages show.
    pub(super) views: Views,
}

/// The purpose of a job.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Purpose {
    /// Write the outputs, and evaluate the values for live pages.
    Outputs,
    /// Evaluate only the values for live pages.
    View,
    /// Evaluate the values for live pages with parameters that differ from those in the graph file. Nothing is stored on disk.
    Drag,
}

/// The result of a job.
#[derive(Clone)]
pub(super) struct Report {
    pub(super) run: usize,
    /// True if the job was cancelled. Then the other fields of the report must be ignored.
    pub(super) cancelled: bool,
    pub(super) trace: RunTrace,
    pub(super) diagnostics: Vec<Diagnostic>,
    pub(super) written: Vec<OutputFile>,
    /// The folder of the outputs if a file in it could not be written, otherwise `None`.
    pub(super) unwritten: Option<PathBuf>,
    pub(super) seconds: f64,
    /// The purpose of the job. Unless the purpose is `Outputs`, only the diagnostics of the report are meaningful.
    pub(super) purpose: Purpose,
}

/// The values for live pages. They are sent before files are written, so that the user sees them sooner.
pub(super) struct ViewUpdate {
    pub(super) run: usize,
    /// The graph with the elements of each `ForEach` over data. `None` if the graph has no `ForEach` over data.
    pub(super) graph: Option<Arc<Graph>>,
    pub(super) values: ViewedValues,
}

/// An event of a job. First come the values for live pages, and at the end the result.
pub(super) enum WorkerEvent {
    View(ViewUpdate),
    Report(Report),
}

/// The values that live pages show, prepared for display.
pub(super) type ViewedValues = BTreeMap<ViewedOutput, Arc<ViewedValue>>;

/// The options for outputs. They are the same for all runs of a watch.
pub(super) struct OutputOptions {
    pub(super) folder: OutputFolder,
    /// The names of the outputs to write. An empty list stands for all outputs.
    pub(super) only: Vec<String>,
    pub(super) inputs: InputOptions,
}

/// A function that creates an observer for each evaluation. Its argument is the token that cancels the evaluation.
pub(super) type ObserverFactory = Box<dyn Fn(&CancelToken) -> Box<dyn Observer> + Send>;

/// The time from which outputs may be written; `None` if they may be written at once.
#[derive(Default)]
pub(super) struct WriteDelay(Mutex<Option<Instant>>);

impl WriteDelay {
    /// The interval at which an evaluation that waits to write outputs checks if it was cancelled.
    const CHECK_INTERVAL: Duration = Duration::from_millis(10);

    pub(super) fn set(&self, until: Option<Instant>) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = until;
    }

    /// Waits until outputs may be written, or until the evaluation is cancelled.
    fn wait(&self, cancel: &CancelToken) {
        while !cancel.is_cancelled() {
            let until = *self.0.lock().unwrap_or_else(PoisonError::into_inner);
            let now = Instant::now();
            match until {
                Some(until) if now < until => {
                    std::thread::sleep(Self::CHECK_INTERVAL.min(until - now));
                }
                _ => return,
            }
        }
    }
}

/// Runs jobs one after the other in a single session, so that each can use the cached results of earlier ones.
pub(super) struct Worker {
    jobs: Sender<Job>,
    output_options: Arc<OutputOptions>,
    pub(super) write_delay: Arc<WriteDelay>,
}

impl Worker {
    pub(super) fn new(
        mut session: Session,
        wishes: OutputOptions,
        observe: ObserverFactory,
        sink: impl Fn(WorkerEvent) + Send + 'static,
    ) -> Self {
        session.recall(&wishes.folder);
        let wishes = Arc::new(wishes);
        let (jobs, receiver) = channel::<Job>();
        let hold = Arc::<WriteDelay>::default();
        let (of_all, until) = (wishes.clone(), hold.clone());
        std::thread::spawn(move || {
            let mut last = ViewedValues::new();
            let mut kept_bytes = session.memory();
            for job in receiver {
                if job.recompute {
                    session.forget();
                }
                let report = catch_unwind(AssertUnwindSafe(|| {
                    let observer = observe(&job.cancel);
                    let hooks = JobHooks {
                        send_view: &|view| sink(WorkerEvent::View(view)),
                        wait: &|| until.wait(&job.cancel),
                    };
                    evaluate(
                        &job,
                        &mut session,
                        &mut kept_bytes,
                        &of_all,
                        &*observer,
                        &mut last,
                        &hooks,
                    )
                }));
                sink(WorkerEvent::Report(report.unwrap_or_else(|panic| {
                    // Drop all results, because after a panic some may be incomplete.
                    session.forget();
                    panic_report(&job, &panic_message(&*panic))
                })));
            }
            // Do not free the memory, which takes time: the process is about to end.
            std::mem::forget(session);
        });
        Self { jobs, output_options: wishes, write_delay: hold }
    }

    pub(super) fn start(&self, job: Job) {
        // Sending cannot fail, because the thread runs until the sender is dropped.
        let _ = self.jobs.send(job);
    }
}

/// Removes old versions of large output files, which were kept to make later writes faster. The worker thread cannot remove them, because
/// the process ends first.
impl Drop for Worker {
    fn drop(&mut self) {
        self.output_options.folder.drop_recycled_files();
    }
}

/// Functions that a job calls before it writes outputs.
struct JobHooks<'a> {
    /// Sends values to live pages.
    send_view: &'a dyn Fn(ViewUpdate),
    /// Waits until outputs may be written.
    wait: &'a dyn Fn(),
}

/// Runs a job. `kept_bytes` is the limit for results in memory after the job. `last` are the values that live pages got from the previous
/// job.
fn evaluate(
    job: &Job,
    session: &mut Session,
    kept_bytes: &mut usize,
    wishes: &OutputOptions,
    observer: &dyn Observer,
    last: &mut ViewedValues,
    hooks: &JobHooks<'_>,
) -> Report {
    let start = Instant::now();
    let mut waited = Duration::ZERO;
    let folder = &wishes.folder;
    let mut diagnostics = job.diagnostics.clone();
    let mut viewed_run = None;
    session.set_memory(session.memory());
    session.set_keeping_on_disk(job.purpose != Purpose::Drag);
    let produced = wishes.inputs.feed(session, &job.graph).and_then(|(graph, warnings)| {
        diagnostics.extend(warnings);
        let mut names: Vec<_> = job.views.iter().map(|viewed| &viewed.node[..]).collect();
        if job.purpose == Purpose::Outputs {
            names.extend(graph.output_names());
        }
        let graph = session.resolve_for(&graph, &names, observer, &job.cancel);
        let mut see = |session: &mut Session| {
            viewed_run = evaluate_views(&graph, job, session, observer);
            let values = viewed_run
                .as_ref()
                .map(|viewed_run| collect_values(&graph, viewed_run, &job.views, session, last));
            let resolved = (!graph.loops().is_empty()).then(|| Arc::new(graph.clone()));
            if !job.cancel.is_cancelled() {
                let values = values.unwrap_or_default();
                (hooks.send_view)(ViewUpdate { run: job.run, graph: resolved, values });
            }
            if job.purpose == Purpose::Outputs {
                let start = Instant::now();
                (hooks.wait)();
                waited = start.elapsed();
            }
        };
        let produced = (job.purpose == Purpose::Outputs).then(|| {
            let (only, cancel) = (&wishes.only, &job.cancel);
            session.produce_after(&graph, only, folder, observer, cancel, &mut see)
        });
        // Live pages need values even if nothing was written, because the graph has no outputs or an output name is unknown.
        if !matches!(produced, Some(Ok(_))) {
            see(session);
        }
        produced.transpose().map_err(|why| vec![graph.diagnostic(code::UNKNOWN_LINK, why)])
    });
    let (trace, written, complete) = match produced {
        Ok(Some(produced)) => {
            let trace = produced.trace();
            diagnostics = merge_diagnostics(diagnostics, produced.diagnostics);
            (trace, produced.written, produced.complete)
        }
        Ok(None) => Default::default(),
        Err(wrong) => {
            diagnostics.extend(wrong);
            (RunTrace::default(), Vec::new(), true)
        }
    };
    diagnostics.extend(session.warnings(&job.graph));
    let cancelled = job.cancel.is_cancelled();
    fn memory_to_keep(trace: &RunTrace, session: &Session) -> usize {
        let bytes: usize = trace.0.iter().map(|node| node.bytes).sum();
        bytes.saturating_mul(KEPT_RUNS).max(MIN_KEPT_BYTES).min(session.memory())
    }
    match (job.purpose, &viewed_run) {
        _ if cancelled => {}
        // Do not lower the limit on memory if the graph has errors. While the user types the name of a node type, results that depend on
        // that node are not computed, but they will be needed again.
        (Purpose::Outputs, _) if has_errors(&job.diagnostics) => {
            *kept_bytes = memory_to_keep(&trace, session).max(*kept_bytes);
        }
        (Purpose::Outputs, _) => *kept_bytes = memory_to_keep(&trace, session),
        // A drag creates many results in addition to those for the outputs. So raise the limit on memory if necessary, but do not lower it.
        (Purpose::Drag, Some(viewed_run)) => {
            *kept_bytes = memory_to_keep(&viewed_run.trace(), session).max(*kept_bytes);
            diagnostics.extend(viewed_run.diagnostics());
        }
        (Purpose::Drag | Purpose::View, _) => {}
    }
    if job.purpose != Purpose::View && !cancelled {
        session.set_memory(*kept_bytes);
    }
    Report {
        run: job.run,
        cancelled,
        trace,
        diagnostics,
        written,
        unwritten: (!complete).then(|| folder.path().to_owned()),
        seconds: start.elapsed().saturating_sub(waited).as_secs_f64(),
        purpose: job.purpose,
    }
}

/// Evaluates the values for live pages, if the graph has them. They are cached if outputs need them later.
fn evaluate_views(
    graph: &Graph,
    job: &Job,
    session: &mut Session,
    observer: &dyn Observer,
) -> Option<RunResult> {
    let names = job.views.iter().map(|viewed| &viewed.node);
    let there: Vec<_> = names.filter(|name| !graph.nodes_of(name).is_empty()).cloned().collect();
    if there.is_empty() || job.cancel.is_cancelled() {
        return None;
    }
    let (targets, cancel) = (Targets::Nodes(there), job.cancel.clone());
    session.run(graph, &Run { targets, observer, cancel, ..Run::default() }).ok()
}

/// Returns the values for live pages. Values that have not changed are taken from `last`.
fn collect_values(
    graph: &Graph,
    finished: &RunResult,
    views: &Views,
    session: &mut Session,
    last: &mut ViewedValues,
) -> ViewedValues {
    let mut all = ViewedValues::new();
    for viewed in views {
        let Some(value) = finished.value_of(&viewed.node, &viewed.output) else { continue };
        let shown = show(graph, viewed, value, session, last.get(viewed));
        all.insert(viewed.clone(), shown);
    }
    last.clone_from(&all);
    all
}

/// Prepares a value for display. If it has not changed, `last` is used again.
fn show(
    graph: &Graph,
    viewed: &ViewedOutput,
    value: &AnyValue,
    session: &mut Session,
    last: Option<&Arc<ViewedValue>>,
) -> Arc<ViewedValue> {
    let target = graph.find_value(&format!("{}.{}", viewed.node, viewed.output));
    let requirements = target.map_or(Vec::new(), |target| graph.requirements_of(target));
    let same = last.filter(|last| last.value.hash() == value.hash());
    let layers = if same.is_some() { Vec::new() } else { value.show() };
    let picture = match same {
        Some(same) => same.picture.as_ref(),
        None => picture_layer(&layers),
    };
    let ground = picture.zip(target).and_then(|(picture, (node, _))| {
        let found = ValueSource { graph, node, session }.backdrop_of(picture, None);
        // If the background picture cannot be computed, show the value without a background.
        found.unwrap_or_default()
    });
    let layers = match same {
        Some(same) if same.looks_same_on(ground.as_ref()) && same.required == requirements => {
            return same.clone();
        }
        Some(_) => value.show(),
        None => layers,
    };
    ViewedValue::new(value.clone(), layers, requirements, ground, last.map(|last| &**last)).into()
}

/// Returns the report of a job that panicked.
fn panic_report(job: &Job, words: &str) -> Report {
    let message = format!("the evaluation panicked: {words}");
    let mut diagnostic = job.graph.diagnostic(code::PANIC, message);
    diagnostic.help =
        "this is a bug; please report it with the graph. The next run starts without cached results".into();
    Report {
        run: job.run,
        cancelled: false,
        trace: RunTrace::default(),
        diagnostics: vec![diagnostic],
        written: Vec::new(),
        unwritten: None,
        seconds: 0.0,
        purpose: job.purpose,
    }
}

#[cfg(test)]
mod tests {
    use maquette_engine::session::Settings;
    use maquette_graph::Options;
    use maquette_graph::catalog::Catalog;

    use super::*;

    fn reports_to(sender: Sender<Report>) -> impl Fn(WorkerEvent) + Send + 'static {
        move |news| {
            if let WorkerEvent::Report(report) = news {
                let _ = sender.send(report);
            }
        }
    }

    #[test]
    fn a_panic_in_a_run_ends_it_with_a_message_and_the_next_run_works() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("graph.ron");
        std::fs::write(&path, "Graph(format: 1, nodes: {}, outputs: {})").unwrap();
        let graph = Graph::load(&path, &Catalog::new(&[]), &Options::default()).graph.unwrap();
        let graph = Arc::new(graph);
        let first = std::sync::atomic::AtomicBool::new(true);
        let observe: ObserverFactory = Box::new(move |_| {
            assert!(!first.swap(false, std::sync::atomic::Ordering::Relaxed), "out of order");
            Box::new(())
        });
        let (sender, reports) = channel();
        let settings = Settings { threads: 1, memory: 0, ..Settings::in_memory() };
        let session = Session::new(&[], &settings).unwrap();
        let wishes = OutputOptions {
            folder: OutputFolder::new(Some(&folder.path().join("out")), &path),
            only: Vec::new(),
            inputs: InputOptions::default(),
        };
        let sink = reports_to(sender);
        let worker = Worker::new(session, wishes, observe, sink);
        let messages = [1, 2].map(|run| {
            let (graph, diagnostics, cancel) = (graph.clone(), Vec::new(), CancelToken::default());
            let (recompute, purpose, views) = (false, Purpose::Outputs, Views::new());
            worker.start(Job { run, graph, diagnostics, cancel, recompute, purpose, views });
            let report: Report = reports.recv().unwrap();
            report.diagnostics.into_iter().map(|diagnostic| diagnostic.message).collect::<Vec<_>>()
        });
        assert_eq!(messages, [vec!["the evaluation panicked: out of order".to_owned()], vec![]]);
    }

    /// A test node that returns a picture, or panics.
    #[derive(serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
    struct Faulty {
        panics: bool,
    }

    impl maquette_node::Node for Faulty {
        type Outputs = (maquette_value::Mask,);
        const OUTPUTS: [&'static str; 1] = ["mask"];

        fn eval(
            &self,
            _: &maquette_node::Context<'_>,
        ) -> Result<Self::Outputs, maquette_syntax::error::Error> {
            assert!(!self.panics, "a fault");
            Ok((maquette_value::Mask::new(1, 1, vec![1])?,))
        }
    }

    const FAULTY: maquette_node::pack::Pack = maquette_node::pack::Pack {
        name: "faulty",
        nodes: &[maquette_node::node::<Faulty>()],
        ..maquette_node::pack::Pack::EMPTY
    };

    #[test]
    fn viewed_values_are_sent_before_files_are_written() {
        let folder = tempfile::tempdir().unwrap();
        let (path, file) = (folder.path().join("graph.ron"), folder.path().join("out/mask.png"));
        let catalog = Arc::new(Catalog::new(&[&maquette_format::PACK, &FAULTY]));
        let text = "Graph(format: 1, nodes: { \"mask\": Faulty(panics: false) }, outputs: { \"mask.png\": \"mask\" })";
        std::fs::write(&path, text).unwrap();
        let graph = Arc::new(Graph::load(&path, &catalog, &Options::default()).graph.unwrap());
        let viewed = ViewedOutput { node: "mask".into(), output: "mask".into() };
        // Runs a job and returns two facts about each of its two events: the number of values for live pages (`None` for the report), and
        // if the output file exists at that time.
        let told = |only: Vec<String>| {
            let session = Session::with_catalog(catalog.clone(), &Settings::in_memory()).unwrap();
            let outputs = OutputFolder::new(Some(&folder.path().join("out")), &path);
            let wishes = OutputOptions { folder: outputs, only, inputs: InputOptions::default() };
            let (sender, news) = channel();
            let file = file.clone();
            let worker = Worker::new(session, wishes, Box::new(|_| Box::new(())), move |it| {
                let viewed_run = match it {
                    WorkerEvent::View(sight) => Some(sight.values.len()),
                    WorkerEvent::Report(_) => None,
                };
                let _ = sender.send((viewed_run, file.exists()));
            });
            worker.start(Job {
                run: 1,
                graph: graph.clone(),
                diagnostics: Vec::new(),
                cancel: CancelToken::default(),
                recompute: false,
                purpose: Purpose::Outputs,
                views: Views::from_iter([viewed.clone()]),
            });
            [news.recv().unwrap(), news.recv().unwrap()]
        };
        assert_eq!(told(vec!["other.png".into()]), [(Some(1), false), (None, false)]);
        assert_eq!(told(Vec::new()), [(Some(1), false), (None, true)]);
    }

    #[test]
    fn a_panic_of_a_node_fails_only_its_outputs() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("graph.ron");
        let catalog = Arc::new(Catalog::new(&[&maquette_format::PACK, &FAULTY]));
        fn graph(panics: bool, path: &std::path::Path, catalog: &Arc<Catalog>) -> Arc<Graph> {
            let text = format!(
                "Graph(format: 1, nodes: {{ \"bad\": Faulty(panics: {panics}), \"good\": Faulty(panics: false) }},
                    outputs: {{ \"bad.png\": \"bad\", \"good.png\": \"good\" }})"
            );
            std::fs::write(path, &text).unwrap();
            Arc::new(Graph::load(path, catalog, &Options::default()).graph.unwrap())
        }
        let (sender, reports) = channel();
        let session = Session::with_catalog(catalog.clone(), &Settings::in_memory()).unwrap();
        let wishes = OutputOptions {
            folder: OutputFolder::new(Some(&folder.path().join("out")), &path),
            only: Vec::new(),
            inputs: InputOptions::default(),
        };
        let sink = reports_to(sender);
        let worker = Worker::new(session, wishes, Box::new(|_| Box::new(())), sink);
        let run = |run: usize, panics: bool| {
            let (graph, diagnostics, cancel) =
                (graph(panics, &path, &catalog), Vec::new(), CancelToken::default());
            let (recompute, purpose, views) = (false, Purpose::Outputs, Views::new());
            worker.start(Job { run, graph, diagnostics, cancel, recompute, purpose, views });
            let report: Report = reports.recv().unwrap();
            let codes: Vec<_> =
                report.diagnostics.iter().map(|diagnostic| diagnostic.code).collect();
            let written: Vec<_> = report.written.iter().map(|file| file.output.clone()).collect();
            (codes, written)
        };
        assert_eq!(run(1, true), (vec![code::PANIC], vec!["good.png".to_owned()]));
        assert_eq!(run(2, false).0, Vec::<&str>::new());
        assert!(folder.path().join("out/bad.png").exists());
    }
}
