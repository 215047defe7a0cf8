//! A bounding volume hierarchy over triangles. It finds the triangles whose boxes overlap a given box.

use maquette_value::parallel::join;
use nalgebra::Point3;

use crate::triangles::filling::Filling;

/// A triangle of a mesh whose holes are being filled.
#[derive(Clone, Copy)]
pub(crate) struct Triangle {
    pub(crate) vertices: [u32; 3],
    pub(crate) corners: [Point3<f64>; 3],
    pub(crate) face: u32,
}

impl Triangle {
    pub(crate) fn new(filling: &Filling, face: u32) -> Self {
        let vertices = filling.faces[face as usize];
        Self { vertices, corners: vertices.map(|vertex| filling.points[vertex as usize]), face }
    }

    pub(crate) fn bounds(&self) -> Bounds {
        let [a, b, c] = self.corners;
        Bounds { low: a.inf(&b).inf(&c), high: a.sup(&b).sup(&c) }
    }
}

/// An axis-aligned box.
#[derive(Clone, Copy)]
pub(crate) struct Bounds {
    low: Point3<f64>,
    high: Point3<f64>,
}

impl Bounds {
    /// A box without points.
    pub(crate) const EMPTY: Self = Self {
        low: Point3::new(f64::INFINITY, f64::INFINITY, f64::INFINITY),
        high: Point3::new(f64::NEG_INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY),
    };

    pub(crate) fn join(&self, other: &Self) -> Self {
        Self { low: self.low.inf(&other.low), high: self.high.sup(&other.high) }
    }

    pub(crate) fn overlaps(&self, other: &Self) -> bool {
        // Evaluate all comparisons without branches, which the processor could not predict.
        (0..3).fold(true, |overlap, k| {
            overlap & (self.low[k] <= other.high[k]) & (other.low[k] <= self.high[k])
        })
    }

    /// Returns one bit for each face plane of this box that has the point on its outer side. The box of a triangle overlaps this box unless
    /// the outcodes of its corners have a bit in common. Cohen and Sutherland's clipping, in Newman and Sproull, "Principles of interactive
    /// computer graphics" (1973).
    pub(crate) fn outcode(&self, point: &Point3<f64>) -> u8 {
        (0..3).fold(0, |code, k| {
            let [below, above] = [point[k] < self.low[k], self.high[k] < point[k]].map(u8::from);
            code << 2 | below << 1 | above
        })
    }

    pub(crate) fn contains(&self, other: &Self) -> bool {
        (0..3).all(|k| self.low[k] <= other.low[k] && other.high[k] <= self.high[k])
    }
}

/// Maximum number of triangles in a leaf.
const LEAF_SIZE: usize = 4;

/// Maximum number of triangles of a subtree that is built on one thread.
const MAX_SEQUENTIAL: usize = 512;

/// Triangles in a bounding volume hierarchy, which finds those near a box.
#[derive(Default)]
pub(crate) struct Boxes {
    triangles: Vec<BoxedTriangle>,
    /// The nodes in depth-first order: each node is followed by the nodes of its subtree.
    nodes: Vec<Node>,
}

/// A triangle together with its bounding box.
pub(crate) struct BoxedTriangle {
    pub(crate) bounds: Bounds,
    pub(crate) triangle: Triangle,
}

struct Node {
    bounds: Bounds,
    /// The number of nodes in the subtree of this node, not counting the node itself.
    below: u32,
    /// The triangles of a leaf have the indices `first..last`. For an inner node this range is empty.
    first: u32,
    last: u32,
}

impl Boxes {
    pub(crate) fn new(triangles: impl Iterator<Item = Triangle>) -> Self {
        let triangles: Vec<Triangle> = triangles.collect();
        // Sort indices instead of triangles, which are larger.
        let bounds = (0..).zip(&triangles).map(|(k, triangle)| (triangle.bounds(), k));
        let mut order: Vec<(Bounds, u32)> = bounds.collect();
        let mut nodes = Vec::with_capacity(triangles.len());
        if !order.is_empty() {
            grow(&mut nodes, &mut order, 0);
        }
        let ordered = order
            .into_iter()
            .map(|(bounds, k)| BoxedTriangle { bounds, triangle: triangles[k as usize] });
        Self { triangles: ordered.collect(), nodes }
    }

    /// Returns the triangles of each leaf.
    pub(crate) fn leaves(&self) -> impl Iterator<Item = &[BoxedTriangle]> {
        let leaves = self.nodes.iter().filter(|node| node.first < node.last);
        leaves.map(|node| &self.triangles[node.first as usize..node.last as usize])
    }

