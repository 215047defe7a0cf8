//! Sessions: what is known from one run to the next, and the runs.
//!
//! A run has its own thread. The caller waits without the interpreter's lock, checks for signals every 20 ms, and continues 80 ms after an
//! interrupt even if a node does not stop; such a run ends by itself. No lock that a thread may hold without the interpreter's lock is
//! taken around a `fork`. What belongs to another process is neither used nor dropped, because its threads do not exist here.

use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, Weak};
use std::time::{Duration, Instant};

use maquette::{
    CacheFolder, CacheServer, CancelToken, Observer, Problem, Run, Settings, State, Wanted,
};
use pyo3::exceptions::{PyRuntimeError, PyTimeoutError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyList;

use crate::graph::Graph;
use crate::run::Finished;
use crate::value::Value;
use crate::workers::{LOOK, lock, of_graphs};
use crate::{CATALOG, plain};

/// How long an interrupted run may take to stop before the caller goes on without it.
const PATIENCE: Duration = Duration::from_millis(80);

/// Results from one run to the next, in one process.
pub(crate) struct Host {
    process: u32,
    /// None only while it is dropped.
    session: Option<Mutex<maquette::Session>>,
}

impl Host {
    fn new(settings: &Settings) -> PyResult<Arc<Self>> {
        let threads = of_graphs(settings.threads)?;
        let session = maquette::Session::on(threads, CATALOG.clone(), settings);
        let session = session.map_err(|error| PyValueError::new_err(error.to_string()))?;
        let host =
            Arc::new(Self { process: std::process::id(), session: Some(Mutex::new(session)) });
        let mut all = lock(&HOSTS);
        all.retain(|host| host.strong_count() > 0);
        all.push(Arc::downgrade(&host));
        Ok(host)
    }

    /// The process that it is of.
    pub(crate) fn process(&self) -> u32 {
        self.process
    }

    fn is_of_this_process(&self) -> bool {
        self.process == std::process::id()
    }

    /// Does something with the session, once nobody else does.
    pub(crate) fn with<R>(&self, work: impl FnOnce(&mut maquette::Session) -> R) -> R {
        match &self.session {
            Some(session) => work(&mut lock(session)),
            None => unreachable!("a host has its session until it is dropped"),
        }
    }
}

impl Drop for Host {
    fn drop(&mut self) {
        if !self.is_of_this_process() {
            // Its threads are the parent's: whoever waits for their end here waits for ever.
            std::mem::forget(self.session.take());
        }
    }
}

/// All hosts. Locked only by who holds the interpreter's lock, so that no child is made meanwhile.
static HOSTS: Mutex<Vec<Weak<Host>>> = Mutex::new(Vec::new());

/// Waits until all results that are worth it are on disk, and gives what went wrong with it.
#[pyfunction]
pub(crate) fn finish_all(py: Python<'_>) -> Vec<String> {
    let hosts: Vec<_> = lock(&HOSTS).iter().filter_map(Weak::upgrade).collect();
    py.detach(|| {
        let mut troubles = Vec::new();
        for session in hosts.iter().filter(|host| host.is_of_this_process()) {
            // One that still runs was left alone by who asked for it.
            if let Some(Ok(session)) = session.session.as_ref().map(Mutex::try_lock) {
                session.finish();
                troubles.extend(session.troubles().iter().map(|it| plain::trouble(it)));
            }
        }
        troubles
    })
}

/// Stops runs: each that was given it.
#[pyclass(frozen)]
pub(crate) struct Cancel(CancelToken);

#[pymethods]
impl Cancel {
    #[new]
    fn new() -> Self {
        Self(CancelToken::default())
    }

    /// Stops them.
    fn cancel(&self) {
        self.0.cancel();
    }

    /// Whether somebody did.
    #[getter]
    fn is_cancelled(&self) -> bool {
        self.0.is_cancelled()
    }
}

/// What runs graphs and remembers results.
#[pyclass(frozen)]
pub(crate) struct Session {
    settings: Settings,
    host: Mutex<Arc<Host>>,
}

impl Session {
    /// The host of this process: a child made by `fork` gets one of its own.
    fn host(&self) -> PyResult<Arc<Host>> {
        let mut host = lock(&self.host);
        if !host.is_of_this_process() {
            *host = Host::new(&self.settings)?;
        }
        Ok(host.clone())
    }
}

#[pymethods]
impl Session {
    /// `cache`: a folder, empty for none, None for that of the command line.
    /// `max_memory`: what results and nodes under way may hold together. `server`: the address through which machines share results, None
    /// for that of the command line. `verify`: the share of known results that are computed all the same.
    #[new]
    fn new(
        cache: Option<PathBuf>,
        memory: &str,
        threads: usize,
        max_memory: Option<&str>,
        server: Option<String>,
        verify: f64,
    ) -> PyResult<Self> {
        let cache = match cache {
            None => CacheFolder::Default,
            Some(folder) if folder.as_os_str().is_empty() => CacheFolder::None,
            Some(folder) => CacheFolder::At(folder),
        };
        let server = server.map_or(CacheServer::Default, CacheServer::At);
        let settings = Settings { cache, threads, server, verify, ..Settings::default() };
        let mut settings = settings.with_memory(memory).map_err(PyValueError::new_err)?;
        if let Some(most) = max_memory {
            settings = settings.with_max_memory(most).map_err(PyValueError::new_err)?;
        }
        let host = Mutex::new(Host::new(&settings)?);
        Ok(Self { settings, host })
    }

    /// What went wrong with keeping and sharing results so far; nothing while a run is under way, which nobody is to wait for.
    fn troubles(&self) -> PyResult<Vec<String>> {
        let host = self.host()?;
        let Some(Ok(session)) = host.session.as_ref().map(Mutex::try_lock) else {
            return Ok(Vec::new());
        };
        let mut troubles = session.troubles();
        if troubles.is_empty() {
            troubles.extend(session.trouble().map(str::to_owned));
        }
        Ok(troubles.iter().map(|it| plain::trouble(it)).collect())
    }

    /// Why a node would run, or why not.
    fn why(&self, py: Python<'_>, graph: &Graph, node: &str) -> PyResult<Option<String>> {
        let host = self.host()?;
        Ok(py.detach(|| host.with(|session| session.why(&graph.graph, node))))
    }

    /// Drops every result in memory.
    fn forget(&self, py: Python<'_>) -> PyResult<()> {
        let host = self.host()?;
        py.detach(|| host.with(maquette::Session::forget));
        Ok(())
    }

    /// The values that files hold, for inputs by name, and warnings; or the problems, if there is no value.
    fn read_inputs<'py>(
        &self,
        py: Python<'py>,
        graph: &Graph,
        files: Vec<(String, PathBuf)>,
    ) -> PyResult<Told<'py, HashMap<String, Value>>> {
        let host = self.host()?;
        let read = py.detach(|| {
            host.with(|session| session.install(|| session.read_inputs(&graph.graph, &files)))
        });
        match read {
            Ok((values, warnings)) => {
                let values = values.into_iter().map(|(name, value)| (name, Value::new(value)));
                Ok((Some(values.collect()), plain::problems(py, &warnings)?))
            }
            Err(problems) => Ok((None, plain::problems(py, &problems)?)),
        }
    }

    /// Evaluates a graph on a thread of its own. `outputs`: whether all outputs are wanted; `nodes`: what is wanted beside them. `told` is
    /// called with (what happened, node, number). `timeout`: how many seconds it may take.
    ///
    /// Gives what was found, or the problems for which nothing was run; neither if it was cancelled.
    #[expect(clippy::too_many_arguments, reason = "the package calls it, with names")]
    fn run<'py>(
        &self,
        py: Python<'py>,
        graph: &Graph,
        outputs: bool,
        nodes: Vec<String>,
        inputs: HashMap<String, PyRef<'py, Value>>,
        told: Option<Bound<'py, PyAny>>,
        cancel: &Cancel,
        timeout: Option<f64>,
    ) -> PyResult<Told<'py, Finished>> {
        let end = timeout.and_then(|seconds| {
            Instant::now().checked_add(Duration::try_from_secs_f64(seconds).ok()?)
        });
        let host = self.host()?;
        let wanted = match (outputs, nodes.is_empty()) {
            (true, true) => Wanted::Outputs,
            (true, false) => Wanted::OutputsAnd(nodes),
            (false, _) => Wanted::Named(nodes),
        };
        let inputs = inputs.into_iter().map(|(name, value)| (name, value.any().clone())).collect();
        let (news, heard) = channel();
        let cancel = cancel.0.clone();
        let job = Job { news, told: told.is_some(), last: Mutex::new(Instant::now()) };
        std::thread::Builder::new().name("maquette".into()).spawn({
            let (host, graph, cancel) = (host.clone(), graph.graph.clone(), cancel.clone());
            move || {
                let found = host.with(|session| {
                    let observer: &dyn Observer = &job;
                    session.run(&graph, &Run { wanted, inputs, observer, cancel })
                });
                // Without anybody who waits, it is left to the cache.
                let _ = job.news.send(News::Done(Box::new(found)));
            }
        })?;
        match listen(py, &Mutex::new(heard), told.as_ref(), &cancel, end) {
            Ok(_) if cancel.is_cancelled() => Ok((None, PyList::empty(py))),
            Ok(Ok(found)) => Ok((Some(Finished::new(found, host)), PyList::empty(py))),
            Ok(Err(problems)) => Ok((None, plain::problems(py, &problems)?)),
            Err(Stopped { error, heard }) => {
                cancel.cancel();
                py.detach(|| wait(heard));
                error.map_or_else(|| Ok((None, PyList::empty(py))), Err)
            }
        }
    }
}

