//! The span of a computation: the time that it would take on unlimited threads.
//!
//! While a span is measured, the parts of parallel loops run one after another on the calling thread. Of each loop only the longest part
//! belongs to the span, see Brent, "The parallel evaluation of general arithmetic expressions" (1974).

use std::cell::Cell;
use std::time::Duration;

/// The time of a computation on one thread, and on unlimited threads.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WorkSpan {
    /// The time on one thread.
    pub work: Duration,
    /// The time on unlimited threads: of serial code, and of the longest part of each loop.
    pub span: Duration,
}

impl WorkSpan {
    /// Brent's bound of the time on `threads` threads: `span + (work - span) / threads`.
    #[must_use]
    pub fn on(self, threads: u32) -> Duration {
        self.span + (self.work - self.span) / threads
    }
}

/// A measurement on the calling thread.
#[derive(Clone, Copy)]
struct Measurement {
    clock: fn() -> Duration,
    start: Duration,
    /// The time that does not belong to the span.
    hidden: Duration,
}

thread_local! {
    static MEASUREMENT: Cell<Option<Measurement>> = const { Cell::new(None) };
}

/// Starts to measure work and span on the calling thread, which must be the only one of its pool. `clock` returns a time, preferably the
/// CPU time of the calling thread.
pub fn start_span(clock: fn() -> Duration) {
    MEASUREMENT.set(Some(Measurement { clock, start: clock(), hidden: Duration::ZERO }));
}

/// Ends the measurement on the calling thread. `None` if none was started.
pub fn finish_span() -> Option<WorkSpan> {
    let Measurement { clock, start, hidden } = MEASUREMENT.take()?;
    let work = clock().saturating_sub(start);
    Some(WorkSpan { work, span: work.saturating_sub(hidden) })
}

/// A parallel loop while a span is measured.
pub(super) struct Loop {
    outer: Measurement,
    work: Duration,
    span: Duration,
}

impl Loop {
    /// Begins a loop. `None` if no span is being measured on the calling thread.
    pub(super) fn begin() -> Option<Self> {
        let outer = MEASUREMENT.get()?;
        Some(Self { outer, work: Duration::ZERO, span: Duration::ZERO })
    }

    /// Runs a part of the loop.
    pub(super) fn run<T>(&mut self, part: impl FnOnce() -> T) -> T {
        start_span(self.outer.clock);
        let result = part();
        if let Some(WorkSpan { work, span }) = finish_span() {
            self.work += work;
            self.span = self.span.max(span);
        }
        result
    }

    /// Ends the loop.
    pub(super) fn end(self) {
        let hidden = self.outer.hidden + self.work.saturating_sub(self.span);
        MEASUREMENT.set(Some(Measurement { hidden, ..self.outer }));
    }
}

/// Runs a quicksort of `len` items. Its span is that of its partitions of `len`, `len / 2`, .. items: `2 / log2(len)` of its work.
pub(super) fn sort(len: usize, sort: impl FnOnce()) {
    let Some(mut parts) = Loop::begin() else { return sort() };
    parts.run(sort);
    parts.span = parts.work * 2 / len.max(4).ilog2();
    parts.end();
}
