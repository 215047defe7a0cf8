//! The thread that evaluates while the watch listens.
//!
//! Its evaluator lives as long as the watch. Nothing tracks which results are still valid, because keys do.

use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::mpsc::{Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use maquette_engine::eval::{Observer, RunTrace};
use maquette_engine::session::{Finished, OutputFolder, Run, Session, Wanted, Written};
use maquette_graph::Graph;
use maquette_node::CancelToken;
use maquette_preview::{Shown, Viewed, Views};
use maquette_render::picture_of;
use maquette_syntax::error::{Problem, Severity, code, in_words, with_those_of_run};
use maquette_value::AnyValue;

use crate::inputs::InputOptions;
use crate::look::Source;

/// Results of several runs are kept, so that a change that is taken back costs nothing; but no more than this many times what
/// one run needs, so that a day of changes does not fill the memory.
const RUNS_KEPT: usize = 4;

/// Small graphs keep this many bytes of results in any case.
const KEPT: usize = 192 << 20;

/// What is to be evaluated.
pub(super) struct Job {
    pub(super) run: usize,
    pub(super) graph: Arc<Graph>,
    /// The warnings of the check.
    pub(super) problems: Vec<Problem>,
    pub(super) cancel: CancelToken,
    /// Whether to compute everything, whatever is known.
    pub(super) recompute: bool,
    pub(super) purpose: Purpose,
    /// What somebody looks at.
    pub(super) views: Views,
}

/// What a job is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Purpose {
    /// The outputs, and what somebody looks at.
    Outputs,
    /// What somebody looks at.
    Look,
    /// The same with values that are not in the graph's file: nothing is kept on disk.
    Drag,
}

/// What became of a job.
#[derive(Clone)]
pub(super) struct Report {
    pub(super) run: usize,
    /// It was stopped; the other fields mean nothing then.
    pub(super) cancelled: bool,
    pub(super) trace: RunTrace,
    pub(super) problems: Vec<Problem>,
    pub(super) written: Vec<Written>,
    /// The folder of the outputs, if a file could not be written.
    pub(super) unwritten: Option<PathBuf>,
    pub(super) seconds: f64,
    /// Without outputs all but the problems means nothing.
    pub(super) purpose: Purpose,
}

/// What a job has found for who looks. It is told before files are written: eyes wait, files do not.
pub(super) struct Sight {
    pub(super) run: usize,
    /// The graph with the elements of its data, if it has such.
    pub(super) graph: Option<Arc<Graph>>,
    pub(super) values: Seen,
}

/// What is heard of a job: first what somebody looks at, if there is such, and at last what became of it.
pub(super) enum News {
    Sight(Sight),
    Report(Report),
}

/// What somebody looks at, as it is shown.
pub(super) type Seen = BTreeMap<Viewed, Arc<Shown>>;

/// What every run of the watch is to make.
pub(super) struct Wishes {
    pub(super) folder: OutputFolder,
    /// The names of outputs; all if there are none.
    pub(super) only: Vec<String>,
    pub(super) inputs: InputOptions,
}

/// Makes what follows the evaluation that a token stops.
pub(super) type Observe = Box<dyn Fn(&CancelToken) -> Box<dyn Observer> + Send>;

/// Until when outputs are not written.
#[derive(Default)]
pub(super) struct Hold(Mutex<Option<Instant>>);

impl Hold {
    /// An evaluation that was cancelled notices it after this.
    const PAUSE: Duration = Duration::from_millis(10);

    pub(super) fn set(&self, until: Option<Instant>) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = until;
    }

    /// Waits until outputs may be written, or the evaluation is cancelled.
    fn wait(&self, cancel: &CancelToken) {
        while !cancel.is_cancelled() {
            let until = *self.0.lock().unwrap_or_else(PoisonError::into_inner);
            let now = Instant::now();
            match until {
                Some(until) if now < until => std::thread::sleep(Self::PAUSE.min(until - now)),
                _ => return,
            }
        }
    }
}

/// Evaluates one job after the other, always with the same evaluator, whose cache knows what is still valid.
pub(super) struct Worker {
    jobs: Sender<Job>,
    wishes: Arc<Wishes>,
    pub(super) hold: Arc<Hold>,
}

