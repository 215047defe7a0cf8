//! Counting the items that loops visit: the progress of code that does not report it.

use std::sync::atomic::{AtomicU64, Ordering};

/// Counts the items that loops have visited.
#[derive(Debug, Default)]
pub struct Meter(AtomicU64);

impl Meter {
    /// The number of items so far.
    pub fn items(&self) -> u64 {
        self.0.load(Ordering::Relaxed)
    }

    pub(super) fn add(&self, items: usize) {
        self.0.fetch_add(items as u64, Ordering::Relaxed);
    }
}
