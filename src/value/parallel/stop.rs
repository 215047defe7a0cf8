//! Stopping the loops of a cancelled computation.

use std::cell::RefCell;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

thread_local! {
    /// The flag of the computation to which the running code belongs.
    static FLAG: RefCell<Option<Arc<AtomicBool>>> = const { RefCell::new(None) };
}

/// The payload with which a stopped loop unwinds.
struct Stopped;

/// Calls `work`, and returns its result. Every parallel loop in it, on all threads, stops soon after the flag has been set; then the result
/// is `None`. Loops that are not parallel have to look themselves.
pub fn stoppable<T>(flag: &Arc<AtomicBool>, work: impl FnOnce() -> T) -> Option<T> {
    match catch_unwind(AssertUnwindSafe(|| with_flag(Some(flag.clone()), work))) {
        Ok(result) => Some(result),
        Err(payload) if payload.is::<Stopped>() => None,
        Err(payload) => resume_unwind(payload),
    }
}

/// Returns the flag of the computation to which the running code belongs.
pub(super) fn flag() -> Option<Arc<AtomicBool>> {
    FLAG.with_borrow(Clone::clone)
}

/// Calls `work` as a part of the computation with this flag. Unwinds if the flag is set.
pub(super) fn with_flag<T>(flag: Option<Arc<AtomicBool>>, work: impl FnOnce() -> T) -> T {
    /// Restores the previous flag, also after a panic: a waiting thread may take over a part of another computation.
    struct Restore(Option<Arc<AtomicBool>>);
    impl Drop for Restore {
        fn drop(&mut self) {
            FLAG.set(self.0.take());
        }
    }
    if flag.as_ref().is_some_and(|flag| flag.load(Ordering::Relaxed)) {
        resume_unwind(Box::new(Stopped));
    }
    let _restore = Restore(FLAG.replace(flag));
    work()
}
