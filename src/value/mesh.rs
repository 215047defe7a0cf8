//! Polygon meshes.

use std::ops::Range;
use std::sync::Arc;

use nalgebra::Point3;
use thiserror::Error;

use super::{
    Attribute, AttributeError, Attributes, CaptureFrame, Column, Image, Material, Summary,
};

mod crossings;
mod describe;
mod elements;
mod faces;
mod known;
mod moved;
mod nearest;
mod normals;
mod parts;
mod properties;
mod triangles;
mod walls;

pub use faces::{Edges, Faces};
use known::Known;
pub use moved::Moved;
pub use nearest::{NearestPlace, RayHit, TriangleTree, to_triangle};
pub use walls::Behind;

/// Why vertices and faces do not make a mesh.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum MeshError {
    /// A face with fewer than three corners.
    #[error("face {face} has {corners} corners; a face has at least 3")]
    FewCorners {
        /// The offending face.
        face: usize,
        /// Its corners.
        corners: usize,
    },
    /// Faces whose list of corners is cut off.
    #[error("{corners} corners do not make faces of {sides} corners each")]
    CutOff {
        /// Corners given.
        corners: usize,
        /// Corners per face.
        sides: usize,
    },
    /// A corner that names no vertex.
    #[error("face {face} names vertex {vertex}, but there are only {vertices}")]
    NoVertex {
        /// The offending face.
        face: usize,
        /// The vertex it names.
        vertex: u32,
        /// Number of vertices.
        vertices: usize,
    },
    /// A face that meets a vertex twice.
    #[error("face {face} meets vertex {vertex} twice")]
    RepeatedVertex {
        /// The offending face.
        face: usize,
        /// The vertex it repeats.
        vertex: u32,
    },
    /// A position that is NaN or infinite.
    #[error("vertex {vertex} is not at a finite place")]
    NotFinite {
        /// The offending vertex.
        vertex: usize,
    },
    /// A crease that names no vertex.
    #[error("a crease names vertex {vertex}, but there are only {vertices}")]
    NoCreasedVertex {
        /// The vertex it names.
        vertex: u32,
        /// Number of vertices.
        vertices: usize,
    },
    /// A crease whose sharpness is no number from 0 on.
    #[error("the crease between vertices {} and {} has the sharpness {sharpness}", ends[0], ends[1])]
    Sharpness {
        /// Its ends.
        ends: [u32; 2],
        /// What was given.
        sharpness: f64,
    },
    /// An attribute of the wrong length, or with what is no number.
    #[error(transparent)]
    Attribute(#[from] AttributeError),
    /// More vertices or corners than a 32-bit index can tell apart.
    #[error("{count} {what} are more than a mesh can hold")]
    TooLarge {
        /// What there is too much of.
        what: &'static str,
        /// How many.
        count: usize,
    },
}

fn check_count(what: &'static str, count: usize) -> Result<(), MeshError> {
    if count < u32::MAX as usize { Ok(()) } else { Err(MeshError::TooLarge { what, count }) }
}

/// A polygon mesh: faces counter-clockwise seen from outside; right-handed axes, lengths in mm.
///
/// A mesh with a [`CaptureFrame`] has the sensor's axes (x right, y down, z away); one without has y up.
///
/// Invariant, checked by [`Mesh::new`] and the `with_` methods: positions finite; each corner and each end of a crease names a
/// vertex; no face meets a vertex twice; each attribute has an entry per element, and `uv` and `normal` are finite.
#[derive(Clone, Debug, PartialEq)]
pub struct Mesh {
    positions: Column<Point3<f64>>,
    faces: Faces,
    vertex: Attributes,
    corner: Attributes,
    face: Attributes,
    /// Sharpness of the creased edges, by vertices (a < b), sorted.
    creases: Column<Crease>,
    materials: Arc<[Material]>,
    frame: Option<CaptureFrame>,
    known: Known,
}

#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Zeroable, bytemuck::Pod)]
#[repr(C)]
struct Crease {
    vertices: [u32; 2],
    sharpness: f64,
}

