//! Threads for work on values, while Python goes on with its own.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use rayon::ThreadPool;

/// The threads of a process. A child made by `fork` has none of its parent's: work that is handed to those would wait for ever.
struct Workers {
    process: u32,
    threads: Arc<ThreadPool>,
}

/// Is locked only by who holds the interpreter's lock, so that no child is made meanwhile.
static WORKERS: Mutex<Option<Workers>> = Mutex::new(None);

/// Does something on threads of our own, while other threads of Python go on.
pub(crate) fn on_threads<R: Send>(py: Python<'_>, work: impl FnOnce() -> R + Send) -> PyResult<R> {
    let threads = threads()?;
    Ok(py.detach(|| threads.install(work)))
}

fn threads() -> PyResult<Arc<ThreadPool>> {
    let (mut workers, process) = (lock(&WORKERS), std::process::id());
    if let Some(known) = workers.as_ref().filter(|known| known.process == process) {
        return Ok(known.threads.clone());
    }
    let threads = rayon::ThreadPoolBuilder::new().build();
    let threads = threads.map_err(|error| PyRuntimeError::new_err(error.to_string()))?;
    let threads = Arc::new(threads);
    // The parent's threads are not here to be told to end.
    std::mem::forget(workers.replace(Workers { process, threads: threads.clone() }));
    Ok(threads)
}

/// What a lock holds: who panicked with it left nothing half-done.
pub(crate) fn lock<T>(lock: &Mutex<T>) -> MutexGuard<'_, T> {
    lock.lock().unwrap_or_else(PoisonError::into_inner)
}
