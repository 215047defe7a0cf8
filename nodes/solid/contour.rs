//! The surface between the nodes of a grid that are deep and those that are not.

use std::collections::HashMap;

use nalgebra::Point3;

/// The six tetrahedra of a cell: the orders in which they go along the axes from its lowest corner to its highest, and whether the volume that edges from the first
/// corner span is positive.
const ORDERS: [([usize; 3], bool); 6] = [
    ([0, 1, 2], true),
    ([1, 2, 0], true),
    ([2, 0, 1], true),
    ([0, 2, 1], false),
    ([2, 1, 0], false),
    ([1, 0, 2], false),
];

/// A surface that grows cell by cell.
///
/// It is made of tetrahedra, six for each cell (Doi and Koide, "An efficient method of triangulating equi-valued surfaces by using tetrahedral
/// cells", 1991), and so always a manifold, closed where no cell is left out that it runs through.
pub(crate) struct Contour {
    /// A vertex is no nearer to a node than this share of an edge, so that triangles have a size.
    nearest: f64,
    pub(crate) points: Vec<Point3<f64>>,
    /// The end of each point's edge where it is deep, and how deep that is.
    pub(crate) deep_ends: Vec<(Point3<f64>, f64)>,
    /// They look to where it is deep.
    pub(crate) triangles: Vec<[u32; 3]>,
    numbers: HashMap<[[usize; 3]; 2], u32>,
}

impl Contour {
    /// Nothing yet. A vertex will be no nearer to a node than this share of an edge, so that triangles have a size.
    pub(crate) fn new(nearest: f64) -> Self {
        let (points, deep_ends, triangles) = (Vec::new(), Vec::new(), Vec::new());
        Self { nearest, points, deep_ends, triangles, numbers: HashMap::new() }
    }

    /// Adds what runs through the cell whose lowest corner is the node `at`, where `place` tells where nodes are. Its corners are so deep, and deep if above 0;
    /// corner `k` is one node farther along x, y and z for the bits 0, 1 and 2 of `k`.
    pub(crate) fn add(
        &mut self,
        at: [usize; 3],
        depths: [f64; 8],
        place: impl Fn([usize; 3]) -> Point3<f64>,
    ) {
        let deep = depths.iter().filter(|depth| 0.0 < **depth).count();
        if deep == 0 || deep == 8 {
            return;
        }
        let node = |k: usize| [at[0] + (k & 1), at[1] + (k >> 1 & 1), at[2] + (k >> 2)];
        for (order, is_positive) in ORDERS {
            let mut corners = [0; 4];
            for k in 0..3 {
                corners[k + 1] = corners[k] | 1 << order[k];
            }
            // Where the edge between two corners, one of which is deep, meets the surface.
            let mut vertex = |a: usize, b: usize| {
                let ends = [corners[a.min(b)], corners[a.max(b)]];
                *self.numbers.entry(ends.map(node)).or_insert_with(|| {
                    let [from, to] = ends.map(|end| depths[end]);
                    let share = (from / (from - to)).clamp(self.nearest, 1.0 - self.nearest);
                    let [first, last] = ends.map(|end| place(node(end)));
                    self.points.push(first + (last - first) * share);
                    self.deep_ends.push(if 0.0 < from { (first, from) } else { (last, to) });
                    self.points.len() as u32 - 1
                })
            };
            let (inner, outer): (Vec<usize>, Vec<usize>) =
                (0..4).partition(|k| 0.0 < depths[corners[*k]]);
            // An even number of swaps brings the corners into this order, or an odd one.
            fn keeps(order: [usize; 4], is_positive: bool) -> bool {
                let swaps = (0..4).flat_map(|b| (0..b).map(move |a| [a, b]));
                let swaps = swaps.filter(|&[a, b]| order[b] < order[a]).count();
                swaps.is_multiple_of(2) == is_positive
            }
            match (&inner[..], &outer[..]) {
                (&[a], &[b, c, d]) => {
                    let own = [vertex(a, b), vertex(a, d), vertex(a, c)];
                    self.triangles.push(turned(own, keeps([a, b, c, d], is_positive)));
                }
                (&[b, c, d], &[a]) => {
                    let own = [vertex(a, b), vertex(a, c), vertex(a, d)];
                    self.triangles.push(turned(own, keeps([a, b, c, d], is_positive)));
                }
                (&[a, b], &[c, d]) => {
                    let quad = [vertex(a, c), vertex(b, c), vertex(b, d), vertex(a, d)];
                    let keeps = keeps([a, b, c, d], is_positive);
                    self.triangles.push(turned([quad[0], quad[1], quad[2]], keeps));
                    self.triangles.push(turned([quad[0], quad[2], quad[3]], keeps));
                }
                _ => {}
            }
        }
    }
}

fn turned([a, b, c]: [u32; 3], keeps: bool) -> [u32; 3] {
    if keeps { [a, b, c] } else { [a, c, b] }
}
