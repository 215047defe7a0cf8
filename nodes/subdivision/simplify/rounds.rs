//! Simplification of large meshes by rounds of independent collapses, on all threads.
//!
//! A priority queue performs one collapse after the other. Here each round performs many: those edges whose costs are among the lowest, and
//! lower than that of every other such edge nearby. Luby, "A simple parallel algorithm for the maximal independent set problem" (1986);
//! with the same result for any number of threads: Blelloch, Fineman, Gibbons and Shun, "Internally deterministic parallel algorithms can
//! be fast" (2012).

use std::sync::atomic::{AtomicU32, Ordering};

use maquette_node::{CancelledError, Progress};
use maquette_value::parallel::*;

use super::net::{Collapse, Net};

/// The rounds end when this many vertices are left to be removed: then a round would perform only few collapses.
const FEW: usize = 500;

/// The class of collapses that are outdated or not allowed. Costs have lower ones.
const DEAD: u16 = u16::MAX;

/// The rank at vertices where none of the round's collapses ends.
const NONE: u32 = u32::MAX;

/// The collapses from which the rounds choose.
pub(super) struct Rounds {
    collapses: Vec<Collapse>,
    /// The class of each collapse: its cost, rounded such that there are few classes.
    classes: Vec<u16>,
    /// For each vertex the lowest rank of a collapse that takes part in the round and ends there.
    lowest: Vec<AtomicU32>,
    /// The collapses that take part in the round. Kept for its memory.
    ranked: Vec<Ranked>,
}

/// A collapse that takes part in a round. It is ordered by cost, then by length. A hash breaks ties: by index, neighbors in flat parts
/// would have to wait for each other in long chains.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Ranked {
    cost: u64,
    length: u64,
    hash: u32,
    index: u32,
}

impl Rounds {
    pub(super) fn new(collapses: Vec<Collapse>, net: &Net) -> Self {
        let lowest = (0..net.vertices()).map(|_| AtomicU32::new(NONE)).collect();
        Self { collapses, classes: Vec::new(), lowest, ranked: Vec::new() }
    }

    /// Performs collapses until only a few are left to be done to reach `target` triangles, or none is possible. Returns the collapses that
    /// may still be possible, outdated ones among them.
    pub(super) fn run(
        mut self,
        net: &mut Net,
        target: usize,
        progress: &Progress<'_>,
    ) -> Result<Vec<Collapse>, CancelledError> {
        let begin = net.n_faces;
        while 2 * FEW < net.n_faces.saturating_sub(target) {
            progress.tick((begin - net.n_faces) as f64 / (begin - target) as f64)?;
            if !self.round(net, target) {
                break;
            }
        }
        Ok(self.collapses)
    }

    /// Performs collapses that do not influence each other. Returns false if there is none from which to choose.
    fn round(&mut self, net: &mut Net, target: usize) -> bool {
        // Drop outdated collapses once they are most of the list. There are three edges for two triangles.
        if 3 * net.n_faces < self.collapses.len() {
            let alive = self.collapses.par_iter().zip(&self.classes).with_min_len(4096);
            let current = alive.filter(|(it, class)| **class < DEAD && net.is_current(it));
            self.collapses = current.map(|(it, _)| *it).collect();
            self.classes.clear();
        }
        let new = self.collapses[self.classes.len()..].par_iter().with_min_len(4096);
        new.map(|collapse| class(collapse.cost)).collect_into(&mut self.classes);

        // Only as many take part as half of the vertices that have to go. With more, some would be collapsed long before their turn.
        let last = self.class_of_rank((net.n_faces - target) / 4);
        let all = self.classes.par_iter_mut().zip(&self.collapses).enumerate();
        self.ranked.clear();
        all.with_min_len(4096)
            .filter_map(|(index, (class, collapse))| {
                if last < *class {
                    return None;
                }
                if !net.is_current(collapse) {
                    *class = DEAD;
                    return None;
                }
                Some(Ranked::new(collapse, index as u32))
            })
            .collect_into(&mut self.ranked);
        self.ranked.par_sort_unstable();
        let chosen = self.lowest_around(net);
        let allowed: Vec<bool> = chosen
            .par_iter()
            .with_min_len(64)
            .map(|&index| net.allows(&self.collapses[index as usize]))
            .collect();
        let mut merged = Vec::with_capacity(chosen.len());
        let chosen = chosen.into_iter().map(|index| index as usize).zip(allowed);
        for (index, is_allowed) in chosen.until_stopped() {
            if !is_allowed {
                self.classes[index] = DEAD;
            } else if target < net.n_faces {
                let collapse = self.collapses[index];
                net.apply(&collapse);
                merged.push(collapse.ends[0]);
            }
        }
        let net = &*net;
        let changed = merged.par_iter().with_min_len(64).flat_map_iter(|&vertex| {
            let neighbors = net.neighbors(vertex).into_iter();
            neighbors.filter_map(move |neighbor| net.collapse([vertex, neighbor]))
        });
        changed.collect_into(&mut self.collapses);
        !self.ranked.is_empty()
    }