impl Worker {
    pub(super) fn new(
        mut session: Session,
        wishes: Wishes,
        observe: Observe,
        sink: impl Fn(News) + Send + 'static,
    ) -> Self {
        session.recall(&wishes.folder);
        let wishes = Arc::new(wishes);
        let (jobs, receiver) = channel::<Job>();
        let hold = Arc::<Hold>::default();
        let (of_all, until) = (wishes.clone(), hold.clone());
        std::thread::spawn(move || {
            let mut last = Seen::new();
            let mut kept = session.memory();
            for job in receiver {
                if job.recompute {
                    session.forget();
                }
                let report = catch_unwind(AssertUnwindSafe(|| {
                    let observer = observe(&job.cancel);
                    let tell = |sight| sink(News::Sight(sight));
                    let wait = || until.wait(&job.cancel);
                    let tell = Tell { sight: &tell, wait: &wait };
                    evaluate(&job, &mut session, &mut kept, &of_all, &*observer, &mut last, &tell)
                }));
                sink(News::Report(report.unwrap_or_else(|panic| {
                    // What it was about to remember may be half of something.
                    session.forget();
                    panicked(&job, &in_words(&*panic))
                })));
            }
            // The process ends here; giving the memory back piece by piece would only take time.
            std::mem::forget(session);
        });
        Self { jobs, wishes, hold }
    }

    pub(super) fn start(&self, job: Job) {
        // The thread lives as long as this.
        let _ = self.jobs.send(job);
    }
}

/// The thread ends with the process, and does not get to it.
impl Drop for Worker {
    fn drop(&mut self) {
        self.wishes.folder.let_go();
    }
}

/// What a job does before it writes.
struct Tell<'a> {
    /// Tells what is seen now.
    sight: &'a dyn Fn(Sight),
    /// Waits until outputs may be written.
    wait: &'a dyn Fn(),
}

/// Does a job. `kept` is how many bytes of results stay behind it, `last` what was seen last.
fn evaluate(
    job: &Job,
    session: &mut Session,
    kept: &mut usize,
    wishes: &Wishes,
    observer: &dyn Observer,
    last: &mut Seen,
    tell: &Tell<'_>,
) -> Report {
    let start = Instant::now();
    let mut waited = Duration::ZERO;
    let folder = &wishes.folder;
    let mut problems = job.problems.clone();
    let mut seen = None;
    session.use_memory(session.memory());
    session.keep_on_disk(job.purpose != Purpose::Drag);
    let produced = wishes.inputs.fed(session, &job.graph).and_then(|(graph, warnings)| {
        problems.extend(warnings);
        let mut names: Vec<_> = job.views.iter().map(|viewed| &viewed.node[..]).collect();
        if job.purpose == Purpose::Outputs {
            names.extend(graph.output_names());
        }
        let graph = session.resolved_for(&graph, &names, observer, &job.cancel);
        let mut see = |session: &mut Session| {
            seen = look(&graph, job, session, observer);
            let values = seen.as_ref().map(|seen| viewed(&graph, seen, &job.views, session, last));
            let resolved = (!graph.loops().is_empty()).then(|| Arc::new(graph.clone()));
            if !job.cancel.is_cancelled() {
                let values = values.unwrap_or_default();
                (tell.sight)(Sight { run: job.run, graph: resolved, values });
            }
            if job.purpose == Purpose::Outputs {
                let start = Instant::now();
                (tell.wait)();
                waited = start.elapsed();
            }
        };
        let produced = (job.purpose == Purpose::Outputs).then(|| {
            let (only, cancel) = (&wishes.only, &job.cancel);
            session.produce_after(&graph, only, folder, observer, cancel, &mut see)
        });
        // Without outputs, or without one of a wanted name, somebody looks all the same.
        if !matches!(produced, Some(Ok(_))) {
            see(session);
        }
        produced.transpose().map_err(|why| vec![graph.problem(code::UNKNOWN_LINK, why)])
    });
    let (trace, written, complete) = match produced {
        Ok(Some(produced)) => {
            let trace = produced.trace();
            problems = with_those_of_run(problems, produced.problems);
            (trace, produced.written, produced.complete)
        }
        Ok(None) => Default::default(),
        Err(wrong) => {
            problems.extend(wrong);
            (RunTrace::default(), Vec::new(), true)
        }
    };
    problems.extend(session.warnings(&job.graph));
    let cancelled = job.cancel.is_cancelled();
    fn enough(trace: &RunTrace, session: &Session) -> usize {
        let bytes: usize = trace.0.iter().map(|node| node.bytes).sum();
        bytes.saturating_mul(RUNS_KEPT).max(KEPT).min(session.memory())
    }
    match (job.purpose, &seen) {
        _ if cancelled => {}
        // What hangs on a node whose name is being typed will be wanted again.
        (Purpose::Outputs, _) if job.problems.iter().any(|p| p.severity == Severity::Error) => {
            *kept = enough(&trace, session).max(*kept);
        }
        (Purpose::Outputs, _) => *kept = enough(&trace, session),
        // A hand makes many results of which the outputs need nothing.
        (Purpose::Drag, Some(seen)) => {
            *kept = enough(&seen.trace(), session).max(*kept);
            problems.extend(seen.problems());
        }
        (Purpose::Drag | Purpose::Look, _) => {}
    }
    if job.purpose != Purpose::Look && !cancelled {
        session.use_memory(*kept);
    }
    Report {
        run: job.run,
        cancelled,
        trace,
        problems,
        written,
        unwritten: (!complete).then(|| folder.path().to_owned()),
        seconds: start.elapsed().saturating_sub(waited).as_secs_f64(),
        purpose: job.purpose,
    }
}

