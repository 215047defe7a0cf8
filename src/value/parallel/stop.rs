//! Stopping the loops of a cancelled computation, and counting their items.

use std::any::Any;
use std::cell::RefCell;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::panicking;

use super::meter::Meter;

/// The computation to which code belongs.
#[derive(Clone, Debug, Default)]
pub(super) struct Computation {
    /// The flag that stops it.
    flag: Option<Arc<AtomicBool>>,
    /// The meter that counts the items of its loops. `None` inside of parallel loops.
    meter: Option<Arc<Meter>>,
}

thread_local! {
    /// The computation to which the running code belongs.
    static CURRENT: RefCell<Computation> =
        const { RefCell::new(Computation { flag: None, meter: None }) };
}

impl Computation {
    pub(super) fn current() -> Self {
        CURRENT.with_borrow(Clone::clone)
    }

    /// The part of the computation inside of a parallel loop.
    pub(super) fn part(&self) -> Self {
        Self { flag: self.flag.clone(), meter: None }
    }

    /// Counts items of a loop.
    pub(super) fn count(&self, items: usize) {
        self.meter.iter().for_each(|meter| meter.add(items));
    }

    /// Calls `work` as a part of this computation. Unwinds if the computation is cancelled.
    pub(super) fn run<T>(self, work: impl FnOnce() -> T) -> T {
        /// Restores the previous computation, also after a panic: a waiting thread may take over a part of another computation.
        struct Restore(Computation);
        impl Drop for Restore {
            fn drop(&mut self) {
                CURRENT.set(std::mem::take(&mut self.0));
            }
        }
        if self.flag.as_deref().is_some_and(is_set) {
            stop();
        }
        let _restore = Restore(CURRENT.replace(self));
        work()
    }
}

/// The payload with which a stopped loop unwinds.
struct Stopped;

/// Calls `work`, and returns its result. Every parallel loop in it, on all threads, stops soon after the flag has been set; then the result
/// is `None`. Long loops that are not parallel look by [`check_stop`] or [`UntilStopped::until_stopped`].
pub fn stoppable<T>(flag: &Arc<AtomicBool>, work: impl FnOnce() -> T) -> Option<T> {
    let computation = Computation { flag: Some(flag.clone()), meter: None };
    match catch_unwind(AssertUnwindSafe(|| computation.run(work))) {
        Ok(result) => Some(result),
        Err(payload) if payload.is::<Stopped>() => None,
        Err(payload) => resume_unwind(payload),
    }
}

/// Calls `work` as a part of no computation: it is not stopped by the flag of the computation that runs on this thread. For tasks that a
/// waiting thread takes over.
pub fn detached<T>(work: impl FnOnce() -> T) -> T {
    Computation::default().run(work)
}

/// Returns the payload of a caught panic. If the payload is that of a stopped computation, goes on with unwinding instead. Every
/// `catch_unwind` around code with loops needs this.
pub fn caught(payload: Box<dyn Any + Send>) -> Box<dyn Any + Send> {
    if payload.is::<Stopped>() {
        resume_unwind(payload);
    }
    payload
}

/// Unwinds if the running computation is cancelled. A loop that is not parallel calls this at least every 50 ms. It takes a few
/// nanoseconds.
pub fn check_stop() {
    if CURRENT.with_borrow(|current| current.flag.as_deref().is_some_and(is_set)) {
        stop();
    }
}

fn is_set(flag: &AtomicBool) -> bool {
    flag.load(Ordering::Relaxed)
}

#[cold]
fn stop() {
    // Loops of destructors go on while the thread unwinds.
    if !panicking() {
        resume_unwind(Box::new(Stopped));
    }
}

/// The flag of a computation. Looking at it costs less than a nanosecond, so loops may look at each item.
#[derive(Clone, Debug)]
pub struct StopFlag(Option<Arc<AtomicBool>>);

impl StopFlag {
    /// The flag of the computation to which the running code belongs.
    pub fn current() -> Self {
        Self(CURRENT.with_borrow(|current| current.flag.clone()))
    }

    /// Unwinds if the computation is cancelled.
    #[inline]
    pub fn check(&self) {
        if self.0.as_deref().is_some_and(is_set) {
            stop();
        }
    }
}

/// Iterators that stop with the running computation.
pub trait UntilStopped: Iterator + Sized {
    /// The same items. Asking for an item unwinds if the running computation is cancelled. For long loops that are not parallel.
    fn until_stopped(self) -> StoppableIter<Self> {
        StoppableIter { items: self, stop: StopFlag::current(), counter: Counter::current() }
    }
}

impl<I: Iterator> UntilStopped for I {}

/// The items of an iterator, for as long as the computation is not cancelled.
#[derive(Clone, Debug)]
pub struct StoppableIter<I> {
    items: I,
    stop: StopFlag,
    counter: Counter,
}

/// Counts items for the meter of the computation.
#[derive(Clone, Debug)]
struct Counter {
    meter: Option<Arc<Meter>>,
    count: u32,
}

impl Counter {
    /// The number of items that are counted together.
    const BATCH: u32 = 1 << 14;

    fn current() -> Self {
        Self { meter: CURRENT.with_borrow(|current| current.meter.clone()), count: 0 }
    }

    #[inline]
    fn add_one(&mut self) {
        self.count += 1;
        if self.count == Self::BATCH {
            self.meter.iter().for_each(|meter| meter.add(Self::BATCH as usize));
            self.count = 0;
        }
    }
}

impl<I: Iterator> Iterator for StoppableIter<I> {
    type Item = I::Item;

    #[inline]
    fn next(&mut self) -> Option<I::Item> {
        self.stop.check();
        self.counter.add_one();
        self.items.next()
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        self.items.size_hint()
    }

    #[inline]
    fn fold<B, F: FnMut(B, I::Item) -> B>(self, init: B, mut f: F) -> B {
        let Self { items, stop, mut counter } = self;
        items.fold(init, |state, item| {
            stop.check();
            counter.add_one();
            f(state, item)
        })
    }
}

impl<I: DoubleEndedIterator> DoubleEndedIterator for StoppableIter<I> {
    fn next_back(&mut self) -> Option<I::Item> {
        self.stop.check();
        self.items.next_back()
    }
}

impl<I: ExactSizeIterator> ExactSizeIterator for StoppableIter<I> {}

impl Meter {
    /// Calls `work`. The items of its parallel loops and of its [`until_stopped`](UntilStopped::until_stopped) iterators are counted; those
    /// of loops inside of parallel loops are not.
    pub fn measure<T>(self: &Arc<Self>, work: impl FnOnce() -> T) -> T {
        Computation { meter: Some(self.clone()), ..Computation::current().part() }.run(work)
    }
}
