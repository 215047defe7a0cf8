//! Sessions for Python: they run graphs and keep results between runs.
//!
//! Each run has its own thread. The calling thread waits without the interpreter's lock and checks for signals every 20 ms. After an
//! interrupt it waits at most 80 ms for the run and then continues, even if a node does not stop; the run ends later by itself. When Python
//! forks, no thread may hold a lock that the child needs, so such locks are held only together with the interpreter's lock. A child neither
//! uses nor drops objects of its parent process, because their threads do not exist in the child.

use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, Weak};
use std::time::{Duration, Instant};

use maquette::{
    CacheFolder, CacheServer, CancelToken, Diagnostic, Observer, Run, Settings, State, Targets,
};
use pyo3::exceptions::{PyRuntimeError, PyTimeoutError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyList;

use crate::graph::Graph;
use crate::run::Finished;
use crate::value::Value;
use crate::workers::{LOOK, lock, of_graphs};
use crate::{CATALOG, plain};

/// Maximum time that the caller waits for the end of an interrupted run.
const CANCEL_TIMEOUT: Duration = Duration::from_millis(80);

/// The engine's session, with the results that it keeps, in one process.
pub(crate) struct Host {
    process: u32,
    /// `None` only while the host is dropped.
    session: Option<Mutex<maquette::Session>>,
}

impl Host {
    fn new(settings: &Settings) -> PyResult<Arc<Self>> {
        let threads = of_graphs(settings.threads)?;
        let session = maquette::Session::with_threads(threads, CATALOG.clone(), settings);
        let session = session.map_err(|error| PyValueError::new_err(error.to_string()))?;
        let host =
            Arc::new(Self { process: std::process::id(), session: Some(Mutex::new(session)) });
        let mut all = lock(&HOSTS);
        all.retain(|host| host.strong_count() > 0);
        all.push(Arc::downgrade(&host));
        Ok(host)
    }

    /// The id of the process that made the host.
    pub(crate) fn process(&self) -> u32 {
        self.process
    }

    fn is_of_this_process(&self) -> bool {
        self.process == std::process::id()
    }

    /// Waits until no other thread uses the session, and calls a function with it.
    pub(crate) fn with_session<R>(&self, work: impl FnOnce(&mut maquette::Session) -> R) -> R {
        match &self.session {
            Some(session) => work(&mut lock(session)),
            None => unreachable!("a host has its session until it is dropped"),
        }
    }
}

impl Drop for Host {
    fn drop(&mut self) {
        if !self.is_of_this_process() {
            // The session's threads belong to the parent process: waiting for their end would never return.
            std::mem::forget(self.session.take());
        }
    }
}

/// All hosts of this process. The mutex is locked only while the interpreter's lock is held, so Python cannot fork a child meanwhile.
static HOSTS: Mutex<Vec<Weak<Host>>> = Mutex::new(Vec::new());

/// Waits until all pending results are on disk. Returns the warnings of the caches.
#[pyfunction]
pub(crate) fn finish_all(py: Python<'_>) -> Vec<String> {
    let hosts: Vec<_> = lock(&HOSTS).iter().filter_map(Weak::upgrade).collect();
    py.detach(|| {
        let mut troubles = Vec::new();
        for session in hosts.iter().filter(|host| host.is_of_this_process()) {
            // A session that is still locked belongs to a run whose caller was interrupted. This function does not wait for such a run.
            if let Some(Ok(session)) = session.session.as_ref().map(Mutex::try_lock) {
                session.finish();
                troubles.extend(session.cache_warnings().iter().map(|it| plain::trouble(it)));
            }
        }
        troubles
    })
}

/// A token that cancels the runs to which it is given.
#[pyclass(frozen)]
pub(crate) struct Cancel(CancelToken);

#[pymethods]
impl Cancel {
    #[new]
    fn new() -> Self {
        Self(CancelToken::default())
    }

    /// Cancels all runs with this token.
    fn cancel(&self) {
        self.0.cancel();
    }

    /// Returns true if the token was cancelled.
    #[getter]
    fn is_cancelled(&self) -> bool {
        self.0.is_cancelled()
    }
}

/// Runs graphs and keeps their results.
#[pyclass(frozen)]
pub(crate) struct Session {
    settings: Settings,
    host: Mutex<Arc<Host>>,
}

impl Session {
    /// Returns the host of this process; a forked child makes its own.
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
    /// `cache`: the cache folder; an empty path means no cache, and None the folder of the command line. `max_memory`: the memory limit for
    /// results and running nodes together. `server`: the URL of a shared cache; None means the one of the command line. `verify`: the
    /// fraction of cached results that are computed again for comparison.
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

    /// Returns the warnings of the cache so far. Does not wait: during a run the list is empty.
    fn troubles(&self) -> PyResult<Vec<String>> {
        let host = self.host()?;
        let Some(Ok(session)) = host.session.as_ref().map(Mutex::try_lock) else {
            return Ok(Vec::new());
        };
        let mut troubles = session.cache_warnings();
        if troubles.is_empty() {
            troubles.extend(session.disk_warning().map(str::to_owned));
        }
        Ok(troubles.iter().map(|it| plain::trouble(it)).collect())
    }

    /// Explains why a node would run or would not run.
    fn why(&self, py: Python<'_>, graph: &Graph, node: &str) -> PyResult<Option<String>> {
        let host = self.host()?;
        Ok(py.detach(|| host.with_session(|session| session.explain(&graph.graph, node))))
    }

    /// Drops all results in memory.
    fn forget(&self, py: Python<'_>) -> PyResult<()> {
        let host = self.host()?;
        py.detach(|| host.with_session(maquette::Session::forget));
        Ok(())
    }

    /// Reads files as values for inputs, by name. Returns the values and the warnings, or None and the errors.
    fn read_inputs<'py>(
        &self,
        py: Python<'py>,
        graph: &Graph,
        files: Vec<(String, PathBuf)>,
    ) -> PyResult<Reported<'py, HashMap<String, Value>>> {
        let host = self.host()?;
        let read = py.detach(|| {
            host.with_session(|session| {
                session.install(|| session.read_inputs(&graph.graph, &files))
            })
        });
        match read {
            Ok((values, warnings)) => {
                let values = values.into_iter().map(|(name, value)| (name, Value::new(value)));
                Ok((Some(values.collect()), plain::problems(py, &warnings)?))
            }
            Err(problems) => Ok((None, plain::problems(py, &problems)?)),
        }
    }

    /// Runs a graph on a new thread. If `outputs` is true, all outputs are computed. `nodes` are additional targets. `told` is called with
    /// (event, node, number). `timeout` is the maximum time in seconds.
    ///
    /// Returns the result; or None and the errors that prevented the run; or None and no errors if the run was cancelled.
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
    ) -> PyResult<Reported<'py, Finished>> {
        let end = timeout.and_then(|seconds| {
            Instant::now().checked_add(Duration::try_from_secs_f64(seconds).ok()?)
        });
        let host = self.host()?;
        let wanted = match (outputs, nodes.is_empty()) {
            (true, true) => Targets::Outputs,
            (true, false) => Targets::OutputsAnd(nodes),
            (false, _) => Targets::Named(nodes),
        };
        let inputs = inputs.into_iter().map(|(name, value)| (name, value.any().clone())).collect();
        let (news, heard) = channel();
        let cancel = cancel.0.clone();
        let job = Job { news, told: told.is_some(), last: Mutex::new(Instant::now()) };
        std::thread::Builder::new().name("maquette".into()).spawn({
            let (host, graph, cancel) = (host.clone(), graph.graph.clone(), cancel.clone());
            move || {
                let found = host.with_session(|session| {
                    let observer: &dyn Observer = &job;
                    session.run(&graph, &Run { targets: wanted, inputs, observer, cancel })
                });
                // If the caller does not wait anymore, the result is dropped, but the cache may keep its parts.
                let _ = job.news.send(RunEvent::Done(Box::new(found)));
            }
        })?;
        match listen(py, &Mutex::new(heard), told.as_ref(), &cancel, end) {
            Ok(_) if cancel.is_cancelled() => Ok((None, PyList::empty(py))),
            Ok(Ok(found)) => Ok((Some(Finished::new(found, host)), PyList::empty(py))),
            Ok(Err(problems)) => Ok((None, plain::problems(py, &problems)?)),
            Err(RunOutcome { error, heard }) => {
                cancel.cancel();
                py.detach(|| wait(heard));
                error.map_or_else(|| Ok((None, PyList::empty(py))), Err)
            }
        }
    }
}