impl Mesh {
    /// A mesh without attributes, in a frame with y up.
    ///
    /// # Errors
    /// If a position is not finite, a corner names no vertex, or a face meets a vertex twice.
    pub fn new(positions: impl Into<Column<Point3<f64>>>, faces: Faces) -> Result<Self, MeshError> {
        let positions = positions.into();
        check_count("vertices", positions.len())?;
        check_positions(&positions)?;
        faces.check(positions.len())?;
        Ok(Self {
            positions,
            faces,
            vertex: Attributes::default(),
            corner: Attributes::default(),
            face: Attributes::default(),
            creases: Column::default(),
            materials: Arc::default(),
            frame: None,
            known: Known::default(),
        })
    }

    /// The same mesh with its vertices moved; faces and attributes are shared, and the attribute `normal` is dropped.
    ///
    /// # Errors
    /// If there are more or fewer positions than vertices, or one is not finite.
    pub fn with_positions(&self, positions: Vec<Point3<f64>>) -> Result<Self, MeshError> {
        if positions.len() != self.positions.len() {
            let (count, elements) = (positions.len(), self.positions.len());
            let error = AttributeError::Length { name: "position".into(), count, elements };
            return Err(error.into());
        }
        check_positions(&positions)?;
        let known = self.known.elsewhere();
        let mut moved = Self { positions: positions.into(), known, ..self.clone() };
        moved.vertex.remove("normal");
        moved.corner.remove("normal");
        Ok(moved)
    }

    /// The same mesh with some rows of its vertices moved, to the places of all rows, one row after the other; all else is as with
    /// [`with_positions`](Self::with_positions). Only what moves is looked at and hashed.
    ///
    /// # Errors
    /// If one of the places is not finite.
    ///
    /// # Panics
    /// If there are no such rows, they are not in order and apart from each other, or have more or fewer vertices.
    pub fn with_moved(
        &self,
        rows: &[Range<u32>],
        places: &[Point3<f64>],
    ) -> Result<Self, MeshError> {
        if let Some(bad) = super::first_not_finite(places) {
            let vertex = rows.iter().cloned().flatten().nth(bad).unwrap_or_default() as usize;
            return Err(MeshError::NotFinite { vertex });
        }
        Ok(self.with_other(self.positions.with_rows(rows, places), rows))
    }

    /// [`Self::with_moved`], by what writes the places of a piece of a row; it is called on all threads.
    ///
    /// # Errors
    /// If one of the places is not finite.
    ///
    /// # Panics
    /// If there are no such rows, or they are not in order and apart from each other.
    pub fn with_moved_by(
        &self,
        rows: &[Range<u32>],
        write: impl Fn(Range<u32>, &mut [Point3<f64>]) + Sync,
    ) -> Result<Self, MeshError> {
        let positions = self.positions.with_rows_by(rows, write);
        if let Some(vertex) = rows.iter().find_map(|row| {
            let first = row.start as usize;
            super::first_not_finite(&positions[first..row.end as usize]).map(|bad| first + bad)
        }) {
            return Err(MeshError::NotFinite { vertex });
        }
        Ok(self.with_other(positions, rows))
    }

    /// The same mesh with other places in these rows.
    fn with_other(&self, positions: Column<Point3<f64>>, rows: &[Range<u32>]) -> Self {
        let known = self.known.moved(rows, &positions);
        let mut mesh = Self { positions, known, ..self.clone() };
        mesh.vertex.remove("normal");
        mesh.corner.remove("normal");
        mesh
    }

    /// The same mesh with an attribute per vertex.
    ///
    /// # Errors
    /// If there are more or fewer entries than vertices, or texture coordinates or normals are not finite.
    pub fn with_vertex(mut self, name: &str, attribute: Attribute) -> Result<Self, MeshError> {
        self.vertex.insert(name, attribute, self.positions.len(), "vertex")?;
        Ok(self)
    }

    /// The same mesh with an attribute per corner, in the order of [`Faces::corners`].
    ///
    /// # Errors
    /// If there are more or fewer entries than corners, or texture coordinates or normals are not finite.
    pub fn with_corner(mut self, name: &str, attribute: Attribute) -> Result<Self, MeshError> {
        self.corner.insert(name, attribute, self.faces.corners().len(), "corner")?;
        Ok(self)
    }

    /// The same mesh with an attribute per face.
    ///
    /// # Errors
    /// If there are more or fewer entries than faces.
    pub fn with_face(mut self, name: &str, attribute: Attribute) -> Result<Self, MeshError> {
        self.face.insert(name, attribute, self.faces.len(), "face")?;
        Ok(self)
    }

