//! A tree of boxes over triangles, which finds those that are near others.

use nalgebra::Point3;

use super::filling::Filling;

/// A triangle of a mesh whose holes are being filled.
#[derive(Clone, Copy)]
pub(super) struct Triangle {
    pub(super) vertices: [u32; 3],
    pub(super) corners: [Point3<f64>; 3],
    pub(super) face: u32,
}

impl Triangle {
    pub(super) fn of(filling: &Filling, face: u32) -> Self {
        let vertices = filling.faces[face as usize];
        Self { vertices, corners: vertices.map(|vertex| filling.points[vertex as usize]), face }
    }

    pub(super) fn bounds(&self) -> Bounds {
        let [a, b, c] = self.corners;
        Bounds { low: a.inf(&b).inf(&c), high: a.sup(&b).sup(&c) }
    }
}

/// A box along the axes.
#[derive(Clone, Copy)]
pub(super) struct Bounds {
    low: Point3<f64>,
    high: Point3<f64>,
}

impl Bounds {
    /// Holds nothing.
    pub(super) const EMPTY: Self = Self {
        low: Point3::new(f64::INFINITY, f64::INFINITY, f64::INFINITY),
        high: Point3::new(f64::NEG_INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY),
    };

    pub(super) fn join(&self, other: &Self) -> Self {
        Self { low: self.low.inf(&other.low), high: self.high.sup(&other.high) }
    }

    pub(super) fn overlaps(&self, other: &Self) -> bool {
        (0..3).all(|k| self.low[k] <= other.high[k] && other.low[k] <= self.high[k])
    }

    pub(super) fn holds(&self, other: &Self) -> bool {
        (0..3).all(|k| self.low[k] <= other.low[k] && other.high[k] <= self.high[k])
    }
}

/// Triangles of a leaf.
const LEAF: usize = 4;

/// Triangles in a tree of boxes.
#[derive(Default)]
pub(super) struct Boxes {
    triangles: Vec<(Bounds, Triangle)>,
    /// Each node is followed by those below it.
    nodes: Vec<Node>,
}

struct Node {
    bounds: Bounds,
    /// The node after all those below this one.
    end: u32,
    /// The triangles of a leaf, from the first to before the last; none for other nodes.
    first: u32,
    last: u32,
}

impl Boxes {
    pub(super) fn new(triangles: impl Iterator<Item = Triangle>) -> Self {
        let with_bounds = triangles.map(|triangle| (triangle.bounds(), triangle));
        let mut boxes = Self { triangles: with_bounds.collect(), nodes: Vec::new() };
        if !boxes.triangles.is_empty() {
            boxes.grow(0, boxes.triangles.len());
        }
        boxes
    }

    /// Adds the node of some triangles, and those below it: half of the triangles each, apart along the longest side of their box.
    fn grow(&mut self, first: usize, last: usize) {
        let own = &mut self.triangles[first..last];
        let bounds = own.iter().fold(Bounds::EMPTY, |bounds, (other, _)| bounds.join(other));
        let (node, is_leaf) = (self.nodes.len(), own.len() <= LEAF);
        let ends = if is_leaf { [first as u32, last as u32] } else { [0, 0] };
        self.nodes.push(Node { bounds, end: 0, first: ends[0], last: ends[1] });
        if !is_leaf {
            let axis = (bounds.high - bounds.low).imax();
            let half = own.len() / 2;
            own.select_nth_unstable_by(half, |(a, _), (b, _)| {
                (a.low[axis] + a.high[axis]).total_cmp(&(b.low[axis] + b.high[axis]))
            });
            self.grow(first, first + half);
            self.grow(first + half, last);
        }
        self.nodes[node].end = self.nodes.len() as u32;
    }

    /// What holds all triangles.
    pub(super) fn bounds(&self) -> Bounds {
        self.nodes.first().map_or(Bounds::EMPTY, |root| root.bounds)
    }

    /// Calls `found` with each triangle whose box overlaps `bounds`.
    pub(super) fn near(&self, bounds: &Bounds, mut found: impl FnMut(&Triangle)) {
        let mut at = 0;
        while let Some(node) = self.nodes.get(at) {
            if !node.bounds.overlaps(bounds) {
                at = node.end as usize;
                continue;
            }
            let own = &self.triangles[node.first as usize..node.last as usize];
            own.iter().filter(|(other, _)| other.overlaps(bounds)).for_each(|(_, it)| found(it));
            at += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fill::shapes::random;

    #[test]
    fn all_that_is_near_is_found() {
        // Small triangles and very large ones.
        let coordinate = |k: u32| 10.0 * random(u64::from(k));
        let triangle = |face: u32| {
            let size = if face.is_multiple_of(50) { 5.0 } else { 0.2 };
            let at = Point3::new(coordinate(9 * face), coordinate(9 * face + 1), 0.3);
            let corner = |k: u32| {
                let [x, y] = [2 * k, 2 * k + 1].map(|i| coordinate(9 * face + 3 + i) - 5.0);
                at + nalgebra::Vector3::new(x, y, 0.1 * y) * size
            };
            Triangle { vertices: [0; 3], corners: [0, 1, 2].map(corner), face }
        };
        for count in [0, 1, 4, 5, 300] {
            let boxes = Boxes::new((0..count).map(triangle));
            for of in (0..40).map(|k| triangle(k + 1000)) {
                let mut found = Vec::new();
                boxes.near(&of.bounds(), |other| found.push(other.face));
                found.sort_unstable();
                let near = (0..count).filter(|&k| triangle(k).bounds().overlaps(&of.bounds()));
                assert_eq!(found, near.collect::<Vec<u32>>());
            }
        }
    }
}