/// The result, which is None if there are errors, and the diagnostics.
type Reported<'py, T> = (Option<T>, Bound<'py, PyList>);

/// An event that the thread of a run sends to the caller.
enum RunEvent {
    Told(&'static str, String, f64),
    Done(Box<Result<maquette::RunResult, Vec<Diagnostic>>>),
}

/// A run that the caller does not wait for anymore, because of an error, a signal, a timeout or cancellation.
struct RunOutcome<'a> {
    /// The Python exception to raise, or `None` if the run was cancelled.
    error: Option<PyErr>,
    heard: &'a Mutex<Receiver<RunEvent>>,
}

/// Waits for the events of a run and calls `told` for each. Returns an error if the run is cancelled, the time is over, a signal arrives,
/// or `told` raises an exception.
fn listen<'a>(
    py: Python<'_>,
    heard: &'a Mutex<Receiver<RunEvent>>,
    told: Option<&Bound<'_, PyAny>>,
    cancel: &CancelToken,
    end: Option<Instant>,
) -> Result<Result<maquette::RunResult, Vec<Diagnostic>>, RunOutcome<'a>> {
    let stopped = |error| RunOutcome { error: Some(error), heard };
    loop {
        let left = end.map(|end| end.saturating_duration_since(Instant::now()));
        let wait = left.map_or(LOOK, |left| left.min(LOOK));
        match py.detach(|| lock(heard).recv_timeout(wait)) {
            Ok(RunEvent::Done(found)) => return Ok(*found),
            Ok(RunEvent::Told(what, node, number)) => {
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
            return Err(RunOutcome { error: None, heard });
        }
        if left.is_some_and(|left| left.is_zero()) {
            return Err(stopped(PyTimeoutError::new_err("the run took longer than its timeout")));
        }
    }
}

