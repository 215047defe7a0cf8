//! Normals after some vertices have moved.

use std::ops::Range;

use nalgebra::Vector3;

use super::single;
use super::spread::BIN;
use crate::Column;
use crate::mesh::Mesh;
use crate::mesh::normals::unit;

impl Mesh {
    /// The normals, made of those from before these rows of vertices moved. With a vertex its faces move, and with these the normals at all
    /// of their corners.
    pub(in crate::mesh) fn normals_after(
        &self,
        before: &Column<[f32; 3]>,
        rows: &[Range<u32>],
    ) -> Column<[f32; 3]> {
        let count = self.positions.len();
        let corners = self.faces_with(rows).into_iter();
        let corners = corners.flat_map(|face| self.faces.face(face as usize));
        let touched = Vertices::of(count, corners.copied());
        let mut normals = vec![Vector3::zeros(); touched.count()];
        for face in self.faces_at(&touched) {
            let face = self.faces.face(face as usize);
            let area = self.area_vector(face);
            for vertex in face.iter().filter(|&&vertex| touched.has(vertex)) {
                normals[touched.rank(*vertex)] += area;
            }
        }
        normals.iter_mut().for_each(|normal| *normal = unit(*normal));
        before.with_rows(&touched.rows(), &single(&normals))
    }

    /// The faces that have a corner in these rows of vertices, in order.
    pub fn faces_with(&self, rows: &[Range<u32>]) -> Vec<u32> {
        self.faces_at(&Vertices::of(self.positions.len(), rows.iter().cloned().flatten()))
    }

    /// The faces that have a corner at one of these vertices, in order.
    fn faces_at(&self, vertices: &Vertices) -> Vec<u32> {
        self.faces.spread().faces(&self.faces, &vertices.bins(), |face| {
            face.iter().any(|&vertex| vertices.has(vertex))
        })
    }
}

/// Bits of a word.
const WORD: usize = u64::BITS as usize;

/// Some of the vertices of a mesh.
struct Vertices {
    words: Vec<u64>,
    /// For each word, how many there are in those before it; then, how many in all.
    before: Vec<u32>,
}

impl Vertices {
    /// These of so many.
    fn of(count: usize, vertices: impl Iterator<Item = u32>) -> Self {
        let mut words = vec![0_u64; count.div_ceil(WORD)];
        vertices.for_each(|vertex| words[vertex as usize / WORD] |= 1 << (vertex as usize % WORD));
        let mut before = vec![0; words.len() + 1];
        for (k, word) in words.iter().enumerate() {
            before[k + 1] = before[k] + word.count_ones();
        }
        Self { words, before }
    }

    fn has(&self, vertex: u32) -> bool {
        self.words[vertex as usize / WORD] >> (vertex as usize % WORD) & 1 == 1
    }

    /// How many of them come before this one.
    fn rank(&self, vertex: u32) -> usize {
        let (word, bit) = (vertex as usize / WORD, vertex as usize % WORD);
        let below = self.words[word] & ((1 << bit) - 1);
        (self.before[word] + below.count_ones()) as usize
    }

    /// For each bin, whether it has some.
    fn bins(&self) -> Vec<bool> {
        self.words.chunks(BIN / WORD).map(|words| words.iter().any(|&word| word != 0)).collect()
    }

    fn count(&self) -> usize {
        self.before[self.words.len()] as usize
    }

    /// Rows of all of them, in order.
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