    /// Calls `found` with each triangle whose bounding box overlaps `bounds`.
    pub(crate) fn for_each_near(&self, bounds: &Bounds, mut found: impl FnMut(&BoxedTriangle)) {
        let mut at = 0;
        while let Some(node) = self.nodes.get(at) {
            if !node.bounds.overlaps(bounds) {
                at += node.below as usize + 1;
                continue;
            }
            let own = &self.triangles[node.first as usize..node.last as usize];
            own.iter().filter(|other| other.bounds.overlaps(bounds)).for_each(&mut found);
            at += 1;
        }
    }
}

/// Appends to `nodes` the subtree over the triangles `own`. `first` is the index of the first of these triangles. An inner node divides its
/// triangles into halves along the longest side of its box.
fn grow(nodes: &mut Vec<Node>, own: &mut [(Bounds, u32)], first: u32) {
    let bounds = own.iter().fold(Bounds::EMPTY, |bounds, (other, _)| bounds.join(other));
    let (node, count) = (nodes.len(), own.len());
    let last = if count <= LEAF_SIZE { first + count as u32 } else { first };
    nodes.push(Node { bounds, below: 0, first, last });
    if count > LEAF_SIZE {
        let axis = (bounds.high - bounds.low).imax();
        let half = count / 2;
        own.select_nth_unstable_by(half, |(a, _), (b, _)| {
            (a.low[axis] + a.high[axis]).total_cmp(&(b.low[axis] + b.high[axis]))
        });
        let (low, high) = own.split_at_mut(half);
        if count <= MAX_SEQUENTIAL {
            grow(nodes, low, first);
            grow(nodes, high, first + half as u32);
        } else {
            fn grow_subtree(own: &mut [(Bounds, u32)], first: u32) -> Vec<Node> {
                let mut nodes = Vec::new();
                grow(&mut nodes, own, first);
                nodes
            }
            let (low, high) =
                join(|| grow_subtree(low, first), || grow_subtree(high, first + half as u32));
            nodes.extend(low);
            nodes.extend(high);
        }
    }
    nodes[node].below = (nodes.len() - node) as u32 - 1;
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes::random;

    #[test]
    fn outcodes_tell_which_triangles_have_boxes_that_overlap() {
        fn point(k: u64) -> Point3<f64> {
            Point3::from([0, 1, 2].map(|axis| 10.0 * random(3 * k + axis)))
        }
        fn corners(k: u64) -> [Point3<f64>; 3] {
            [0, 1, 2].map(|corner| point(3 * k + corner))
        }
        fn bounds(k: u64) -> Bounds {
            Triangle { vertices: [0; 3], corners: corners(k), face: 0 }.bounds()
        }
        let mut counts = [0, 0];
        for (k, other) in (0..200).map(|k| (k, k + 1000)) {
            let [a, b, c] = corners(other).map(|corner| bounds(k).outcode(&corner));
            let overlaps = bounds(k).overlaps(&bounds(other));
            assert_eq!(a & b & c == 0, overlaps);
            counts[usize::from(overlaps)] += 1;
        }
        assert!(counts.iter().all(|&count| count > 20), "{counts:?}");
    }

    #[test]
    fn all_near_triangles_are_found() {
        // Most values of `k` give small triangles, some give very large ones.
        fn coordinate(k: u32) -> f64 {
            10.0 * random(u64::from(k))
        }
        fn triangle(face: u32) -> Triangle {
            let size = if face.is_multiple_of(50) { 5.0 } else { 0.2 };
            let at = Point3::new(coordinate(9 * face), coordinate(9 * face + 1), 0.3);
            Triangle {
                vertices: [0; 3],
                corners: [0, 1, 2].map(|k: u32| {
                    let [x, y] = [2 * k, 2 * k + 1].map(|i| coordinate(9 * face + 3 + i) - 5.0);
                    at + nalgebra::Vector3::new(x, y, 0.1 * y) * size
                }),
                face,
            }
        }
        for count in [0, 1, 4, 5, 300, 1500] {
            let boxes = Boxes::new((0..count).map(triangle));
            for of in (0..40).map(|k| triangle(k + 1000)) {
                let mut found = Vec::new();
                boxes.for_each_near(&of.bounds(), |other| found.push(other.triangle.face));
                found.sort_unstable();
                let near = (0..count).filter(|&k| triangle(k).bounds().overlaps(&of.bounds()));
                assert_eq!(found, near.collect::<Vec<u32>>());
            }
        }
    }
}