/// Something, if there is no error, and problems.
type Told<'py, T> = (Option<T>, Bound<'py, PyList>);

/// What a run says.
enum News {
    Told(&'static str, String, f64),
    Done(Box<Result<maquette::Finished, Vec<Problem>>>),
}

/// Why nobody listens any more.
struct Stopped<'a> {
    /// None if the run was cancelled.
    error: Option<PyErr>,
    heard: &'a Mutex<Receiver<News>>,
}

/// Listens until the run is done or cancelled, the time is over, a signal has come, or the one who is told raises.
fn listen<'a>(
    py: Python<'_>,
    heard: &'a Mutex<Receiver<News>>,
    told: Option<&Bound<'_, PyAny>>,
    cancel: &CancelToken,
    end: Option<Instant>,
) -> Result<Result<maquette::Finished, Vec<Problem>>, Stopped<'a>> {
    let stopped = |error| Stopped { error: Some(error), heard };
    loop {
        let left = end.map(|end| end.saturating_duration_since(Instant::now()));
        let wait = left.map_or(LOOK, |left| left.min(LOOK));
        match py.detach(|| lock(heard).recv_timeout(wait)) {
            Ok(News::Done(found)) => return Ok(*found),
            Ok(News::Told(what, node, number)) => {
                if let Some(told) = told {
                    told.call1((what, node, number)).map_err(stopped)?;
                }
            }
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => {
                return Err(stopped(PyRuntimeError::new_err(
                    "the run ended by a fault of maquette",
                )));
            }
        }
        py.check_signals().map_err(stopped)?;
        if cancel.is_cancelled() {
            return Err(Stopped { error: None, heard });
        }
        if left.is_some_and(|left| left.is_zero()) {
            return Err(stopped(PyTimeoutError::new_err("the run took longer than its timeout")));
        }
    }
}

