//! A tree of boxes, which finds those that overlap another one.

use nalgebra::Point3;

/// A box along the axes, with its border.
#[derive(Clone, Copy, Debug)]
pub struct Bounds {
    /// Its lowest coordinates.
    pub low: Point3<f64>,
    /// Its highest.
    pub high: Point3<f64>,
}

impl Bounds {
    /// Around some points, one at least.
    pub fn around(points: &[Point3<f64>]) -> Self {
        let start = Self { low: points[0], high: points[0] };
        points
            .iter()
            .fold(start, |it, point| Self { low: it.low.inf(point), high: it.high.sup(point) })
    }

    /// Around both.
    pub fn join(&self, other: &Self) -> Self {
        Self { low: self.low.inf(&other.low), high: self.high.sup(&other.high) }
    }

    /// Whether they have a point in common.
    pub fn overlaps(&self, other: &Self) -> bool {
        (0..3).all(|k| self.low[k] <= other.high[k] && other.low[k] <= self.high[k])
    }
}

/// Boxes of a leaf.
const LEAF: usize = 4;

/// From so many boxes on, both halves of a tree grow at once.
const FOR_TWO: usize = 1 << 14;

/// Some boxes, in a tree: each node is followed by those below it.
pub struct BoxTree {
    order: Vec<(Bounds, u32)>,
    nodes: Vec<Node>,
}

struct Node {
    bounds: Bounds,
    /// How many nodes are below this one.
    below: u32,
    /// The boxes of a leaf, from the first to before the last; none for other nodes.
    own: std::ops::Range<usize>,
}

impl BoxTree {
    /// The tree of some boxes. Cost grows with n log n.
    pub fn new(boxes: impl Iterator<Item = Bounds>) -> Self {
        let mut order: Vec<_> = boxes.zip(0..).collect();
        let mut nodes = Vec::new();
        if !order.is_empty() {
            grow(&mut nodes, &mut order, 0);
        }
        Self { order, nodes }
    }

    /// Calls `found` with the number of each box that overlaps this one.
    pub fn near(&self, bounds: &Bounds, mut found: impl FnMut(u32)) {
        let mut at = 0;
        while let Some(node) = self.nodes.get(at) {
            if !node.bounds.overlaps(bounds) {
                at += node.below as usize + 1;
                continue;
            }
            let own = self.order[node.own.clone()].iter();
            own.filter(|(other, _)| other.overlaps(bounds)).for_each(|(_, number)| found(*number));
            at += 1;
        }
    }
}

fn grow(nodes: &mut Vec<Node>, own: &mut [(Bounds, u32)], first: usize) {
    let bounds = own[1..].iter().fold(own[0].0, |bounds, (other, _)| bounds.join(other));
    let (node, count) = (nodes.len(), own.len());
    let last = if count <= LEAF { first + count } else { first };
    nodes.push(Node { bounds, below: 0, own: first..last });
    if count > LEAF {
        let axis = (bounds.high - bounds.low).imax();
        fn middle(it: &Bounds, axis: usize) -> f64 {
            it.low[axis] + it.high[axis]
        }
        own.select_nth_unstable_by(count / 2, |(a, i), (b, j)| {
            middle(a, axis).total_cmp(&middle(b, axis)).then(i.cmp(j))
        });
        let (low, high) = own.split_at_mut(count / 2);
        let behind = first + count / 2;
        if count < FOR_TWO {
            grow(nodes, low, first);
            grow(nodes, high, behind);
        } else {
            let (mut lower, mut higher) = (Vec::new(), Vec::new());
            rayon::join(|| grow(&mut lower, low, first), || grow(&mut higher, high, behind));
            nodes.append(&mut lower);
            nodes.append(&mut higher);
        }
    }
    nodes[node].below = (nodes.len() - node) as u32 - 1;
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
            for of in (0..30).map(|k| cube(3 * k)) {
                let mut found = Vec::new();
                boxes.near(&of, |number| found.push(number));
                found.sort_unstable();
                let wanted = (0..count).filter(|&k| cube(k).overlaps(&of));
                assert_eq!(found, Vec::from_iter(wanted));
            }
        }
    }
}