/// Evaluates what somebody looks at, as far as there is such. What the outputs needed, too, is known already.
fn look(
    graph: &Graph,
    job: &Job,
    session: &mut Session,
    observer: &dyn Observer,
) -> Option<Finished> {
    let names = job.views.iter().map(|viewed| &viewed.node);
    let there: Vec<_> = names.filter(|name| !graph.nodes_of(name).is_empty()).cloned().collect();
    if there.is_empty() || job.cancel.is_cancelled() {
        return None;
    }
    let (wanted, cancel) = (Wanted::Nodes(there), job.cancel.clone());
    session.run(graph, &Run { wanted, observer, cancel, ..Run::default() }).ok()
}

/// The values that somebody looks at. What has not changed since it was last seen is not made anew.
fn viewed(
    graph: &Graph,
    finished: &Finished,
    views: &Views,
    session: &mut Session,
    last: &mut Seen,
) -> Seen {
    let mut all = Seen::new();
    for viewed in views {
        let Some(value) = finished.value_of(&viewed.node, &viewed.output) else { continue };
        let shown = show(graph, viewed, value, session, last.get(viewed));
        all.insert(viewed.clone(), shown);
    }
    last.clone_from(&all);
    all
}

/// A value as it is shown: as the `last` time if that is the same.
fn show(
    graph: &Graph,
    viewed: &Viewed,
    value: &AnyValue,
    session: &mut Session,
    last: Option<&Arc<Shown>>,
) -> Arc<Shown> {
    let place = graph.value_named(&format!("{}.{}", viewed.node, viewed.output));
    let asked = place.map_or(Vec::new(), |target| graph.asked_of(target));
    let same = last.filter(|last| last.value.hash() == value.hash());
    let layers = if same.is_some() { Vec::new() } else { value.show() };
    let picture = match same {
        Some(same) => same.picture.as_ref(),
        None => picture_of(&layers),
    };
    let ground = picture.zip(place).and_then(|(picture, (node, _))| {
        let found = Source { graph, node, session }.ground_or(picture, None);
        // Without what it was made from a value is shown alone.
        found.unwrap_or_default()
    });
    let layers = match same {
        Some(same) if same.lies_on(ground.as_ref()) && same.asked == asked => return same.clone(),
        Some(_) => value.show(),
        None => layers,
    };
    Shown::new(value.clone(), layers, asked, ground, last.map(|last| &**last)).into()
}

