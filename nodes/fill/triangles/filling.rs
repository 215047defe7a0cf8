//! A mesh of triangles whose holes are being filled: first the data, which never changes, then the filled vertices and faces.

use maquette_value::Mesh;
use nalgebra::Point3;

use super::triangulation::Triangulation;
use crate::plain::hole_fill::HoleFill;

/// A mesh of triangles whose holes are being filled.
#[derive(Clone, Debug)]
pub(crate) struct Filling {
    /// The data's vertices in their order, which never move, then the filled ones.
    pub(crate) points: Vec<Point3<f64>>,
    /// The data's triangles, which never change, then the filled ones.
    pub(crate) faces: Vec<[u32; 3]>,
    /// How many vertices are data.
    pub(crate) data: usize,
    /// How many triangles are data.
    pub(crate) kept: usize,
}

impl Filling {
    /// A mesh without anything filled.
    pub(crate) fn new(mesh: &Mesh) -> Self {
        let faces = mesh.triangles().into_owned();
        let (data, kept) = (mesh.positions().len(), faces.len());
        Self { points: mesh.positions().to_vec(), faces, data, kept }
    }

    /// Replaces all filled vertices and faces by those of these fills.
    pub(crate) fn add_all(&mut self, holes: &[Vec<u32>], fills: &[HoleFill]) {
        self.points.truncate(self.data);
        self.faces.truncate(self.kept);
        for (hole, fill) in holes.iter().zip(fills) {
            self.add(hole, &fill.triangulation);
        }
    }

    /// Adds the fill of a hole whose rim has these vertices.
    fn add(&mut self, rim: &[u32], triangulation: &Triangulation) {
        let (faces, kept) = triangulation.compact();
        let first = self.points.len();
        self.points
            .extend(kept[rim.len()..].iter().map(|&vertex| triangulation.points[vertex as usize]));
        self.faces.extend(faces.iter().map(|face| {
            face.map(|vertex: u32| match rim.get(vertex as usize) {
                Some(&data) => data,
                None => (first - rim.len()) as u32 + vertex,
            })
        }));
    }
}
