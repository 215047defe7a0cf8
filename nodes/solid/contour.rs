//! Extracts the surface between the grid nodes of positive depth, called deep, and all other nodes.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hash, Hasher};

use maquette_value::{Faces, Mesh, MeshError};
use nalgebra::Point3;

/// The six tetrahedra of a cell. A path along three edges of each tetrahedron leads from the cell's lowest corner to its highest, along the
/// axes in the given order. The flag is true if the edges from the lowest corner span a positive volume.
const ORDERS: [([usize; 3], bool); 6] = [
    ([0, 1, 2], true),
    ([1, 2, 0], true),
    ([2, 0, 1], true),
    ([0, 2, 1], false),
    ([2, 1, 0], false),
    ([1, 0, 2], false),
];

/// A surface at depth zero that is extracted from a grid, cell by cell.
///
/// Each cell is divided into six tetrahedra (Doi and Koide, "An efficient method of triangulating equi-valued surfaces by using tetrahedral
/// cells", 1991). The surface is therefore a manifold, and closed if no cell that it crosses is left out.
pub(crate) struct Contour {
    /// Minimum distance of a vertex from a grid node, as a fraction of a grid edge. This minimum prevents degenerate triangles.
    nearest: f64,
    pub(crate) points: Vec<Point3<f64>>,
    /// For each vertex, the end of positive depth of the grid edge on which the vertex is, and the depth of that end.
    pub(crate) deep_ends: Vec<(Point3<f64>, f64)>,
    /// The triangles of the extracted surface. Their normals point to the side of positive depth.
    pub(crate) triangles: Vec<[u32; 3]>,
    /// The vertex on each grid edge.
    numbers: HashMap<EdgeKey, u32, BuildHasherDefault<KeyHasher>>,
}

/// A grid edge: the node where it begins, whose x is multiplied by 8, plus the steps to its end as bits.
#[derive(PartialEq, Eq)]
struct EdgeKey([u32; 3]);

impl EdgeKey {
    fn new([x, y, z]: [usize; 3], step: usize) -> Self {
        Self([x << 3 | step, y, z].map(|it| it as u32))
    }
}

impl Hash for EdgeKey {
    fn hash<H: Hasher>(&self, state: &mut H) {
        let [x, y, z] = self.0.map(u64::from);
        state.write_u64(x << 32 | y);
        state.write_u64(z);
    }
}

/// A hasher of keys of grid edges: multiplication spreads them over the table. The hasher of the standard library takes three times as
/// long.
#[derive(Default)]
struct KeyHasher(u64);

impl Hasher for KeyHasher {
    fn finish(&self) -> u64 {
        self.0 ^ self.0 >> 32
    }

    fn write(&mut self, bytes: &[u8]) {
        bytes.iter().for_each(|&byte| self.write_u64(u64::from(byte)));
    }

    fn write_u64(&mut self, key: u64) {
        // 2^64 divided by the golden ratio (Knuth, "The Art of Computer Programming" 3, 1973, section 6.4).
        self.0 = (self.0.rotate_left(23) ^ key).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    }
}

impl Contour {
    /// Returns an empty surface. `nearest` is the minimum distance of a vertex from a grid node, as a fraction of a grid edge.
    pub(crate) fn new(nearest: f64) -> Self {
        let (points, deep_ends, triangles) = (Vec::new(), Vec::new(), Vec::new());
        Self { nearest, points, deep_ends, triangles, numbers: HashMap::default() }
    }

    /// Returns the surface as a mesh.
    pub(crate) fn mesh(&self) -> Result<Mesh, MeshError> {
        Mesh::new(self.points.clone(), Faces::triangles(self.triangles.clone()))
    }

    /// Adds the part of the surface in one cell. `at` is the node at the cell's lowest corner; `place` gives the position of a node. Bits
    /// 0, 1 and 2 of the index of a depth are the steps from `at` along x, y and z.
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
        /// Returns the grid node at a corner of the cell `at`; the bits of `corner` are the steps along x, y and z.
        #[inline(always)]
        fn node(at: [usize; 3], corner: usize) -> [usize; 3] {
            [at[0] + (corner & 1), at[1] + (corner >> 1 & 1), at[2] + (corner >> 2)]
        }
        for (order, is_positive) in ORDERS {
            let mut corners = [0; 4];
            for k in 0..3 {
                corners[k + 1] = corners[k] | 1 << order[k];
            }
            // Returns the vertex on the edge between two corners, one of which has a positive depth.
            let mut vertex = |a: usize, b: usize| {
                let ends = [corners[a.min(b)], corners[a.max(b)]];
                let key = EdgeKey::new(node(at, ends[0]), ends[1] - ends[0]);
                *self.numbers.entry(key).or_insert_with(|| {
                    let [from, to] = ends.map(|end| depths[end]);
                    let share = (from / (from - to)).clamp(self.nearest, 1.0 - self.nearest);
                    let [first, last] = ends.map(|end| place(node(at, end)));
                    self.points.push(first + (last - first) * share);
                    self.deep_ends.push(if 0.0 < from { (first, from) } else { (last, to) });
                    self.points.len() as u32 - 1
                })
            };
            let (inner, outer): (Vec<usize>, Vec<usize>) =
                (0..4).partition(|k| 0.0 < depths[corners[*k]]);
            // Returns true if the tetrahedron's corners, in the given order, have positive orientation. This follows from the parity of the
            // permutation that sorts the corners.
            fn keeps(order: [usize; 4], is_positive: bool) -> bool {
                let swaps = (0..4).flat_map(|b| (0..b).map(move |a| [a, b]));
                let swaps = swaps.filter(|&[a, b]| order[b] < order[a]).count();
                swaps.is_multiple_of(2) == is_positive
            }
            match (&inner[..], &outer[..]) {
                (&[a], &[b, c, d]) => {
                    let own = [vertex(a, b), vertex(a, d), vertex(a, c)];
                    self.triangles.push(orient(own, keeps([a, b, c, d], is_positive)));
                }
                (&[b, c, d], &[a]) => {
                    let own = [vertex(a, b), vertex(a, c), vertex(a, d)];
                    self.triangles.push(orient(own, keeps([a, b, c, d], is_positive)));
                }
                (&[a, b], &[c, d]) => {
                    let quad = [vertex(a, c), vertex(b, c), vertex(b, d), vertex(a, d)];
                    let keeps = keeps([a, b, c, d], is_positive);
                    self.triangles.push(orient([quad[0], quad[1], quad[2]], keeps));
                    self.triangles.push(orient([quad[0], quad[2], quad[3]], keeps));
                }
                _ => {}
            }
        }
    }
}

fn orient([a, b, c]: [u32; 3], keeps: bool) -> [u32; 3] {
    if keeps { [a, b, c] } else { [a, c, b] }
}
