//! A tree of boxes, for overlap queries.

use nalgebra::Point3;

use crate::parallel::{UntilStopped, join};

/// An axis-aligned box, including its border.
#[derive(Clone, Copy, Debug)]
pub struct Bounds {
    /// The minimum coordinates of the box.
    pub low: Point3<f64>,
    /// The maximum coordinates of the box.
    pub high: Point3<f64>,
}

impl Bounds {
    /// The bounding box of at least one point.
    pub fn from_points(points: &[Point3<f64>]) -> Self {
        let start = Self { low: points[0], high: points[0] };
        points
            .iter()
            .fold(start, |it, point| Self { low: it.low.inf(point), high: it.high.sup(point) })
    }

    /// Returns the smallest box that contains this box and `other`.
    pub fn join(&self, other: &Self) -> Self {
        Self { low: self.low.inf(&other.low), high: self.high.sup(&other.high) }
    }

    /// Returns true if this box and `other` have a point in common. A common point of the borders suffices.
    pub fn overlaps(&self, other: &Self) -> bool {
        (0..3).all(|k| self.low[k] <= other.high[k] && other.low[k] <= self.high[k])
    }
}

/// The number of boxes per leaf.
const LEAF: usize = 4;

/// The minimum number of boxes in a tree whose two halves are built in parallel.
const FOR_TWO: usize = 1 << 14;

/// A tree of boxes in preorder: each node is followed by its descendants.
pub struct BoxTree {
    order: Vec<(Bounds, u32)>,
    nodes: Vec<Node>,
}

struct Node {
    bounds: Bounds,
    /// The number of descendants of this node.
    descendants: u32,
    /// The range of the leaf's entries in the list `order` of the tree; empty for inner nodes.
    leaf: std::ops::Range<usize>,
}

impl BoxTree {
    /// Builds the tree of some boxes. Cost grows with n log n.
    pub fn new(boxes: impl Iterator<Item = Bounds>) -> Self {
        let mut order: Vec<_> = boxes.zip(0..).until_stopped().collect();
        let mut nodes = Vec::new();
        if !order.is_empty() {
            grow(&mut nodes, &mut order, 0);
        }
        Self { order, nodes }
    }

    /// Calls `found` with the index of each box of the tree that overlaps `bounds`.
    pub fn visit_overlapping(&self, bounds: &Bounds, mut found: impl FnMut(u32)) {
        let mut at = 0;
        while let Some(node) = self.nodes.get(at) {
            if !node.bounds.overlaps(bounds) {
                at += node.descendants as usize + 1;
                continue;
            }
            let leaf = self.order[node.leaf.clone()].iter();
            leaf.filter(|(other, _)| other.overlaps(bounds)).for_each(|(_, number)| found(*number));
            at += 1;
        }
    }
}

fn grow(nodes: &mut Vec<Node>, boxes: &mut [(Bounds, u32)], first: usize) {
    let bounds = boxes[1..].iter().fold(boxes[0].0, |bounds, (other, _)| bounds.join(other));
    let (node, count) = (nodes.len(), boxes.len());
    let last = if count <= LEAF { first + count } else { first };
    nodes.push(Node { bounds, descendants: 0, leaf: first..last });
    if count > LEAF {
        let axis = (bounds.high - bounds.low).imax();
        fn middle(it: &Bounds, axis: usize) -> f64 {
            it.low[axis] + it.high[axis]
        }
        boxes.select_nth_unstable_by(count / 2, |(a, i), (b, j)| {
            middle(a, axis).total_cmp(&middle(b, axis)).then(i.cmp(j))
        });
        let (low, high) = boxes.split_at_mut(count / 2);
        let middle_index = first + count / 2;
        if count < FOR_TWO {
            grow(nodes, low, first);
            grow(nodes, high, middle_index);
        } else {
            let (mut lower, mut higher) = (Vec::new(), Vec::new());
            join(|| grow(&mut lower, low, first), || grow(&mut higher, high, middle_index));
            nodes.append(&mut lower);
            nodes.append(&mut higher);
        }
    }
    nodes[node].descendants = (nodes.len() - node) as u32 - 1;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_that_overlaps_is_found() {
        fn cube(k: u32) -> Bounds {
            let at =
                Point3::new(f64::from(k * 7 % 31), f64::from(k * 11 % 17), f64::from(k * 5 % 13));
            Bounds { low: at, high: at + nalgebra::Vector3::repeat(f64::from(k % 4)) }
        }
        for count in [0, 1, 4, 5, 200, 2 * FOR_TWO as u32 + 1] {
            let boxes = BoxTree::new((0..count).map(cube));
            for query in (0..30).map(|k| cube(3 * k)) {
                let mut found = Vec::new();
                boxes.visit_overlapping(&query, |number| found.push(number));
                found.sort_unstable();
                let expected = (0..count).filter(|&k| cube(k).overlaps(&query));
                assert_eq!(found, Vec::from_iter(expected));
            }
        }
    }
}
