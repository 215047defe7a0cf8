//! The memory limit of an evaluation. Decides which nodes may start, which must wait until other nodes free memory, and which fail.
//!
//! The limit covers values that nodes still need, the estimates of running nodes, and cached results. Cached results that no node needs are
//! dropped to make room. A node that has to wait is queued and visited again later; its thread does not block. A blocked thread could
//! deadlock: it might wait for a node that is suspended further down on the thread's own stack.

use std::collections::{HashMap, HashSet};
use std::sync::{Mutex, OnceLock};

use maquette_node::budget::{Estimate, MemoryError};
use maquette_value::memory::available_memory;

use super::cache::Cache;
use super::lock;

/// The fraction of the free memory that an evaluation may use if no limit is set. With a higher fraction, the system might kill processes.
const FREE_FRACTION: f64 = 0.9;

/// Returns the limit in bytes: `given`, or a fraction of the free memory of the machine and of that of cached results.
pub(super) fn max_bytes(given: Option<u64>, cache: &Cache) -> u64 {
    given.unwrap_or_else(|| match available_memory() {
        Some(bytes) => (bytes as f64 * FREE_FRACTION) as u64 + cache.bytes() as u64,
        None => u64::MAX,
    })
}

/// The memory in use by an evaluation.
pub(super) struct Memory {
    /// The limit in bytes. If it is `None`, the limit is [`FREE_FRACTION`] of the free memory of the machine.
    given_limit: Option<u64>,
    max_bytes: OnceLock<u64>,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    /// The number of active nodes: those that are being visited, and those that are about to be visited without waiting for memory.
    active: usize,
    /// The size of the values that nodes still need, in bytes.
    held: u64,
    /// The number of bytes reserved for each running node, by the index of the node.
    reserved_by_node: HashMap<usize, u64>,
    /// The sum of all reservations, in bytes.
    reserved: u64,
    /// The nodes that wait for memory, each with the number of bytes that it needs.
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

    /// Returns the limit in bytes. If no limit is set, the free memory of the machine is read at the first call.
    fn max_bytes(&self, cache: &Cache) -> u64 {
        *self.max_bytes.get_or_init(|| max_bytes(self.given_limit, cache))
    }

    /// Adds `count` to the number of nodes that are being visited.
    pub(super) fn add_visits(&self, count: usize) {
        lock(&self.state).active += count;
    }

    /// Ends the visit of a node. If no other node is being visited, returns the waiting node with the lowest index. The caller must visit
    /// that node now, because no running node can free memory for it.
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

    /// Returns true if there is memory for the node to start now; otherwise queues the node. `own` is the number of bytes that are already
    /// in memory for this node alone, in addition to its estimate.
    ///
    /// # Errors
    /// If the node needs more memory than the limit, or if no node is running that could free memory for it.
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
        // Do not wait if the node needs more than the whole limit.
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

    /// Queues nodes that have the same key as a node that waits for memory, because they need the result of that node.
    pub(super) fn wait(&self, nodes: Vec<usize>) {
        lock(&self.state).waiting.extend(nodes.into_iter().map(|node| (node, 0)));
    }

    /// Checks that enough memory for a node is free now. The lost values of the node are being computed again, and other nodes wait for
    /// these values. So the node must not itself wait for memory.
    ///
    /// # Errors
    /// If there is not enough free memory.
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

    /// Counts `bytes` as values in use, until they are [released](Self::release).
    pub(super) fn hold(&self, bytes: u64) {
        lock(&self.state).held += bytes;
    }

    pub(super) fn release(&self, bytes: u64) {
        lock(&self.state).held -= bytes;
    }
}

fn no_room(estimate: Option<Estimate>, held: u64, max_bytes: u64) -> MemoryError {
    // Use an estimate of 0 bytes: a node without an estimate fails only because other values fill the memory.
    let none = Estimate { bytes: 0.0, help: "ask for less at a time (--only)" };
    let Estimate { bytes: need, help } = estimate.unwrap_or(none);
    MemoryError { need, held, most: max_bytes, help, fits: None }
}
