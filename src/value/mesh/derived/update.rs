//! Update of normals after some vertices have moved.

use std::ops::Range;

use nalgebra::Vector3;

use super::face_bins::BIN;
use super::to_single_precision;
use crate::Column;
use crate::mesh::Mesh;
use crate::mesh::normals::unit;

impl Mesh {
    /// The normals after the given rows of vertices have moved, updated from `before`, the normals before the move. A moved vertex changes
    /// the normals of its faces, and each such face changes the normals at all of its corners.
    pub(in crate::mesh) fn updated_normals(
        &self,
        before: &Column<[f32; 3]>,
        rows: &[Range<u32>],
    ) -> Column<[f32; 3]> {
        let count = self.positions.len();
        let corners = self.faces_at_rows(rows).into_iter();
        let corners = corners.flat_map(|face| self.faces.face(face as usize));
        let touched = VertexSet::new(count, corners.copied());
        let mut normals = vec![Vector3::zeros(); touched.count()];
        for face in self.faces_at(&touched) {
            let face = self.faces.face(face as usize);
            let area = self.area_vector(face);
            for vertex in face.iter().filter(|&&vertex| touched.contains(vertex)) {
                normals[touched.rank(*vertex)] += area;
            }
        }
        normals.iter_mut().for_each(|normal| *normal = unit(*normal));
        before.with_rows(&touched.rows(), &to_single_precision(&normals))
    }

    /// The faces with a corner in the given rows of vertices, in order.
    pub fn faces_at_rows(&self, rows: &[Range<u32>]) -> Vec<u32> {
        self.faces_at(&VertexSet::new(self.positions.len(), rows.iter().cloned().flatten()))
    }

    /// The faces with a corner at one of the given vertices, in order.
    fn faces_at(&self, vertices: &VertexSet) -> Vec<u32> {
        self.faces.face_bins().faces(&self.faces, &vertices.bins(), |face| {
            face.iter().any(|&vertex| vertices.contains(vertex))
        })
    }
}

/// The number of bits per word of the bit set.
const WORD: usize = u64::BITS as usize;

/// A set of vertices, as a bit set.
struct VertexSet {
    words: Vec<u64>,
    /// For each word, the number of vertices of the set in the words before it. The last entry is the number of all vertices of the set.
    before: Vec<u32>,
}

impl VertexSet {
    /// Builds the set of the given vertices, for a mesh with `count` vertices.
    fn new(count: usize, vertices: impl Iterator<Item = u32>) -> Self {
        let mut words = vec![0_u64; count.div_ceil(WORD)];
        vertices.for_each(|vertex| words[vertex as usize / WORD] |= 1 << (vertex as usize % WORD));
        let mut before = vec![0; words.len() + 1];
        for (k, word) in words.iter().enumerate() {
            before[k + 1] = before[k] + word.count_ones();
        }
        Self { words, before }
    }

    fn contains(&self, vertex: u32) -> bool {
        self.words[vertex as usize / WORD] >> (vertex as usize % WORD) & 1 == 1
    }

    /// The number of vertices in the set whose index is lower than `vertex`.
    fn rank(&self, vertex: u32) -> usize {
        let (word, bit) = (vertex as usize / WORD, vertex as usize % WORD);
        let below = self.words[word] & ((1 << bit) - 1);
        (self.before[word] + below.count_ones()) as usize
    }

    /// For each bin of consecutive vertices, true if the bin contains a vertex of the set.
    fn bins(&self) -> Vec<bool> {
        self.words.chunks(BIN / WORD).map(|words| words.iter().any(|&word| word != 0)).collect()
    }

    fn count(&self) -> usize {
        self.before[self.words.len()] as usize
    }

    /// The vertices of the set as rows, in ascending order.
    fn rows(&self) -> Vec<Range<u32>> {
        let mut rows: Vec<Range<u32>> = Vec::new();
        for (k, &word) in self.words.iter().enumerate() {
            let mut rest = word;
            while rest != 0 {
                let vertex = k as u32 * u64::BITS + rest.trailing_zeros();
                match rows.last_mut() {
                    Some(row) if row.end == vertex => row.end += 1,
                    _ => rows.push(vertex..vertex + 1),
                }
                rest &= rest - 1;
            }
        }
        rows
    }
}