/// Waits a little until a cancelled run is done.
fn wait(heard: &Mutex<Receiver<News>>) {
    let end = Instant::now() + PATIENCE;
    while let Some(left) = end.checked_duration_since(Instant::now()) {
        match lock(heard).recv_timeout(left) {
            Ok(News::Told(..)) => {}
            Ok(News::Done(_)) | Err(_) => return,
        }
    }
}

/// Says what happens to who wants to be told.
struct Job {
    news: Sender<News>,
    told: bool,
    /// When a node last told how far it is: some do thousands of times a second.
    last: Mutex<Instant>,
}

impl Job {
    fn tell(&self, what: &'static str, node: &str, number: f64) {
        if self.told {
            // Who was interrupted listens no more.
            let _ = self.news.send(News::Told(what, node.to_owned(), number));
        }
    }
}

impl Observer for Job {
    fn unchanged(&self, count: usize) {
        self.tell("unchanged", "", count as f64);
    }

    fn started(&self, node: &str) {
        self.tell("started", node, 0.0);
    }

    fn progress(&self, node: &str, share: f64) {
        let mut last = lock(&self.last);
        if LOOK < last.elapsed() {
            *last = Instant::now();
            self.tell("progress", node, share);
        }
    }

    fn finished(&self, node: &str, state: State, seconds: f64) {
        self.tell(state.word(), node, seconds);
    }
}
