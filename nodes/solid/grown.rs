//! A mesh with more faces.

use maquette_value::{Attribute, Faces, Mesh, MeshError};
use nalgebra::Point3;

/// A mesh and what is added to it: each new vertex, corner and face has what lies on one of the mesh's own.
pub(crate) struct Grown<'a> {
    mesh: &'a Mesh,
    positions: Vec<Point3<f64>>,
    corners: Vec<u32>,
    sides: Vec<usize>,
    like_vertices: Vec<u32>,
    like_corners: Vec<u32>,
    like_faces: Vec<u32>,
}

impl<'a> Grown<'a> {
    pub(crate) fn new(mesh: &'a Mesh) -> Self {
        let faces = mesh.faces();
        Self {
            mesh,
            positions: mesh.positions().to_vec(),
            corners: faces.corners().to_vec(),
            sides: faces.iter().map(<[u32]>::len).collect(),
            like_vertices: (0..mesh.positions().len() as u32).collect(),
            like_corners: (0..faces.corners().len() as u32).collect(),
            like_faces: (0..faces.len() as u32).collect(),
        }
    }

    /// Adds a vertex with what lies on the vertex `like`.
    pub(crate) fn add_vertex(&mut self, at: Point3<f64>, like: u32) -> u32 {
        self.positions.push(at);
        self.like_vertices.push(like);
        self.positions.len() as u32 - 1
    }

    /// Adds a face with what lies on the face `like`: at each corner a vertex, and the corner of the mesh that is like it.
    pub(crate) fn add_face(&mut self, corners: impl IntoIterator<Item = [u32; 2]>, like: u32) {
        let before = self.corners.len();
        for [vertex, like] in corners {
            self.corners.push(vertex);
            self.like_corners.push(like);
        }
        self.sides.push(self.corners.len() - before);
        self.like_faces.push(like);
    }

    /// Both as one mesh, without normals: one at a border would be that of what is added there, too.
    pub(crate) fn mesh(self) -> Result<Mesh, MeshError> {
        let faces = match self.sides.iter().all(|count| *count == 3) {
            true => Faces::uniform(3, self.corners)?,
            false => Faces::polygons(&self.sides, self.corners)?,
        };
        let mut mesh = Mesh::new(self.positions, faces)?
            .with_creases(self.mesh.creases())?
            .with_materials(self.mesh.materials().clone())
            .with_frame(self.mesh.frame().copied());
        let kept = |(name, _): &(&str, &Attribute)| *name != "normal";
        for (name, attribute) in self.mesh.vertex().iter().filter(kept) {
            mesh = mesh.with_vertex(name, attribute.select(&self.like_vertices))?;
        }
        for (name, attribute) in self.mesh.corner().iter().filter(kept) {
            mesh = mesh.with_corner(name, attribute.select(&self.like_corners))?;
        }
        for (name, attribute) in self.mesh.face().iter() {
            mesh = mesh.with_face(name, attribute.select(&self.like_faces))?;
        }
        Ok(mesh)
    }
}

/// The sides of faces at the border of a mesh: a face, and the places of the side's two corners among those of all faces.
pub(crate) fn border(mesh: &Mesh) -> Vec<(u32, [u32; 2])> {
    let (edges, faces) = (mesh.edges(), mesh.faces());
    let mut border = Vec::new();
    for face in 0..faces.len() {
        let (first, count) = (faces.first_corner(face), faces.face(face).len());
        let sides = (0..count).map(|k| [first + k, first + (k + 1) % count]);
        let open = sides.filter(|side| edges.faces[edges.of_corner[side[0]] as usize] == 1);
        border.extend(open.map(|side| (face as u32, side.map(|corner| corner as u32))));
    }
    border
}