/// The report of a run that a fault of the engine ended.
fn panicked(job: &Job, words: &str) -> Report {
    let message = format!("the evaluation panicked: {words}");
    let mut problem = job.graph.problem(code::PANIC, message);
    problem.help =
        "this is a bug; please report it with the graph. The next run starts anew".into();
    Report {
        run: job.run,
        cancelled: false,
        trace: RunTrace::default(),
        problems: vec![problem],
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

    fn reports_to(sender: Sender<Report>) -> impl Fn(News) + Send + 'static {
        move |news| {
            if let News::Report(report) = news {
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
        let observe: Observe = Box::new(move |_| {
            assert!(!first.swap(false, std::sync::atomic::Ordering::Relaxed), "out of order");
            Box::new(())
        });
        let (sender, reports) = channel();
        let settings = Settings { threads: 1, memory: 0, ..Settings::in_memory() };
        let session = Session::new(&[], &settings).unwrap();
        let wishes = Wishes {
            folder: OutputFolder::new(Some(&folder.path().join("out")), &path),
            only: Vec::new(),
            inputs: InputOptions::default(),
        };
        let sink = reports_to(sender);
        let worker = Worker::new(session, wishes, observe, sink);
        let messages = [1, 2].map(|run| {
            let (graph, problems, cancel) = (graph.clone(), Vec::new(), CancelToken::default());
            let (recompute, purpose, views) = (false, Purpose::Outputs, Views::new());
            worker.start(Job { run, graph, problems, cancel, recompute, purpose, views });
            let report: Report = reports.recv().unwrap();
            report.problems.into_iter().map(|problem| problem.message).collect::<Vec<_>>()
        });
        assert_eq!(messages, [vec!["the evaluation panicked: out of order".to_owned()], vec![]]);
    }

    /// A picture, or a panic.
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
    fn what_somebody_looks_at_is_told_before_files_are_written() {
        let folder = tempfile::tempdir().unwrap();
        let (path, file) = (folder.path().join("graph.ron"), folder.path().join("out/mask.png"));
        let catalog = Arc::new(Catalog::new(&[&maquette_format::PACK, &FAULTY]));
        let text = "Graph(format: 1, nodes: { \"mask\": Faulty(panics: false) }, outputs: { \"mask.png\": \"mask\" })";
        std::fs::write(&path, text).unwrap();
        let graph = Arc::new(Graph::load(&path, &catalog, &Options::default()).graph.unwrap());
        let viewed = Viewed { node: "mask".into(), output: "mask".into() };
        // How many values are seen, or none at the end, and whether there is a file by then.
        let told = |only: Vec<String>| {
            let session = Session::with_catalog(catalog.clone(), &Settings::in_memory()).unwrap();
            let outputs = OutputFolder::new(Some(&folder.path().join("out")), &path);
            let wishes = Wishes { folder: outputs, only, inputs: InputOptions::default() };
            let (sender, news) = channel();
            let file = file.clone();
            let worker = Worker::new(session, wishes, Box::new(|_| Box::new(())), move |it| {
                let seen = match it {
                    News::Sight(sight) => Some(sight.values.len()),
                    News::Report(_) => None,
                };
                let _ = sender.send((seen, file.exists()));
            });
            worker.start(Job {
                run: 1,
                graph: graph.clone(),
                problems: Vec::new(),
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
    fn a_node_that_panics_is_red_the_rest_is_written_and_the_next_run_works() {
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
        let wishes = Wishes {
            folder: OutputFolder::new(Some(&folder.path().join("out")), &path),
            only: Vec::new(),
            inputs: InputOptions::default(),
        };
        let sink = reports_to(sender);
        let worker = Worker::new(session, wishes, Box::new(|_| Box::new(())), sink);
        let run = |run: usize, panics: bool| {
            let (graph, problems, cancel) =
                (graph(panics, &path, &catalog), Vec::new(), CancelToken::default());
            let (recompute, purpose, views) = (false, Purpose::Outputs, Views::new());
            worker.start(Job { run, graph, problems, cancel, recompute, purpose, views });
            let report: Report = reports.recv().unwrap();
            let codes: Vec<_> = report.problems.iter().map(|problem| problem.code).collect();
            let written: Vec<_> = report.written.iter().map(|file| file.output.clone()).collect();
            (codes, written)
        };
        assert_eq!(run(1, true), (vec![code::PANIC], vec!["good.png".to_owned()]));
        assert_eq!(run(2, false).0, Vec::<&str>::new());
        assert!(folder.path().join("out/bad.png").exists());
    }
}
