//! The memory limit of an evaluation. Decides which nodes may start, which must wait for others, and which fail.
//!
//! The limit covers values that nodes still need, the estimates of running nodes, and cached results. Cached results that no node needs are
//! dropped to make room. A node that has to wait is queued and visited again later; its thread does not block. A blocked thread could wait
//! for a node that is running deeper in its own stack, and would never continue.

use std::collections::{HashMap, HashSet};
use std::sync::{Mutex, OnceLock};

use maquette_node::budget::{Estimate, MemoryError};
use maquette_value::memory::available_memory;

use super::cache::Cache;
use super::lock;

/// The fraction of the free memory that an evaluation may use if no limit is set. If it used more, the system might kill processes.
const FREE_FRACTION: f64 = 0.9;

/// The memory in use by an evaluation.
pub(super) struct Memory {
    /// The limit in bytes. If it is `None`, the limit is a fraction of the free memory of the machine.
    given_limit: Option<u64>,
    max_bytes: OnceLock<u64>,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    /// The number of nodes that are being visited, or that will be visited without waiting for memory.
    active: usize,
    /// The number of bytes in values that nodes still need.
    held: u64,
    /// The number of bytes that are reserved for each running node.
    reserved_by_node: HashMap<usize, u64>,
    /// The sum of all reservations, in bytes.
    reserved: u64,
    /// The waiting nodes, each with the number of bytes that it needs.
    waiting: Vec<(usize, u64)>,
    /// The nodes that have waited at least once.
    has_waited: HashSet<usize>,
}

impl State {
    fn in_use(&self) -> u64 {
        self.held.saturating_add(self.reserved)
    }
}

impl Memory {
    pub(super) fn new(given: Option<u64>) -> Self {
        Self { given_limit: given, max_bytes: OnceLock::new(), state: Mutex::default() }
    }

    /// Returns the limit in bytes. The free memory of the machine is read when the first node is about to run.
    fn max_bytes(&self, cache: &Cache) -> u64 {
        *self.max_bytes.get_or_init(|| {
            self.given_limit.unwrap_or_else(|| match available_memory() {
                Some(bytes) => (bytes as f64 * FREE_FRACTION) as u64 + cache.bytes() as u64,
                None => u64::MAX,
            })
        })
    }

    /// Adds `count` nodes to the number of nodes being visited.
    pub(super) fn add_visits(&self, count: usize) {
        lock(&self.state).active += count;
    }

    /// Ends a visit. If no other node is being visited, returns the first waiting node. The caller must visit it now, because nothing else
    /// will free memory for it.
    pub(super) fn end_visit(&self) -> Option<usize> {
        let state = &mut *lock(&self.state);
        state.active -= 1;
        if state.active > 0 {
            return None;
        }
        let first = (0..state.waiting.len()).min_by_key(|&place| state.waiting[place].0)?;
        state.active = 1;
        Some(state.waiting.swap_remove(first).0)
    }

    /// Returns true if the node may start now; otherwise queues the node. `own` is the memory that is already held for this node in
    /// addition to its estimate.
    ///
    /// # Errors
    /// If the node needs more memory than the limit, or if no running node could free memory for it.
    pub(super) fn admit(
        &self,
        index: usize,
        estimate: Option<Estimate>,
        own: u64,
        cache: &Cache,
    ) -> Result<bool, MemoryError> {
        let max_bytes = self.max_bytes(cache);
        let state = &mut *lock(&self.state);
        let need = estimate.map_or(0, Estimate::whole_bytes).saturating_add(own);
        let all = state.in_use().saturating_add(need);
        if all <= max_bytes {
            state.reserved_by_node.insert(index, need);
            state.reserved += need;
            cache.drop_idle(max_bytes - all);
            return Ok(true);
        }
        // If the node needs more than the whole limit, waiting does not help.
        if state.active > 1 && need <= max_bytes {
            state.waiting.push((index, need));
            state.has_waited.insert(index);
            return Ok(false);
        }
        Err(no_room(estimate, state.in_use().saturating_add(own), max_bytes))
    }

    /// Returns true if the node has waited for memory at least once.
    pub(super) fn has_waited(&self, index: usize) -> bool {
        lock(&self.state).has_waited.contains(&index)
    }

    /// Queues nodes because they have the same key as a waiting node.
    pub(super) fn wait(&self, nodes: Vec<usize>) {
        lock(&self.state).waiting.extend(nodes.into_iter().map(|node| (node, 0)));
    }

    /// Checks that the memory for a node is free now. The node is computed again while others wait for it, so it cannot wait itself.
    ///
    /// # Errors
    /// If the memory is not free.
    pub(super) fn check_room(
        &self,
        estimate: Option<Estimate>,
        cache: &Cache,
    ) -> Result<(), MemoryError> {
        let max_bytes = self.max_bytes(cache);
        let in_use = lock(&self.state).in_use();
        let all = in_use.saturating_add(estimate.map_or(0, Estimate::whole_bytes));
        if max_bytes < all {
            return Err(no_room(estimate, in_use, max_bytes));
        }
        cache.drop_idle(max_bytes - all);
        Ok(())
    }

    /// Removes the memory reservation of a finished node. Returns the waiting nodes that may start now.
    pub(super) fn finish_node(&self, index: usize, cache: &Cache) -> Vec<usize> {
        let state = &mut *lock(&self.state);
        let Some(need) = state.reserved_by_node.remove(&index) else { return Vec::new() };
        state.reserved -= need;
        let max_bytes = self.max_bytes(cache);
        cache.drop_idle(max_bytes.saturating_sub(state.in_use()));
        let mut room = max_bytes.saturating_sub(state.in_use());
        state
            .waiting
            .extract_if(.., |&mut (_, need): &mut (usize, u64)| match room.checked_sub(need) {
                Some(rest) => {
                    room = rest;
                    true
                }
                None => false,
            })
            .map(|(node, _)| node)
            .collect()
    }

    /// Counts the bytes of values as held, until they are [released](Self::release).
    pub(super) fn hold(&self, bytes: u64) {
        lock(&self.state).held += bytes;
    }

    pub(super) fn release(&self, bytes: u64) {
        lock(&self.state).held -= bytes;
    }
}

fn no_room(estimate: Option<Estimate>, held: u64, max_bytes: u64) -> MemoryError {
    // A node without an estimate fails only because other values fill the memory.
    let none = Estimate { bytes: 0.0, help: "ask for less at a time (--only)" };
    let Estimate { bytes: need, help } = estimate.unwrap_or(none);
    MemoryError { need, held, most: max_bytes, help }
}
