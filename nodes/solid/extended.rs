//! A mesh that is extended by new faces.

use maquette_value::{Attribute, Faces, Mesh, MeshError};
use nalgebra::Point3;

/// A mesh with added vertices and faces. Each added vertex, corner and face copies the attributes of an existing one.
pub(crate) struct ExtendedMesh<'a> {
    mesh: &'a Mesh,
    positions: Vec<Point3<f64>>,
    corners: Vec<u32>,
    sides: Vec<usize>,
    like_vertices: Vec<u32>,
    like_corners: Vec<u32>,
    like_faces: Vec<u32>,
    creases: Vec<([u32; 2], f64)>,
}

impl<'a> ExtendedMesh<'a> {
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
            creases: mesh.creases().collect(),
        }
    }

    /// Returns a mesh without vertices and faces. Those that are added copy the attributes of elements of `mesh`.
    pub(crate) fn without_elements(mesh: &'a Mesh) -> Self {
        Self {
            mesh,
            positions: Vec::new(),
            corners: Vec::new(),
            sides: Vec::new(),
            like_vertices: Vec::new(),
            like_corners: Vec::new(),
            like_faces: Vec::new(),
            creases: Vec::new(),
        }
    }

    pub(crate) fn has_faces(&self) -> bool {
        !self.sides.is_empty()
    }

    /// Adds a vertex that copies the attributes of the vertex `like`.
    pub(crate) fn add_vertex(&mut self, at: Point3<f64>, like: u32) -> u32 {
        self.positions.push(at);
        self.like_vertices.push(like);
        self.positions.len() as u32 - 1
    }

    /// Adds a face that copies the attributes of the face `like`. Each corner is given as a pair: its vertex, and the existing corner whose
    /// attributes are copied.
    pub(crate) fn add_face(&mut self, corners: impl IntoIterator<Item = [u32; 2]>, like: u32) {
        let before = self.corners.len();
        for [vertex, like] in corners {
            self.corners.push(vertex);
            self.like_corners.push(like);
        }
        self.sides.push(self.corners.len() - before);
        self.like_faces.push(like);
    }

    /// Returns the extended mesh, without vertex and corner normals: normals at a border would be wrong for the new faces.
    pub(crate) fn mesh(self) -> Result<Mesh, MeshError> {
        let faces = match self.sides.iter().all(|count| *count == 3) {
            true => Faces::uniform(3, self.corners)?,
            false => Faces::polygons(&self.sides, self.corners)?,
        };
        let mut mesh = Mesh::new(self.positions, faces)?
            .with_creases(self.creases)?
            .with_materials(self.mesh.materials().clone())
            .with_frame(self.mesh.frame().copied());
        fn is_kept((name, _): &(&str, &Attribute)) -> bool {
            *name != "normal"
        }
        for (name, attribute) in self.mesh.vertex().iter().filter(is_kept) {
            mesh = mesh.with_vertex(name, attribute.select(&self.like_vertices))?;
        }
        for (name, attribute) in self.mesh.corner().iter().filter(is_kept) {
            mesh = mesh.with_corner(name, attribute.select(&self.like_corners))?;
        }
        for (name, attribute) in self.mesh.face().iter() {
            mesh = mesh.with_face(name, attribute.select(&self.like_faces))?;
        }
        Ok(mesh)
    }
}

/// Returns the border edges of a mesh: for each edge, its face, and the indices of its two corners among all corners.
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
