//! Threads for work on graphs and values, while Python goes on with its own.

use std::collections::HashMap;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use rayon::ThreadPool;

/// How often the caller looks for signals while something is done on other threads.
pub(crate) const LOOK: Duration = Duration::from_millis(20);

/// The threads of a process. A child made by `fork` has none of its parent's: work that is handed to those would wait for ever.
struct Workers {
    process: u32,
    /// Those for work on values.
    values: Arc<ThreadPool>,
    /// Those that graphs share, by how many are asked for.
    graphs: HashMap<usize, Arc<ThreadPool>>,
}

/// Is locked only by who holds the interpreter's lock, so that no child is made meanwhile.
static WORKERS: Mutex<Option<Workers>> = Mutex::new(None);

/// Does something on threads of our own, while other threads of Python go on.
pub(crate) fn on_threads<R: Send>(py: Python<'_>, work: impl FnOnce() -> R + Send) -> PyResult<R> {
    let threads = of_process(|workers| Ok(workers.values.clone()))?;
    Ok(py.detach(|| threads.install(work)))
}

/// Does something that may take long on threads of our own, while the caller looks for signals. If one raises, the work is left to its end
/// alone.
pub(crate) fn until_signal<R: Send + 'static>(
    py: Python<'_>,
    work: impl FnOnce() -> R + Send + 'static,
) -> PyResult<R> {
    let threads = of_process(|workers| Ok(workers.values.clone()))?;
    on_a_thread(py, move || threads.install(work))
}

/// The same on a thread of its own.
pub(crate) fn on_a_thread<R: Send + 'static>(
    py: Python<'_>,
    work: impl FnOnce() -> R + Send + 'static,
) -> PyResult<R> {
    let (done, result) = channel();
    std::thread::Builder::new().name("maquette".into()).spawn(move || {
        // Who was interrupted listens no more.
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

/// The threads, this many or as many as the machine has, that all graphs share which ask for as many.
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
        // The parent's threads are not here to be told to end.
        std::mem::forget(workers.replace(Workers { process, values, graphs: HashMap::new() }));
    }
    match workers.as_mut() {
        Some(workers) => take(workers),
        None => unreachable!("the threads of this process are there"),
    }
}

/// What a lock holds: who panicked with it left nothing half-done.
pub(crate) fn lock<T>(lock: &Mutex<T>) -> MutexGuard<'_, T> {
    lock.lock().unwrap_or_else(PoisonError::into_inner)
}
