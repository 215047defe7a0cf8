//! Normals of a mesh: stored ones, or normals computed from the faces.

use std::borrow::Cow;

use nalgebra::Vector3;

use super::Mesh;
use crate::KeyChunks;
use crate::memory::huge_vec;
use crate::parallel::*;

impl Mesh {
    /// A normal per vertex: the vertex attribute `normal`, whose vectors may have any length, or else
    /// [`vertex_normals`](Self::vertex_normals).
    pub fn normals(&self) -> Cow<'_, [[f64; 3]]> {
        match self.vertex().vectors("normal") {
            Some(given) => Cow::Borrowed(given),
            None => bytemuck::cast_vec(self.vertex_normals()).into(),
        }
    }

    /// A unit normal per vertex: the mean of the face normals, weighted by area. Zero for a vertex without faces.
    pub fn vertex_normals(&self) -> Vec<Vector3<f64>> {
        let mut normals: Vec<Vector3<f64>> = huge_vec(self.positions.len());
        // Each part of the vertices sums the normals of its faces in order, so the result does not depend on the number of threads.
        let chunks = KeyChunks::new(normals.len(), self.faces.len(), |face| {
            self.faces.face(face).iter().copied()
        });
        let parts = normals.par_chunks_mut(chunks.chunk_len()).enumerate();
        parts.for_each(|(chunk, normals): (usize, &mut [Vector3<f64>])| {
            let first = chunks.keys(chunk).start as u32;
            chunks.for_each_source(chunk, |face| {
                self.add_area(self.faces.face(face), first, normals);
            });
            for normal in normals {
                *normal = unit(*normal);
            }
        });
        normals
    }

    /// Adds the area vector of a face to the sums in `normals`, which begin with the vertex `first`. Vertices for which `normals` has no
    /// entry are ignored.
    fn add_area(&self, face: &[u32], first: u32, normals: &mut [Vector3<f64>]) {
        let area = self.area_vector(face);
        for vertex in face {
            if let Some(normal) = normals.get_mut(vertex.wrapping_sub(first) as usize) {
                *normal += area;
            }
        }
    }

    /// The area vector of a face: half the sum of the cross products of neighboring corners. Its length is the area of the face, and it
    /// points outward.
    pub fn area_vector(&self, face: &[u32]) -> Vector3<f64> {
        let origin = self.positions[face[0] as usize];
        let spokes = (1..face.len() - 1).map(|k| {
            let [a, b] =
                [face[k], face[k + 1]].map(|vertex| self.positions[vertex as usize] - origin);
            a.cross(&b)
        });
        spokes.sum::<Vector3<f64>>() / 2.0
    }
}

/// Normalizes a vector. The zero vector stays zero.
pub(super) fn unit(sum: Vector3<f64>) -> Vector3<f64> {
    sum.try_normalize(0.0).unwrap_or_default()
}