/// Waits for the end of a cancelled run, at most `CANCEL_TIMEOUT`.
fn wait(heard: &Mutex<Receiver<RunEvent>>) {
    let end = Instant::now() + CANCEL_TIMEOUT;
    while let Some(left) = end.checked_duration_since(Instant::now()) {
        match lock(heard).recv_timeout(left) {
            Ok(RunEvent::Told(..)) => {}
            Ok(RunEvent::Done(_)) | Err(_) => return,
        }
    }
}

/// The observer of a run: sends its events to the calling thread.
struct Job {
    news: Sender<RunEvent>,
    told: bool,
    /// The time of the last progress event that was sent. Events shortly after it are dropped, because some nodes report progress thousands
    /// of times per second.
    last: Mutex<Instant>,
}

impl Job {
    fn tell(&self, what: &'static str, node: &str, number: f64) {
        if self.told {
            // An interrupted caller does not receive events anymore.
            let _ = self.news.send(RunEvent::Told(what, node.to_owned(), number));
        }
    }
}

impl Observer for Job {
    fn on_unchanged(&self, count: usize) {
        self.tell("unchanged", "", count as f64);
    }

    fn on_start(&self, node: &str) {
        self.tell("started", node, 0.0);
    }

    fn on_progress(&self, node: &str, share: f64) {
        let mut last = lock(&self.last);
        if LOOK < last.elapsed() {
            *last = Instant::now();
            self.tell("progress", node, share);
        }
    }

    fn on_finish(&self, node: &str, state: State, seconds: f64) {
        self.tell(state.word(), node, seconds);
    }
}