    /// The same mesh without the vertex and corner attributes of that name.
    #[must_use]
    pub fn without(mut self, name: &str) -> Self {
        self.vertex.remove(name);
        self.corner.remove(name);
        self
    }

    /// The same mesh without the face attribute of that name.
    #[must_use]
    pub fn without_face(mut self, name: &str) -> Self {
        self.face.remove(name);
        self
    }

    /// The same mesh with these creases: vertex pairs and sharpness, 0 to 10 (10 and more never softens).
    ///
    /// # Errors
    /// If a crease names a vertex that is not there, or its sharpness is negative or NaN.
    pub fn with_creases(
        mut self,
        creases: impl IntoIterator<Item = ([u32; 2], f64)>,
    ) -> Result<Self, MeshError> {
        let mut creases: Vec<Crease> = creases
            .into_iter()
            .map(|([a, b], sharpness)| Crease { vertices: [a.min(b), a.max(b)], sharpness })
            .collect();
        for &Crease { vertices: ends, sharpness } in &creases {
            let (vertex, vertices) = (ends[1], self.positions.len());
            if vertices <= vertex as usize {
                return Err(MeshError::NoCreasedVertex { vertex, vertices });
            }
            if sharpness.is_nan() || sharpness < 0.0 {
                return Err(MeshError::Sharpness { ends, sharpness });
            }
        }
        creases.sort_by_key(|crease| crease.vertices);
        self.creases = creases.into();
        Ok(self)
    }

    /// The same mesh with one picture on all of it, in place of its materials.
    #[must_use]
    pub fn with_texture(self, texture: Option<Image>) -> Self {
        self.with_materials(Vec::from_iter(texture.map(Material::of_picture)))
    }

    /// The same mesh with these materials. If there are several, the attribute [`MATERIAL`] of faces says which face has which; one
    /// that is there is dropped if there are no longer several.
    #[must_use]
    pub fn with_materials(mut self, materials: impl Into<Arc<[Material]>>) -> Self {
        let materials = materials.into();
        if self.materials.len() > 1 && materials.len() < 2 {
            self.face.remove(MATERIAL);
        }
        self.materials = materials;
        self
    }

    /// The same mesh in a capture's frame, or none.
    #[must_use]
    pub fn with_frame(mut self, frame: Option<CaptureFrame>) -> Self {
        self.frame = frame;
        self
    }

    /// The vertices' places.
    pub fn positions(&self) -> &Column<Point3<f64>> {
        &self.positions
    }

    /// The faces.
    pub fn faces(&self) -> &Faces {
        &self.faces
    }

    /// Attributes per vertex.
    pub fn vertex(&self) -> &Attributes {
        &self.vertex
    }

    /// Attributes per corner.
    pub fn corner(&self) -> &Attributes {
        &self.corner
    }

    /// Attributes per face.
    pub fn face(&self) -> &Attributes {
        &self.face
    }

    /// The creased edges (a < b) with their sharpness, sorted by vertices.
    pub fn creases(&self) -> impl ExactSizeIterator<Item = ([u32; 2], f64)> {
        self.creases.iter().map(|crease| (crease.vertices, crease.sharpness))
    }

    /// The picture on it, if any: that of the first material that has one.
    pub fn texture(&self) -> Option<&Image> {
        self.materials.iter().find_map(|material| material.picture.as_ref())
    }

    /// How its faces look; nothing if nothing is known.
    pub fn materials(&self) -> &Arc<[Material]> {
        &self.materials
    }

    /// Which of its several materials each face has; none if all faces have the same. Other numbers mean the first one.
    pub fn face_materials(&self) -> Option<&Column<u32>> {
        match self.face.get(MATERIAL) {
            Some(Attribute::Index(numbers)) if self.materials.len() > 1 => Some(numbers),
            _ => None,
        }
    }

    /// The material that a number in [`face_materials`](Self::face_materials) means: itself, or the first one.
    pub fn known_material(&self, number: u32) -> u32 {
        if (number as usize) < self.materials.len() { number } else { 0 }
    }

    /// The material of a face, if it has one.
    pub fn material_of(&self, face: usize) -> Option<&Material> {
        let number = self.face_materials().map_or(0, |all| self.known_material(all[face]));
        self.materials.get(number as usize)
    }

    /// The frame of the capture that it came from, if any.
    pub fn frame(&self) -> Option<&CaptureFrame> {
        self.frame.as_ref()
    }

