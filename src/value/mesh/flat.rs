//! Faces without area.

use super::Mesh;
use crate::parallel::*;

/// The height below which a face has no area, as a fraction of the diagonal of the mesh.
const FLAT: f64 = 1e-9;

impl Mesh {
    /// The height in mm up to which a triangle has no area: 1e-9 of the diagonal of the mesh.
    pub fn flat_height(&self) -> f64 {
        self.bounds().map_or(0.0, |(low, high)| (high - low).norm() * FLAT)
    }

    /// The indices of the faces without area, ascending: twice their area, divided by their longest side, is at most
    /// [`flat_height`](Self::flat_height). For a triangle this is its smallest height.
    pub fn flat_faces(&self) -> Vec<u32> {
        let height = self.flat_height();
        (0..self.faces().len())
            .into_par_iter()
            .with_min_len(1024)
            .filter(|&face: &usize| {
                let face = self.faces().face(face);
                let sides = face.iter().zip(face[1..].iter().chain(&face[..1]));
                let longest = sides
                    .map(|(&a, &b)| {
                        (self.positions()[b as usize] - self.positions()[a as usize]).norm()
                    })
                    .fold(0.0, f64::max);
                2.0 * self.area_vector(face).norm() <= height * longest
            })
            .map(|face| face as u32)
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use crate::{Faces, Mesh};

    #[test]
    fn needles_and_caps_have_no_area() {
        let points =
            [[0., 0., 0.], [10., 0., 0.], [0., 10., 0.], [5., 0., 1e-10], [10., 1e-10, 0.]];
        let faces = vec![[0, 1, 2], [1, 0, 3], [2, 4, 1], [0, 4, 3], [3, 2, 0]];
        let points = Vec::from(points.map(Point3::from));
        assert_eq!(Mesh::new(points, Faces::triangles(faces)).unwrap().flat_faces(), [1, 2, 3]);
    }
}
