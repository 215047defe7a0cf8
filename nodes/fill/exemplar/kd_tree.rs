//! A k-d tree that finds the descriptors (vectors of principal components) nearest to a given one.
//!
//! Friedman, Bentley and Finkel, "An algorithm for finding best matches in logarithmic expected time" (1977). Visits the nearest cells
//! first and stops after a fixed number of cells: Beis and Lowe, "Shape indexing using approximate nearest-neighbour search in
//! high-dimensional spaces" (1997).

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::descriptor::{Descriptor, KEPT};

/// Maximum number of descriptors in a leaf cell.
const LEAF_SIZE: usize = 16;

/// Maximum number of cells that a search visits. With half as many, some matches are found one iteration later.
const MAX_CELLS: usize = 12;

/// A binary tree over the descriptors of exemplars.
pub(super) struct KdTree {
    /// The descriptors, sorted by cell; `owners` has the index of the exemplar of each.
    descriptors: Vec<Descriptor>,
    owners: Vec<u32>,
    nodes: Vec<Node>,
}

enum Node {
    Cell {
        start: u32,
        end: u32,
    },
    /// An inner node. Descriptors whose component `axis` is below `at` are in the subtree that follows this node, the others in the subtree
    /// of the node with the index `right`.
    Split {
        axis: u8,
        at: f32,
        right: u32,
    },
}

impl KdTree {
    pub(super) fn new(given: &[Descriptor]) -> Self {
        let mut order: Vec<u32> = (0..given.len() as u32).collect();
        let mut nodes = Vec::new();
        divide(given, &mut order, 0, &mut nodes);
        let descriptors = order.iter().map(|&k| given[k as usize]).collect();
        Self { descriptors, owners: order, nodes }
    }

    /// Finds up to `count` descriptors near `to`, nearest first. The result is approximate: only [`MAX_CELLS`] cells are searched.
    pub(super) fn nearest(&self, to: &Descriptor, count: usize, found: &mut Vec<(f32, u32)>) {
        found.clear();
        if self.descriptors.is_empty() {
            return;
        }
        // Squared distances are nonnegative, so their bits sort in the order of the numbers.
        let mut queue = BinaryHeap::from([Reverse((0_u32, 0_u32))]);
        for _ in 0..MAX_CELLS {
            let Some(Reverse((bits, mut node))) = queue.pop() else { return };
            let gap = f32::from_bits(bits);
            if found.len() == count && found[count - 1].0 <= gap {
                return;
            }
            while let Node::Split { axis, at, right } = self.nodes[node as usize] {
                let offset = to[axis as usize] - at;
                let (near, far) = if offset < 0.0 { (node + 1, right) } else { (right, node + 1) };
                queue.push(Reverse((gap.max(offset * offset).to_bits(), far)));
                node = near;
            }
            if let Node::Cell { start, end } = self.nodes[node as usize] {
                self.search_cell(start as usize..end as usize, to, count, found);
            }
        }
    }

    fn search_cell(
        &self,
        cell: std::ops::Range<usize>,
        to: &Descriptor,
        count: usize,
        found: &mut Vec<(f32, u32)>,
    ) {
        for k in cell {
            let own = &self.descriptors[k];
            let distance: f32 = (0..KEPT).map(|i| (own[i] - to[i]) * (own[i] - to[i])).sum();
            if found.len() == count && found[count - 1].0 <= distance {
                continue;
            }
            found.truncate(count - 1);
            let position = found.partition_point(|&(other, _)| other <= distance);
            found.insert(position, (distance, self.owners[k]));
        }
    }
}

/// Appends to `nodes` the subtree over the descriptors in `order`.
fn divide(given: &[Descriptor], order: &mut [u32], start: u32, nodes: &mut Vec<Node>) {
    if order.len() <= LEAF_SIZE {
        nodes.push(Node::Cell { start, end: start + order.len() as u32 });
        return;
    }
    let spreads: [f32; KEPT] = std::array::from_fn(|axis: usize| {
        let (low, high) = order
            .iter()
            .map(|&k| given[k as usize][axis])
            .fold((f32::INFINITY, f32::NEG_INFINITY), |s, x| (s.0.min(x), s.1.max(x)));
        high - low
    });
    let axis = (0..KEPT).fold(0, |best, k| if spreads[k] > spreads[best] { k } else { best });
    let middle = order.len() / 2;
    order.select_nth_unstable_by(middle, |&a, &b| {
        given[a as usize][axis].total_cmp(&given[b as usize][axis]).then(a.cmp(&b))
    });
    let at = given[order[middle] as usize][axis];
    let (below, above) = order.split_at_mut(middle);
    let node = nodes.len();
    nodes.push(Node::Split { axis: axis as u8, at, right: 0 });
    divide(given, below, start, nodes);
    let next = nodes.len() as u32;
    if let Node::Split { right, .. } = &mut nodes[node] {
        *right = next;
    }
    divide(given, above, start + middle as u32, nodes);
}