    /// Its edges.
    pub fn edges(&self) -> Edges {
        self.faces.edges()
    }

    /// Lowest and highest coordinates; none without vertices.
    pub fn bounds(&self) -> Option<(Point3<f64>, Point3<f64>)> {
        bounds(self.positions.iter())
    }
}

/// The attribute of faces that has the numbers of their materials.
pub const MATERIAL: &str = "material";

/// Elements that one task looks at.
const BLOCK: usize = 8192;

fn check_positions(positions: &[Point3<f64>]) -> Result<(), MeshError> {
    let bad = super::first_not_finite(positions);
    bad.map_or(Ok(()), |vertex| Err(MeshError::NotFinite { vertex }))
}

/// Lowest and highest coordinates; none without points.
pub fn bounds<'a>(
    mut points: impl Iterator<Item = &'a Point3<f64>>,
) -> Option<(Point3<f64>, Point3<f64>)> {
    let first = *points.next()?;
    Some(points.fold((first, first), |(low, high), point| {
        (low.coords.inf(&point.coords).into(), high.coords.sup(&point.coords).into())
    }))
}

/// Adds the box around some points to a summary.
pub(super) fn describe_bounds<'a>(
    summary: Summary,
    points: impl Iterator<Item = &'a Point3<f64>>,
) -> Summary {
    match bounds(points) {
        None => summary,
        Some((low, high)) => summary
            .with("lowest", low.coords.as_slice().to_vec())
            .with("highest", high.coords.as_slice().to_vec()),
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;

    fn quad_and_triangle() -> Mesh {
        fn at(x: f64, y: f64) -> Point3<f64> {
            Point3::new(x, y, 0.0)
        }
        let positions = vec![at(0., 0.), at(1., 0.), at(1., 1.), at(0., 1.), at(2., 0.)];
        let faces = Faces::polygons(&[4, 3], vec![0, 1, 2, 3, 1, 4, 2]).unwrap();
        Mesh::new(positions, faces).unwrap()
    }

    #[test]
    fn faces_of_several_sizes_keep_their_corners() {
        let mesh = quad_and_triangle();
        assert_eq!(mesh.faces().iter().collect::<Vec<_>>(), [&[0, 1, 2, 3][..], &[1, 4, 2]]);
        assert_eq!((mesh.faces().len(), mesh.faces().sides()), (2, None));
        let edges = mesh.edges();
        assert_eq!((edges.vertices.len(), edges.misoriented), (6, 0));
        assert_eq!(edges.faces, [1, 2, 1, 1, 1, 1]);
        assert_eq!(edges.of_corner, [0, 1, 2, 3, 4, 5, 1]);
    }

    #[test]
    fn counter_clockwise_faces_look_towards_the_viewer() {
        let mesh = quad_and_triangle();
        assert_eq!(mesh.area_vector(mesh.faces().face(0)), Vector3::new(0.0, 0.0, 1.0));
        assert!(mesh.vertex_normals().iter().all(|normal| *normal == Vector3::z()));
    }

    #[test]
    fn normals_are_the_same_for_any_number_of_threads() {
        let (width, height) = (150u32, 140u32);
        let bumpy =
            |k: u32| Point3::new(f64::from(k % width), f64::from(k / width), f64::from(k * k % 7));
        let quads =
            (0..height - 1).flat_map(|row| (0..width - 1).map(move |column| row * width + column));
        let triangles = Faces::triangles(
            quads
                .flat_map(|a: u32| [[a, a + 1, a + width], [a + 1, a + width + 1, a + width]])
                .collect(),
        );
        let mesh =
            Mesh::new((0..width * height).map(bumpy).collect::<Vec<_>>(), triangles).unwrap();
        fn normals(threads: usize, mesh: &Mesh) -> Vec<Vector3<f64>> {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| mesh.vertex_normals())
        }
        let mut expected = vec![Vector3::zeros(); mesh.positions().len()];
        for face in mesh.faces().iter() {
            face.iter().for_each(|&vertex| expected[vertex as usize] += mesh.area_vector(face));
        }
        expected.iter_mut().for_each(|normal| *normal = normal.normalize());
        for threads in [1, 2, 3, 8] {
            assert!(normals(threads, &mesh) == expected, "{threads} threads");
        }
    }

    #[test]
    fn a_face_of_many_corners_is_checked_fast_and_its_repeated_vertex_named() {
        let count = 300_000;
        let points = vec![Point3::origin(); count as usize];
        fn face(corners: Vec<u32>) -> Faces {
            Faces::uniform(corners.len(), corners).unwrap()
        }
        assert!(Mesh::new(points.clone(), face((0..count).collect())).is_ok());
        let mut corners: Vec<u32> = (0..count).collect();
        (corners[70], corners[90]) = (50, 7);
        let error = Mesh::new(points, face(corners)).unwrap_err();
        assert_eq!(error, MeshError::RepeatedVertex { face: 0, vertex: 50 });
    }

    #[test]
    fn two_faces_through_one_edge_in_the_same_direction_are_noticed() {
        let positions = vec![Point3::origin(), Point3::new(1., 0., 0.), Point3::new(0., 1., 0.)];
        let faces = Faces::triangles(vec![[0, 1, 2], [0, 1, 2]]);
        assert_eq!(Mesh::new(positions, faces).unwrap().edges().misoriented, 3);
    }

    #[test]
    fn the_edges_of_a_large_fan_are_found_fast_and_in_order() {
        let rim = 60_000;
        let positions = (0..=rim).map(|i| Point3::new(f64::from(i), 0.0, 0.0)).collect::<Vec<_>>();
        let faces = (1..rim).map(|i| [0, i, i + 1]).collect();
        let edges = Mesh::new(positions, Faces::triangles(faces)).unwrap().edges();
        assert_eq!(edges.vertices[..5], [[0, 1], [1, 2], [0, 2], [2, 3], [0, 3]]);
        assert_eq!(edges.vertices.len(), 2 * rim as usize - 1);
        assert_eq!((edges.faces[2], edges.misoriented), (2, 0));
    }

    #[test]
    fn vertices_and_faces_that_make_no_mesh_are_refused() {
        fn points(n: usize) -> Vec<Point3<f64>> {
            vec![Point3::origin(); n]
        }
        fn triangle(face: [u32; 3]) -> Faces {
            Faces::triangles(vec![face])
        }
        assert!(matches!(
            Mesh::new(points(2), triangle([0, 1, 2])),
            Err(MeshError::NoVertex { vertex: 2, .. })
        ));
        assert!(matches!(
            Mesh::new(points(3), triangle([0, 1, 1])),
            Err(MeshError::RepeatedVertex { vertex: 1, .. })
        ));
        assert!(Faces::uniform(3, vec![0, 1]).is_err());
        assert!(Faces::polygons(&[2], vec![0, 1]).is_err());
        let nowhere = vec![Point3::new(f64::NAN, 0.0, 0.0); 3];
        assert!(Mesh::new(nowhere, triangle([0, 1, 2])).is_err());
        let mesh = quad_and_triangle();
        assert!(mesh.with_vertex("filled", Attribute::Flag(vec![1].into())).is_err());
    }

    #[test]
    fn a_crease_ends_at_vertices_that_are_there() {
        fn error(ends: [u32; 2], sharpness: f64) -> String {
            quad_and_triangle().with_creases([(ends, sharpness)]).unwrap_err().to_string()
        }
        assert_eq!(error([5, 1], 2.0), "a crease names vertex 5, but there are only 5");
        assert_eq!(error([2, 1], -1.0), "the crease between vertices 1 and 2 has the sharpness -1");
        assert!(quad_and_triangle().with_creases([([2, 1], 2.0)]).is_ok());
    }

    #[test]
    fn texture_coordinates_and_normals_are_numbers() {
        let mesh = quad_and_triangle();
        let uv =
            Attribute::Pair((0..5).map(|k| [0.5, if k == 3 { f64::NAN } else { 0.0 }]).collect());
        let error = mesh.clone().with_vertex("uv", uv.clone()).unwrap_err().to_string();
        assert_eq!(error, "attribute `uv` of vertex 3 is not finite");
        let normals =
            (0..7).map(|k| [if k == 6 { f64::INFINITY } else { 0.0 }, 0.0, 1.0]).collect();
        let error = mesh.clone().with_corner("normal", Attribute::Vector(normals)).unwrap_err();
        assert_eq!(error.to_string(), "attribute `normal` of corner 6 is not finite");
        // What else a mesh carries may be unknown somewhere.
        assert!(mesh.with_vertex("distance", uv).is_ok());
    }
}
