//! Normals of a mesh: its own, or those of its faces.

use std::borrow::Cow;

use nalgebra::Vector3;

use super::{BLOCK, Mesh};
use crate::memory::huge_vec;
use crate::parallel::*;

/// Above this many threads another look at all faces costs more than it saves.
const MOST_SCANS: usize = 16;

impl Mesh {
    /// A normal per vertex: the attribute `normal` of the vertices, whose length is whatever was given, else
    /// [`vertex_normals`](Self::vertex_normals).
    pub fn normals(&self) -> Cow<'_, [[f64; 3]]> {
        match self.vertex().vectors("normal") {
            Some(given) => Cow::Borrowed(given),
            None => bytemuck::cast_vec(self.vertex_normals()).into(),
        }
    }

    /// A unit normal per vertex: the mean of the faces' normals, each weighed by its area. Zero for a vertex of no face.
    pub fn vertex_normals(&self) -> Vec<Vector3<f64>> {
        let mut normals: Vec<Vector3<f64>> = huge_vec(self.positions.len());
        // Each thread looks at all faces and adds up the normals of its own vertices, every one in the order of the faces.
        let threads = rayon::current_num_threads().min(MOST_SCANS);
        let share = self.positions.len().div_ceil(threads).max(BLOCK);
        normals.par_chunks_mut(share).enumerate().for_each(|(index, normals)| {
            let first = (index * share) as u32;
            match self.faces.as_triangles() {
                Some(triangles) => {
                    triangles.iter().for_each(|face| self.add_area(face, first, normals));
                }
                None => self.faces.iter().for_each(|face| self.add_area(face, first, normals)),
            }
            for normal in normals {
                *normal = unit(*normal);
            }
        });
        normals
    }

    /// Adds a face's area vector to the normals of its vertices, as far as they are among those from `first` on.
    fn add_area(&self, face: &[u32], first: u32, normals: &mut [Vector3<f64>]) {
        fn place(vertex: &u32, first: u32) -> usize {
            vertex.wrapping_sub(first) as usize
        }
        if face.iter().any(|vertex| place(vertex, first) < normals.len()) {
            let area = self.area_vector(face);
            for vertex in face {
                if let Some(normal) = normals.get_mut(place(vertex, first)) {
                    *normal += area;
                }
            }
        }
    }

    /// Half the sum of the cross products of neighboring corners: as long as the face's area, pointing outward.
    pub fn area_vector(&self, face: &[u32]) -> Vector3<f64> {
        let origin = self.positions[face[0] as usize];
        fn spoke(
            k: usize,
            origin: nalgebra::Point3<f64>,
            face: &[u32],
            positions: &crate::Column<nalgebra::Point3<f64>>,
        ) -> Vector3<f64> {
            positions[face[k] as usize] - origin
        }
        (1..face.len() - 1)
            .map(|k| {
                spoke(k, origin, face, &self.positions).cross(&spoke(
                    k + 1,
                    origin,
                    face,
                    &self.positions,
                ))
            })
            .sum::<Vector3<f64>>()
            / 2.0
    }
}

/// The direction of a sum of areas; zero if there is none.
pub(super) fn unit(sum: Vector3<f64>) -> Vector3<f64> {
    sum.try_normalize(0.0).unwrap_or_default()
}
