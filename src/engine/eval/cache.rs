//! The memory cache: results of nodes by key. If they exceed a limit, the least recently used results are dropped first.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};
use std::panic::AssertUnwindSafe;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use maquette_node::{Memos, ValueSize};
use maquette_value::parallel::caught;
use maquette_value::{AnyValue, Fact, FactValue, Hash, Points, PointsDigest, Value};

use super::lock;

/// The values of a node's outputs.
pub(super) type Values = Arc<[AnyValue]>;

/// The result of a node. The hashes of the values are always present. The values themselves may be dropped to save memory.
pub(super) struct Outcome {
    /// The type name and the hash of the value of each output.
    pub(super) outputs: Box<[(&'static str, Hash)]>,
    pub(super) warnings: Box<[String]>,
    /// A short description of each value, such as `1024 x 768`. Empty if the descriptions are unknown.
    pub(super) descriptions: Box<[String]>,
    /// The size of each value. Empty if the sizes are unknown.
    pub(super) sizes: Box<[ValueSize]>,
    /// The memory that the values need, in bytes, even if they have been dropped.
    pub(super) bytes: usize,
    /// The time that the computation of the values took, in seconds.
    pub(super) seconds: f64,
    values: Mutex<Option<Values>>,
    last_use: AtomicU64,
    /// True if the result is not on disk because writing was turned off when it was computed.
    is_unsaved: AtomicBool,
}

impl Outcome {
    pub(super) fn new(values: &Values, warnings: Vec<String>, seconds: f64) -> Self {
        let outputs = values.iter().map(|value| (value.kind().name, value.hash())).collect();
        let bytes = values.iter().map(AnyValue::size).sum();
        let shapes = values.iter().map(description).collect();
        let sizes = values.iter().map(size).collect();
        let outcome = Self::without_values(outputs, warnings, bytes, seconds);
        Self { values: Mutex::new(Some(values.clone())), descriptions: shapes, sizes, ..outcome }
    }

    /// Creates the outcome of a node whose points were hashed in blocks, without its values.
    pub(super) fn of_points(points: &PointsDigest, seconds: f64) -> Self {
        let outputs = [(Points::NAME, points.hash)].into();
        let description = format!("{} points", FactValue::Count(points.count));
        let outcome = Self::without_values(outputs, Vec::new(), points.bytes, seconds);
        let size = ValueSize::points(points.count as f64, 0.0);
        let attributes = points.bytes as f64 - size.bytes;
        outcome.with_descriptions(vec![description], vec![size.with_more_bytes(attributes)])
    }

    /// Creates an outcome from the hashes of its values. The values can be attached later.
    pub(super) fn without_values(
        outputs: Box<[(&'static str, Hash)]>,
        warnings: Vec<String>,
        bytes: usize,
        seconds: f64,
    ) -> Self {
        let warnings = warnings.into();
        Self {
            outputs,
            warnings,
            descriptions: Box::default(),
            sizes: Box::default(),
            bytes,
            seconds,
            values: Mutex::default(),
            last_use: AtomicU64::new(0),
            is_unsaved: AtomicBool::new(false),
        }
    }

    /// Adds short descriptions of the values, and their sizes.
    pub(super) fn with_descriptions(self, shapes: Vec<String>, sizes: Vec<ValueSize>) -> Self {
        Self { descriptions: shapes.into(), sizes: sizes.into(), ..self }
    }

    /// Returns the values, or `None` if they are not in memory.
    pub(super) fn values(&self) -> Option<Values> {
        lock(&self.values).clone()
    }

    pub(super) fn has_values(&self) -> bool {
        lock(&self.values).is_some()
    }

    /// Marks the result so that it is written to disk when writing is turned on again.
    pub(super) fn mark_unsaved(&self) {
        self.is_unsaved.store(true, Ordering::Relaxed);
    }

    /// Returns true if the result is marked as not yet written to disk, and removes the mark.
    pub(super) fn take_unsaved(&self) -> bool {
        self.is_unsaved.load(Ordering::Relaxed) && self.is_unsaved.swap(false, Ordering::Relaxed)
    }

    fn last_use(&self) -> u64 {
        self.last_use.load(Ordering::Relaxed)
    }

    /// Returns true if another outcome has the same values.
    pub(super) fn equals(&self, other: &Self) -> bool {
        self.outputs == other.outputs
    }
}

/// Returns the first facts about a value, such as `1024 x 768` or `12 vertices, 20 faces`. The code of the value's type may panic; then the
/// description is empty.
fn description(value: &AnyValue) -> String {
    let described = std::panic::catch_unwind(AssertUnwindSafe(|| facts(value)));
    described.map_err(caught).unwrap_or_default()
}

/// Returns the size of a value. If the code of the value's type panics, only its memory.
fn size(value: &AnyValue) -> ValueSize {
    let size = std::panic::catch_unwind(AssertUnwindSafe(|| ValueSize::of_value(value)));
    size.map_err(caught)
        .unwrap_or_else(|_| ValueSize::items(0.0, 0.0).with_more_bytes(value.size() as f64))
}

fn facts(value: &AnyValue) -> String {
    const MAX_FACTS: usize = 3;
    fn fact(fact: Fact) -> Option<String> {
        match fact.value {
            FactValue::Flag(false) => None,
            FactValue::Flag(true) => Some(fact.name.into_owned()),
            FactValue::Text(text) => Some(text),
            FactValue::Count(1) if fact.name.ends_with('s') => {
                Some(format!("1 {}", fact.name.trim_end_matches('s')))
            }
            FactValue::Count(_) if fact.name.ends_with(['s', 'x']) => {
                Some(format!("{} {}", fact.value, fact.name))
            }
            FactValue::Count(_) => Some(format!("{} {}", fact.name, fact.value)),
            FactValue::Size(_) => Some(fact.value.to_string()),
        }
    }
    let facts = value.parts().facts.into_iter().filter_map(fact).take(MAX_FACTS);
    Vec::from_iter(facts).join(", ")
}

/// Outcomes by key. Their values take at most `limit` bytes together.
///
/// A data column that two values share is counted twice, so the counted size is never smaller than the true size.
pub(super) struct Cache {
    limit: usize,
    clock: AtomicU64,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    entries: HashMap<Hash, Arc<Outcome>, BuildHasherDefault<FirstBytes>>,
    bytes: usize,
}

/// A hasher that returns the first bytes of a key. Keys are already hashes, so they need no further hashing.
#[derive(Default)]
pub(super) struct FirstBytes(u64);

impl Hasher for FirstBytes {
    fn finish(&self) -> u64 {
        self.0
    }

    fn write(&mut self, bytes: &[u8]) {
        if let Some(first) = bytes.first_chunk() {
            self.0 = u64::from_le_bytes(*first);
        }
    }

    fn write_usize(&mut self, _: usize) {}
}

/// The memory that an entry needs in addition to its values, in bytes.
const OVERHEAD: usize = 512;

impl Cache {
    pub(super) fn new(limit: usize) -> Self {
        Self { limit, clock: AtomicU64::new(0), state: Mutex::default() }
    }

    /// Sets the maximum size of all entries together, in bytes.
    pub(super) fn set_limit(&mut self, limit: usize) {
        self.limit = limit;
        lock(&self.state).shrink(limit);
    }

    /// Returns the maximum size of all entries together, in bytes.
    pub(super) fn limit(&self) -> usize {
        self.limit
    }

    /// Drops values to which only the cache refers, the least recently used first, until all such values together take at most `most`
    /// bytes.
    pub(super) fn drop_idle(&self, most: u64) {
        let state = &mut *lock(&self.state);
        if state.bytes as u64 <= most {
            return;
        }
        fn is_idle(entry: &Outcome) -> bool {
            lock(&entry.values).as_ref().is_some_and(|values| Arc::strong_count(values) == 1)
        }
        let idle = state.entries.iter().filter(|(_, entry)| is_idle(entry));
        let mut idle: Vec<_> =
            idle.map(|(key, entry)| (entry.last_use(), *key, entry.bytes as u64)).collect();
        idle.sort_unstable_by(|a, b| b.cmp(a));
        let mut left: u64 = idle.iter().map(|(.., bytes)| bytes).sum();
        while most < left {
            let Some((_, oldest, bytes)) = idle.pop() else { break };
            state.drop_entry(oldest);
            left -= bytes;
        }
    }

    pub(super) fn find(&self, key: Hash) -> Option<Arc<Outcome>> {
        let outcome = lock(&self.state).entries.get(&key).cloned()?;
        self.touch(&outcome);
        Some(outcome)
    }

    fn touch(&self, outcome: &Outcome) {
        outcome.last_use.store(self.clock.fetch_add(1, Ordering::Relaxed), Ordering::Relaxed);
    }

    pub(super) fn keep(&self, key: Hash, outcome: Arc<Outcome>) {
        self.touch(&outcome);
        let state = &mut *lock(&self.state);
        state.bytes += outcome.bytes + OVERHEAD;
        if let Some(before) = state.entries.insert(key, outcome) {
            state.bytes -= before.bytes + OVERHEAD;
        }
        if self.limit < state.bytes {
            state.shrink(self.limit - self.limit / 8);
        }
    }

    /// Attaches values, which were read from disk, to the outcome with this key.
    pub(super) fn hold(&self, key: Hash, outcome: &Arc<Outcome>, values: &Values) {
        *lock(&outcome.values) = Some(values.clone());
        self.keep(key, outcome.clone());
    }

    /// Returns the size of all entries together, in bytes.
    pub(super) fn bytes(&self) -> usize {
        lock(&self.state).bytes
    }

    pub(super) fn clear(&self) {
        *lock(&self.state) = State::default();
    }
}

impl State {
    /// Drops the least recently used entries until the remaining entries take at most `goal` bytes.
    fn shrink(&mut self, goal: usize) {
        let mut by_use: Vec<_> =
            self.entries.iter().map(|(key, entry)| (entry.last_use(), *key)).collect();
        by_use.sort_unstable_by(|a, b| b.cmp(a));
        while goal < self.bytes {
            let Some((_, oldest)) = by_use.pop() else { break };
            self.drop_entry(oldest);
        }
    }

    fn drop_entry(&mut self, key: Hash) {
        if let Some(dropped) = self.entries.remove(&key) {
            self.bytes -= dropped.bytes + OVERHEAD;
            *lock(&dropped.values) = None;
        }
    }
}

impl Memos for Cache {
    fn find(&self, key: Hash) -> Option<AnyValue> {
        self.find(key)?.values()?.first().cloned()
    }

    fn keep(&self, key: Hash, value: &AnyValue) {
        let values: Values = [value.clone()].into();
        self.keep(key, Arc::new(Outcome::new(&values, Vec::new(), 0.0)));
    }
}

#[cfg(test)]
mod tests {
    use maquette_value::Mask;

    use super::*;

    #[test]
    fn the_least_recently_used_values_are_dropped_first_even_if_their_outcome_is_in_use() {
        let cache = Cache::new(16_000);
        fn key(name: &str) -> Hash {
            Hash::compute(name.as_bytes())
        }
        fn keep(name: &str, cache: &Cache) -> Arc<Outcome> {
            let mask = Mask::new(5000, 1, vec![0; 5000]).unwrap();
            let values: Values = [AnyValue::new(mask)].into();
            let outcome = Arc::new(Outcome::new(&values, vec![], 0.0));
            cache.keep(key(name), outcome.clone());
            outcome
        }
        let (a, b) = (keep("a", &cache), keep("b", &cache));
        assert!(cache.find(key("a")).is_some());
        let c = keep("c", &cache);
        assert!(cache.find(key("a")).is_some() && cache.find(key("b")).is_none());
        assert!(a.has_values() && !b.has_values() && c.has_values());
    }
}
