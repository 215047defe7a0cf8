//! A triangle mesh whose holes are being filled: the vertices and faces of the input mesh ("data"), followed by those of the fill.

use maquette_value::Mesh;
use nalgebra::Point3;

use super::triangulation::Triangulation;
use crate::plain::hole_fill::HoleFill;

/// A triangle mesh whose holes are being filled. "Data" in the names of its parts refers to the input mesh.
#[derive(Clone, Debug)]
pub(crate) struct Filling {
    /// The vertices of the input mesh in their order, followed by those of the fill. The former never move.
    pub(crate) points: Vec<Point3<f64>>,
    /// The triangles of the input mesh, followed by those of the fill. The former never change.
    pub(crate) faces: Vec<[u32; 3]>,
    /// The number of vertices of the input mesh.
    pub(crate) n_data_vertices: usize,
    /// The number of triangles of the input mesh.
    pub(crate) n_data_faces: usize,
}

impl Filling {
    /// Returns the triangles of `mesh`, without any fill.
    pub(crate) fn new(mesh: &Mesh) -> Self {
        let faces = mesh.triangles().into_owned();
        let (data, kept) = (mesh.positions().len(), faces.len());
        Self { points: mesh.positions().to_vec(), faces, n_data_vertices: data, n_data_faces: kept }
    }

    /// Returns the position of a vertex.
    pub(crate) fn point(&self, vertex: u32) -> Point3<f64> {
        self.points[vertex as usize]
    }

    /// Returns the positions of a triangle's vertices.
    pub(crate) fn corners(&self, face: [u32; 3]) -> [Point3<f64>; 3] {
        face.map(|vertex| self.point(vertex))
    }

    /// Replaces all vertices and faces of the fill by those in `fills`, which has one entry per hole.
    pub(crate) fn add_all(&mut self, holes: &[Vec<u32>], fills: &[HoleFill]) {
        self.points.truncate(self.n_data_vertices);
        self.faces.truncate(self.n_data_faces);
        for (hole, fill) in holes.iter().zip(fills) {
            self.add(hole, &fill.triangulation);
        }
    }

    /// Appends the fill of a hole with the rim vertices `rim`.
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
