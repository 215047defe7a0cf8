//! Results in memory, by key, the least recently used ones dropped first.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};
use std::panic::AssertUnwindSafe;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use maquette_node::Memos;
use maquette_value::{AnyValue, Fact, FactValue, Hash};

use super::lock;

/// The values of a node's outputs.
pub(super) type Values = Arc<[AnyValue]>;

/// What a node gave: always what the values are, and the values themselves as long as there is memory for them.
pub(super) struct Outcome {
    /// The type and the hash of each output.
    pub(super) outputs: Box<[(&'static str, Hash)]>,
    pub(super) warnings: Box<[String]>,
    /// What the values are in a few words, such as their counts; empty where that is not known.
    pub(super) shapes: Box<[String]>,
    /// How much memory the values need.
    pub(super) bytes: usize,
    /// How long it took to compute them.
    pub(super) seconds: f64,
    values: Mutex<Option<Values>>,
    used: AtomicU64,
    /// Whether it is not on disk only because nothing was to be put there when it was made.
    owed: AtomicBool,
}

impl Outcome {
    pub(super) fn new(values: &Values, warnings: Vec<String>, seconds: f64) -> Self {
        let outputs = values.iter().map(|value| (value.kind().name, value.hash())).collect();
        let bytes = values.iter().map(AnyValue::size).sum();
        let shapes = values.iter().map(shape).collect();
        let known = Self::known(outputs, warnings, bytes, seconds);
        Self { values: Mutex::new(Some(values.clone())), shapes, ..known }
    }

    /// An outcome without its values.
    pub(super) fn known(
        outputs: Box<[(&'static str, Hash)]>,
        warnings: Vec<String>,
        bytes: usize,
        seconds: f64,
    ) -> Self {
        let warnings = warnings.into();
        Self {
            outputs,
            warnings,
            shapes: Box::default(),
            bytes,
            seconds,
            values: Mutex::default(),
            used: AtomicU64::new(0),
            owed: AtomicBool::new(false),
        }
    }

    /// The same, with what its values are in a few words.
    pub(super) fn shaped(self, shapes: Vec<String>) -> Self {
        Self { shapes: shapes.into(), ..self }
    }

    /// The values, if they are in memory.
    pub(super) fn values(&self) -> Option<Values> {
        lock(&self.values).clone()
    }

    pub(super) fn has_values(&self) -> bool {
        lock(&self.values).is_some()
    }

    /// It would be on disk if something were put there.
    pub(super) fn owe(&self) {
        self.owed.store(true, Ordering::Relaxed);
    }

    /// Whether it should be put on disk now; from then on it need not.
    pub(super) fn settle(&self) -> bool {
        self.owed.load(Ordering::Relaxed) && self.owed.swap(false, Ordering::Relaxed)
    }

    /// Whether another outcome has the same values.
    pub(super) fn equals(&self, other: &Self) -> bool {
        self.outputs == other.outputs
    }
}

/// `1024 x 768`, `12 vertices, 20 faces`: the first facts of a value; empty if its type cannot say them.
fn shape(value: &AnyValue) -> String {
    std::panic::catch_unwind(AssertUnwindSafe(|| facts(value))).unwrap_or_default()
}

fn facts(value: &AnyValue) -> String {
    const MOST: usize = 3;
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
    let facts = value.parts().facts.into_iter().filter_map(fact).take(MOST);
    Vec::from_iter(facts).join(", ")
}

/// Outcomes by key, whose values are at most `limit` bytes together.
///
/// A column that two values share is counted twice, so that the true size is never above the counted one.
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

/// Keys are hashes already: their first bytes will do.
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

/// What an entry needs beside its values.
const OVERHEAD: usize = 512;

impl Cache {
    pub(super) fn new(limit: usize) -> Self {
        Self { limit, clock: AtomicU64::new(0), state: Mutex::default() }
    }

    /// Allows so many bytes from now on.
    pub(super) fn set_limit(&mut self, limit: usize) {
        self.limit = limit;
        lock(&self.state).shrink(limit);
    }

    /// How many bytes are allowed.
    pub(super) fn limit(&self) -> usize {
        self.limit
    }

    /// Drops values that nobody else holds until those left of them are at most this many bytes; those used longest ago go first.
    pub(super) fn make_way(&self, most: u64) {
        let state = &mut *lock(&self.state);
        if state.bytes as u64 <= most {
            return;
        }
        fn is_idle(entry: &Outcome) -> bool {
            lock(&entry.values).as_ref().is_some_and(|values| Arc::strong_count(values) == 1)
        }
        let idle = state.entries.iter().filter(|(_, entry)| is_idle(entry));
        fn used(entry: &Outcome) -> u64 {
            entry.used.load(Ordering::Relaxed)
        }
        let mut idle =
            idle.map(|(key, entry)| (used(entry), *key, entry.bytes as u64)).collect::<Vec<_>>();
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
        outcome.used.store(self.clock.fetch_add(1, Ordering::Relaxed), Ordering::Relaxed);
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

    /// Gives values that were read back to their outcome.
    pub(super) fn hold(&self, key: Hash, outcome: &Arc<Outcome>, values: &Values) {
        *lock(&outcome.values) = Some(values.clone());
        self.keep(key, outcome.clone());
    }

    /// How many bytes all that is held counts as.
    pub(super) fn bytes(&self) -> usize {
        lock(&self.state).bytes
    }

    pub(super) fn clear(&self) {
        *lock(&self.state) = State::default();
    }
}

impl State {
    /// Drops the values that were not used for the longest time, until this many bytes are left.
    fn shrink(&mut self, goal: usize) {
        fn used(outcome: &Outcome) -> u64 {
            outcome.used.load(Ordering::Relaxed)
        }
        let mut by_use =
            self.entries.iter().map(|(key, entry)| (used(entry), *key)).collect::<Vec<_>>();
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
    fn the_least_recently_used_values_are_dropped_first_even_if_somebody_holds_their_outcome() {
        let cache = Cache::new(16_000);
        fn key(name: &str) -> Hash {
            Hash::of(name.as_bytes())
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
