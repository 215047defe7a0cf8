//! How much memory an evaluation may hold: which node may begin, which waits for others, and which is refused.
//!
//! Three things count: values that are held for nodes which need them, what nodes under way may need by their own estimates, and
//! results that nobody needs. The last make way. No thread waits here: a thread that waited might be the one that runs, further
//! down in its stack, the node that it waits for. So a node that has to wait is put aside and visited again.

use std::collections::{HashMap, HashSet};
use std::sync::{Mutex, OnceLock};

use maquette_node::limit::{Estimate, NoRoom};
use maquette_value::memory::left;

use super::cache::Cache;
use super::lock;

/// Which share of what the machine has left an evaluation may take if nobody says how much: above it the system looks for a
/// process to kill.
const SHARE: f64 = 0.9;

/// What an evaluation holds.
pub(super) struct Memory {
    /// Bytes that may be held; none for a share of what the machine has left.
    given: Option<u64>,
    most: OnceLock<u64>,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    /// How many nodes are being visited, or will be without waiting for memory.
    active: usize,
    /// Bytes of values that nodes still need.
    held: u64,
    /// What each node under way may need, in bytes.
    promises: HashMap<usize, u64>,
    /// All of these together.
    promised: u64,
    /// The nodes that wait, each with what it needs.
    waiting: Vec<(usize, u64)>,
    /// The nodes that have waited.
    aside: HashSet<usize>,
}

impl State {
    fn in_use(&self) -> u64 {
        self.held.saturating_add(self.promised)
    }
}

impl Memory {
    pub(super) fn new(given: Option<u64>) -> Self {
        Self { given, most: OnceLock::new(), state: Mutex::default() }
    }

    /// How many bytes may be held. What the machine has left is asked when the first node is about to run.
    fn most(&self, cache: &Cache) -> u64 {
        *self.most.get_or_init(|| {
            self.given.unwrap_or_else(|| match left() {
                Some(bytes) => (bytes as f64 * SHARE) as u64 + cache.bytes() as u64,
                None => u64::MAX,
            })
        })
    }

    /// So many nodes are visited from now on.
    pub(super) fn begin(&self, count: usize) {
        lock(&self.state).active += count;
    }

    /// A visit is over, and no other follows it. If there is none at all any more, the first node that waits is to be visited: what it
    /// waited for will not come.
    pub(super) fn end(&self) -> Option<usize> {
        let state = &mut *lock(&self.state);
        state.active -= 1;
        if state.active > 0 {
            return None;
        }
        let first = (0..state.waiting.len()).min_by_key(|&place| state.waiting[place].0)?;
        state.active = 1;
        Some(state.waiting.swap_remove(first).0)
    }

    /// Whether a node may begin now; else it waits. `own` is what is held for it beside what it says to need.
    ///
    /// # Errors
    /// If there is too little room, and nobody whom it could wait for.
    pub(super) fn admit(
        &self,
        index: usize,
        estimate: Option<Estimate>,
        own: u64,
        cache: &Cache,
    ) -> Result<bool, NoRoom> {
        let most = self.most(cache);
        let state = &mut *lock(&self.state);
        let need = estimate.map_or(0, Estimate::whole).saturating_add(own);
        let all = state.in_use().saturating_add(need);
        if all <= most {
            state.promises.insert(index, need);
            state.promised += need;
            cache.make_way(most - all);
            return Ok(true);
        }
        // Alone it would need too much, too: waiting is of no use.
        if state.active > 1 && need <= most {
            state.waiting.push((index, need));
            state.aside.insert(index);
            return Ok(false);
        }
        Err(refused(estimate, state.in_use().saturating_add(own), most))
    }

    /// Whether a node has waited before.
    pub(super) fn has_put_aside(&self, index: usize) -> bool {
        lock(&self.state).aside.contains(&index)
    }

    /// These nodes wait, too: they are the same as one that does.
    pub(super) fn wait(&self, nodes: Vec<usize>) {
        lock(&self.state).waiting.extend(nodes.into_iter().map(|node| (node, 0)));
    }

    /// Whether what a node needs is there now: for one that is computed again while others wait for it.
    ///
    /// # Errors
    /// If it is not.
    pub(super) fn fits(&self, estimate: Option<Estimate>, cache: &Cache) -> Result<(), NoRoom> {
        let most = self.most(cache);
        let in_use = lock(&self.state).in_use();
        let all = in_use.saturating_add(estimate.map_or(0, Estimate::whole));
        if most < all {
            return Err(refused(estimate, in_use, most));
        }
        cache.make_way(most - all);
        Ok(())
    }

    /// A node has come to its end, and what only it needed is dropped. Gives the nodes that need wait no longer.
    pub(super) fn leave(&self, index: usize, cache: &Cache) -> Vec<usize> {
        let state = &mut *lock(&self.state);
        let Some(need) = state.promises.remove(&index) else { return Vec::new() };
        state.promised -= need;
        let most = self.most(cache);
        cache.make_way(most.saturating_sub(state.in_use()));
        let mut room = most.saturating_sub(state.in_use());
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

    /// Values are held from now on, until they are [let go](Self::let_go).
    pub(super) fn hold(&self, bytes: u64) {
        lock(&self.state).held += bytes;
    }

    pub(super) fn let_go(&self, bytes: u64) {
        lock(&self.state).held -= bytes;
    }
}

fn refused(estimate: Option<Estimate>, held: u64, most: u64) -> NoRoom {
    // One that says nothing is refused only because others hold all that there is.
    let none = Estimate { bytes: 0.0, help: "ask for less at a time (--only)" };
    let Estimate { bytes: need, help } = estimate.unwrap_or(none);
    NoRoom { need, held, most, help }
}
