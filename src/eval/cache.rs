//! Results in memory, by key, the least recently used ones dropped first.

use std::collections::{BTreeMap, HashMap};
use std::sync::{Arc, Mutex};

use super::lock;
use crate::node::Memos;
use crate::value::{AnyValue, Hash};

/// What a node gave.
pub(super) struct Outcome {
    pub(super) values: Vec<AnyValue>,
    pub(super) warnings: Vec<String>,
    pub(super) bytes: usize,
}

impl Outcome {
    pub(super) fn new(values: Vec<AnyValue>, warnings: Vec<String>) -> Self {
        let bytes = values.iter().map(AnyValue::size).sum();
        Self { values, warnings, bytes }
    }
}

/// Results by key, at most `limit` bytes of them.
///
/// A column that two values share is counted twice, so that the true size is never above the counted one.
pub(super) struct Cache {
    limit: usize,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    entries: HashMap<Hash, Entry>,
    /// The entries by time of last use.
    by_use: BTreeMap<u64, Hash>,
    clock: u64,
    bytes: usize,
}

struct Entry {
    outcome: Arc<Outcome>,
    used: u64,
}

impl Cache {
    pub(super) fn new(limit: usize) -> Self {
        Self { limit, state: Mutex::default() }
    }

    pub(super) fn find(&self, key: Hash) -> Option<Arc<Outcome>> {
        let state = &mut *lock(&self.state);
        let entry = state.entries.get_mut(&key)?;
        state.clock += 1;
        state.by_use.remove(&entry.used);
        state.by_use.insert(state.clock, key);
        entry.used = state.clock;
        Some(entry.outcome.clone())
    }

    pub(super) fn keep(&self, key: Hash, outcome: Arc<Outcome>) {
        let state = &mut *lock(&self.state);
        state.clock += 1;
        state.bytes += outcome.bytes;
        state.by_use.insert(state.clock, key);
        let used = state.clock;
        if let Some(before) = state.entries.insert(key, Entry { outcome, used }) {
            state.bytes -= before.outcome.bytes;
            state.by_use.remove(&before.used);
        }
        while state.bytes > self.limit {
            let Some((_, oldest)) = state.by_use.pop_first() else { break };
            if let Some(dropped) = state.entries.remove(&oldest) {
                state.bytes -= dropped.outcome.bytes;
            }
        }
    }
}

impl Memos for Cache {
    fn find(&self, key: Hash) -> Option<AnyValue> {
        self.find(key).and_then(|outcome| outcome.values.first().cloned())
    }

    fn keep(&self, key: Hash, value: &AnyValue) {
        self.keep(key, Arc::new(Outcome::new(vec![value.clone()], Vec::new())));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::value::Mask;

    #[test]
    fn the_least_recently_used_result_is_dropped_first() {
        let cache = Cache::new(250);
        let keep = |name: &str| {
            let mask = Mask::new(100, 1, vec![0; 100]).unwrap();
            cache.keep(
                Hash::of(name.as_bytes()),
                Arc::new(Outcome::new(vec![AnyValue::new(mask)], vec![])),
            );
        };
        let has = |name: &str| cache.find(Hash::of(name.as_bytes())).is_some();
        keep("a");
        keep("b");
        assert!(has("a"));
        keep("c");
        assert!(has("a") && !has("b") && has("c"));
    }
}
