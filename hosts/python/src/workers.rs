//! Threads that work on graphs and values while Python continues.

use std::collections::HashMap;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use rayon::ThreadPool;

/// Interval at which the calling thread checks for signals while it waits for another thread.
pub(crate) const LOOK: Duration = Duration::from_millis(20);

/// The thread pools of a process. A forked child needs its own thread pools: the threads of its parent do not exist in the child, so the
/// parent's pools would never do any work.
struct Workers {
    process: u32,
    /// The thread pool for work on values.
    values: Arc<ThreadPool>,
    /// The thread pools for graphs, by their number of threads.
    graphs: HashMap<usize, Arc<ThreadPool>>,
}

/// The thread pools of this process. The mutex is locked only while the interpreter's lock is held, so Python cannot fork a child
/// meanwhile.
static WORKERS: Mutex<Option<Workers>> = Mutex::new(None);

/// Runs a function on the pool for values, while other Python threads continue.
pub(crate) fn on_threads<R: Send>(py: Python<'_>, work: impl FnOnce() -> R + Send) -> PyResult<R> {
    let threads = of_process(|workers| Ok(workers.values.clone()))?;
    Ok(py.detach(|| threads.install(work)))
}

/// Runs a slow function on the pool for values, while the caller checks for signals. If a signal handler raises an exception, the caller
/// returns at once and the work ends later by itself.
pub(crate) fn until_signal<R: Send + 'static>(
    py: Python<'_>,
    work: impl FnOnce() -> R + Send + 'static,
) -> PyResult<R> {
    let threads = of_process(|workers| Ok(workers.values.clone()))?;
    on_a_thread(py, move || threads.install(work))
}

/// Runs a function on a new thread, while the caller checks for signals. If a signal handler raises an exception, the caller returns at
/// once.
pub(crate) fn on_a_thread<R: Send + 'static>(
    py: Python<'_>,
    work: impl FnOnce() -> R + Send + 'static,
) -> PyResult<R> {
    let (done, result) = channel();
    std::thread::Builder::new().name("maquette".into()).spawn(move || {
        // An interrupted caller does not receive the result.
        let _ = done.send(catch_unwind(AssertUnwindSafe(work)));
    })?;
    let result: Mutex<Receiver<_>> = Mutex::new(result);
    loop {
        match py.detach(|| lock(&result).recv_timeout(LOOK)) {
            Ok(Ok(found)) => return Ok(found),
            Ok(Err(panic)) => resume_unwind(panic),
            Err(RecvTimeoutError::Timeout) => py.check_signals()?,
            Err(RecvTimeoutError::Disconnected) => {
                return Err(PyRuntimeError::new_err("the work ended by a fault of maquette"));
            }
        }
    }
}

/// Returns the shared pool with this number of threads; 0 means the number of threads of the machine.
pub(crate) fn of_graphs(threads: usize) -> PyResult<Arc<ThreadPool>> {
    of_process(|workers| {
        if let Some(known) = workers.graphs.get(&threads) {
            return Ok(known.clone());
        }
        let started = maquette::start_threads(threads);
        let started = started.map_err(|error| PyValueError::new_err(error.to_string()))?;
        workers.graphs.insert(threads, started.clone());
        Ok(started)
    })
}

fn of_process<R>(take: impl FnOnce(&mut Workers) -> PyResult<R>) -> PyResult<R> {
    let (mut workers, process) = (lock(&WORKERS), std::process::id());
    if workers.as_ref().is_none_or(|known| known.process != process) {
        let values = maquette::start_threads(0);
        let values = values.map_err(|error| PyRuntimeError::new_err(error.to_string()))?;
        // The threads of the parent process do not exist here and cannot be joined, so their pools are not dropped.
        std::mem::forget(workers.replace(Workers { process, values, graphs: HashMap::new() }));
    }
    match workers.as_mut() {
        Some(workers) => take(workers),
        None => unreachable!("the threads of this process are there"),
    }
}

/// Locks a mutex. A lock that is poisoned by a panic can be used: no code leaves a half-changed state.
pub(crate) fn lock<T>(lock: &Mutex<T>) -> MutexGuard<'_, T> {
    lock.lock().unwrap_or_else(PoisonError::into_inner)
}
