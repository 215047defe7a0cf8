//! Vertices at equal positions.

use std::collections::HashMap;

use nalgebra::Point3;

use super::Mesh;

/// Numbers distinct positions in the order of first use. Positions are equal if their coordinates are equal numbers, so that -0 equals 0.
#[derive(Clone, Debug, Default)]
pub struct DistinctPositions {
    positions: Vec<Point3<f64>>,
    numbers: HashMap<[u64; 3], u32>,
}

impl DistinctPositions {
    /// No positions yet, with room for `count` of them.
    pub fn with_capacity(count: usize) -> Self {
        Self { positions: Vec::with_capacity(count), numbers: HashMap::with_capacity(count) }
    }

    /// The number of a position, which is added unless it is known. All numbers are less than 2^32, because more positions would not fit
    /// in memory.
    pub fn insert(&mut self, position: Point3<f64>) -> u32 {
        // The sum turns -0 into 0.
        let bits = [position.x, position.y, position.z].map(|x| (x + 0.0).to_bits());
        *self.numbers.entry(bits).or_insert_with(|| {
            self.positions.push(position);
            (self.positions.len() - 1) as u32
        })
    }

    /// The distinct positions.
    pub fn into_positions(self) -> Vec<Point3<f64>> {
        self.positions
    }
}

impl Mesh {
    /// For each vertex, true if its faces do not surround it: it is on a border, or there are faces of opposite orientation around it.
    /// Vertices without faces are not on a border.
    ///
    /// In a closed fan each neighbor comes once after the vertex and once before it. The difference of sums of hashes over both is 0 then,
    /// and with a probability of 1 - 2^-64 only then.
    pub fn border_vertices(&self) -> Vec<bool> {
        let mut sums = vec![0u64; self.positions.len()];
        for face in self.faces.iter() {
            for k in 0..face.len() {
                let [before, after] =
                    [face[(k + face.len() - 1) % face.len()], face[(k + 1) % face.len()]];
                let sum = &mut sums[face[k] as usize];
                *sum = sum.wrapping_add(mix(after)).wrapping_sub(mix(before));
            }
        }
        sums.into_iter().map(|sum| sum != 0).collect()
    }

    /// The number of vertices at border edges whose two ends have the positions of another border edge's ends: the mesh is not joined
    /// there.
    pub fn count_unjoined(&self) -> usize {
        let is_border = self.border_vertices();
        let mut distinct = DistinctPositions::default();
        let mut places = vec![u32::MAX; self.positions.len()];
        let on_border = (0..self.positions.len()).filter(|&vertex| is_border[vertex]);
        let on_border: Vec<usize> = on_border.collect();
        for &vertex in &on_border {
            places[vertex] = distinct.insert(self.positions[vertex]);
        }
        if distinct.positions.len() == on_border.len() {
            return 0;
        }
        // The edges between vertices of the border: the numbers of their positions, then their vertices, both in ascending order.
        let mut edges: Vec<([u32; 2], [u32; 2])> = Vec::new();
        for face in self.faces.iter() {
            for (&from, &to) in face.iter().zip(face[1..].iter().chain(&face[..1])) {
                let [a, b] = [from, to].map(|vertex| places[vertex as usize]);
                if a != u32::MAX && b != u32::MAX {
                    edges.push(([a.min(b), a.max(b)], [from.min(to), from.max(to)]));
                }
            }
        }
        edges.sort_unstable();
        let mut is_unjoined = vec![false; self.positions.len()];
        for same in edges.chunk_by(|a, b| a.0 == b.0) {
            if same.iter().any(|edge| edge.1 != same[0].1) {
                same.iter()
                    .flat_map(|edge| edge.1)
                    .for_each(|end| is_unjoined[end as usize] = true);
            }
        }
        // The ends of a crack are at coinciding edges, but have their positions to themselves.
        let mut at_place = vec![0u32; distinct.positions.len()];
        on_border.iter().for_each(|&vertex| at_place[places[vertex] as usize] += 1);
        let is_shared = |vertex: &usize| at_place[places[*vertex] as usize] > 1;
        on_border.into_iter().filter(|&vertex| is_unjoined[vertex]).filter(is_shared).count()
    }
}

/// A hash of a vertex index: the finalizer of SplitMix64. Steele, Lea and Flood, "Fast splittable pseudorandom number generators" (2014).
fn mix(vertex: u32) -> u64 {
    let x = u64::from(vertex).wrapping_add(0x9e37_79b9_7f4a_7c15);
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

#[cfg(test)]
mod tests {
    use super::super::Faces;
    use super::*;

    fn mesh(points: &[[f64; 3]], faces: &[[u32; 3]]) -> Mesh {
        let points: Vec<_> = points.iter().map(|&point| Point3::from(point)).collect();
        Mesh::new(points, Faces::triangles(faces.to_vec())).unwrap()
    }

    #[test]
    fn minus_zero_is_zero() {
        let mut distinct = DistinctPositions::default();
        let numbers = [0.0, -0.0, 1.0].map(|x| distinct.insert(Point3::new(x, 0.0, 0.0)));
        assert_eq!(numbers, [0, 0, 1]);
    }

    #[test]
    fn only_edges_that_coincide_are_unjoined() {
        let square = [[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]];
        let joined = mesh(&square, &[[0, 1, 2], [0, 2, 3]]);
        assert_eq!(joined.border_vertices(), [true; 4]);
        assert_eq!(joined.count_unjoined(), 0);
        let apart = [&square[..], &[square[0], square[2]]].concat();
        assert_eq!(mesh(&apart, &[[0, 1, 2], [4, 5, 3]]).count_unjoined(), 4);
        // Two triangles that touch at a vertex only.
        let touching = [&square[..3], &[square[2], [2., 1., 0.], [2., 2., 0.]]].concat();
        assert_eq!(mesh(&touching, &[[0, 1, 2], [3, 4, 5]]).count_unjoined(), 0);
        let slit =
            [&square[..], &[[2., 0., 0.], [2., 1., 0.], [1., 0.5, 0.], [1., 0.5, 0.]]].concat();
        let cracked = [[0, 6, 3], [0, 1, 6], [6, 2, 3], [1, 4, 7], [4, 5, 7], [7, 5, 2]];
        assert_eq!(mesh(&slit, &cracked).count_unjoined(), 2);
        let closed = mesh(&square, &[[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]);
        assert_eq!(closed.border_vertices(), [false; 4]);
    }
}