    /// Returns the class of the collapse that has the given rank by cost, outdated collapses included.
    fn class_of_rank(&self, rank: usize) -> u16 {
        let parts = self.classes.par_iter().with_min_len(1 << 18).fold_parts(
            || vec![0_usize; usize::from(DEAD)],
            |mut counts, &class| {
                if class < DEAD {
                    counts[usize::from(class)] += 1;
                }
                counts
            },
        );
        let mut before = 0;
        (0..DEAD)
            .find(|&class| {
                before += parts.iter().map(|counts| counts[usize::from(class)]).sum::<usize>();
                rank < before
            })
            .unwrap_or(DEAD - 1)
    }

    /// Returns the indices of those collapses that have a lower rank than all others at their ends and at the neighbors of their ends. So
    /// no two of them have a face in common.
    fn lowest_around(&self, net: &Net) -> Vec<u32> {
        let ends = |ranked: &Ranked| self.collapses[ranked.index as usize].ends;
        let all = self.ranked.par_iter().enumerate().with_min_len(1024);
        all.for_each(|(rank, collapse)| {
            for end in ends(collapse) {
                self.lowest[end as usize].fetch_min(rank as u32, Ordering::Relaxed);
            }
        });
        let chosen = self
            .ranked
            .par_iter()
            .enumerate()
            .with_min_len(1024)
            .filter(|(rank, collapse)| {
                let lowest = |vertex: u32| self.lowest[vertex as usize].load(Ordering::Relaxed);
                let ends = ends(collapse);
                ends.iter().all(|&end| lowest(end) == *rank as u32)
                    && ends.iter().all(|&end| {
                        net.corners_around(end).all(|vertex| *rank as u32 <= lowest(vertex))
                    })
            })
            .map(|(_, collapse)| collapse.index)
            .collect();
        self.ranked.par_iter().with_min_len(1024).for_each(|collapse| {
            for end in ends(collapse) {
                self.lowest[end as usize].store(NONE, Ordering::Relaxed);
            }
        });
        chosen
    }
}

impl Ranked {
    fn new(collapse: &Collapse, index: u32) -> Self {
        // Costs and lengths are not negative, so their bits have the order of the numbers.
        Self {
            cost: collapse.cost.to_bits(),
            length: collapse.length_sq.to_bits(),
            hash: hash(collapse.ends),
            index,
        }
    }
}

/// Returns the upper half of the bits of a cost in single precision: 128 classes for each power of two.
fn class(cost: f64) -> u16 {
    ((cost as f32).to_bits() >> 16) as u16
}

/// Mixes the bits of two numbers.
fn hash([a, b]: [u32; 2]) -> u32 {
    let mixed = a.wrapping_mul(0x9e37_79b9) ^ b.wrapping_mul(0x85eb_ca6b);
    (mixed ^ mixed >> 15).wrapping_mul(0x2c1b_3c6d)
}
