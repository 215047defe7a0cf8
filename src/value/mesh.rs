//! Polygon meshes.

use std::ops::Range;
use std::sync::Arc;

use nalgebra::{Point3, Vector3};
use thiserror::Error;

use super::{
    Attribute, AttributeError, Attributes, CaptureFrame, Column, Image, Material, Summary,
};

mod coincident;
mod crossings;
mod derived;
mod diff;
mod edges;
mod elements;
mod faces;
mod flat;
mod nearest;
mod normals;
mod properties;
mod triangles;
mod value;
mod walls;

pub use coincident::DistinctPositions;
use derived::DerivedData;
pub use diff::MovedRows;
pub use edges::Edges;
pub use faces::Faces;
pub use nearest::{NearestPoint, RayHit, TriangleTree, closest_on_triangle};
pub use walls::Backing;

/// Error of building a mesh.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum MeshError {
    /// An attribute has the wrong length, or a number that is not finite.
    #[error(transparent)]
    Attribute(#[from] AttributeError),
    /// There are more vertices or corners than a 32-bit index can address.
    #[error("{count} {what} are more than a mesh can hold")]
    TooLarge {
        /// The kind of elements: `vertices`, `corners`, `faces` or `spans`.
        what: &'static str,
        /// The number of elements of that kind.
        count: usize,
    },
    /// Any other violation of the invariant of [`Mesh`]; contains the message.
    #[error("{0}")]
    Invalid(String),
}

impl MeshError {
    fn not_finite(vertex: usize) -> Self {
        Self::Invalid(format!("the position of vertex {vertex} is not finite"))
    }
}

fn check_count(what: &'static str, count: usize) -> Result<(), MeshError> {
    if count < u32::MAX as usize { Ok(()) } else { Err(MeshError::TooLarge { what, count }) }
}

/// A polygon mesh. The corners of a face are counter-clockwise seen from outside. Axes are right-handed, lengths in mm.
///
/// A mesh with a [`CaptureFrame`] has the axes of the sensor (x right, y down, z away). A mesh without a frame has y up.
///
/// Invariant, checked by [`Mesh::new`] and the `with_` methods: positions are finite. Each corner of a face and each end of a crease refers
/// to an existing vertex. No face contains a vertex twice. Each attribute has one entry per element, and `uv` and `normal` are finite.
#[derive(Clone, Debug, PartialEq)]
pub struct Mesh {
    positions: Column<Point3<f64>>,
    faces: Faces,
    vertex: Attributes,
    corner: Attributes,
    face: Attributes,
    /// The creased edges as pairs of vertices (a < b), each with its sharpness, sorted.
    creases: Column<Crease>,
    materials: Arc<[Material]>,
    frame: Option<CaptureFrame>,
    derived: DerivedData,
}

#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Zeroable, bytemuck::Pod)]
#[repr(C)]
struct Crease {
    vertices: [u32; 2],
    sharpness: f64,
}

impl Mesh {
    /// Builds a mesh without attributes and without a capture frame (y is up).
    ///
    /// # Errors
    /// If a position is not finite, a corner refers to a missing vertex, or a face contains a vertex twice.
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
            derived: DerivedData::default(),
        })
    }

    /// The mesh with new positions of its vertices. Faces and attributes are shared with this mesh, but the attribute `normal` is dropped.
    ///
    /// # Errors
    /// If the number of positions differs from the number of vertices, or a position is not finite.
    pub fn with_positions(&self, positions: Vec<Point3<f64>>) -> Result<Self, MeshError> {
        AttributeError::check_len("position", positions.len(), self.positions.len())?;
        check_positions(&positions)?;
        let derived = self.derived.after_moving_all();
        let mut moved = Self { positions: positions.into(), derived, ..self.clone() };
        moved.vertex.remove("normal");
        moved.corner.remove("normal");
        Ok(moved)
    }

    /// The mesh with new positions in some rows of vertices. `positions` holds the positions of all these rows, one row after the other.
    /// Only the moved vertices are checked and hashed; otherwise the method equals [`with_positions`](Self::with_positions).
    ///
    /// # Errors
    /// If a position is not finite.
    ///
    /// # Panics
    /// If a row is out of bounds, rows overlap or are not in ascending order, or `positions` has the wrong length.
    pub fn with_moved(
        &self,
        rows: &[Range<u32>],
        positions: &[Point3<f64>],
    ) -> Result<Self, MeshError> {
        if let Some(bad) = super::first_not_finite(positions) {
            let vertex = rows.iter().cloned().flatten().nth(bad).unwrap_or_default() as usize;
            return Err(MeshError::not_finite(vertex));
        }
        Ok(self.with_other(self.positions.with_rows(rows, positions), rows))
    }

    /// As [`Self::with_moved`], but the new positions are written by a function, which gets one piece of a row at a time and is called on
    /// all threads.
    ///
    /// # Errors
    /// If a position is not finite.
    ///
    /// # Panics
    /// If a row is out of bounds, or rows overlap or are not in ascending order.
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
            return Err(MeshError::not_finite(vertex));
        }
        Ok(self.with_other(positions, rows))
    }

    /// The mesh with the given positions. Only positions in `rows` may differ from those of this mesh.
    fn with_other(&self, positions: Column<Point3<f64>>, rows: &[Range<u32>]) -> Self {
        let derived = self.derived.after_moving_rows(rows, &positions);
        let mut mesh = Self { positions, derived, ..self.clone() };
        mesh.vertex.remove("normal");
        mesh.corner.remove("normal");
        mesh
    }

    /// Adds or replaces a vertex attribute.
    ///
    /// # Errors
    /// If the number of entries differs from the number of vertices, or texture coordinates or normals are not finite.
    pub fn with_vertex(mut self, name: &str, attribute: Attribute) -> Result<Self, MeshError> {
        self.vertex.insert(name, attribute, self.positions.len(), "vertex")?;
        Ok(self)
    }

    /// Adds or replaces a corner attribute, in the order of [`Faces::corners`].
    ///
    /// # Errors
    /// If the number of entries differs from the number of corners, or texture coordinates or normals are not finite.
    pub fn with_corner(mut self, name: &str, attribute: Attribute) -> Result<Self, MeshError> {
        self.corner.insert(name, attribute, self.faces.corners().len(), "corner")?;
        Ok(self)
    }

    /// Adds or replaces a face attribute.
    ///
    /// # Errors
    /// If the number of entries differs from the number of faces.
    pub fn with_face(mut self, name: &str, attribute: Attribute) -> Result<Self, MeshError> {
        self.face.insert(name, attribute, self.faces.len(), "face")?;
        Ok(self)
    }

    /// Removes the vertex and corner attributes with this name.
    #[must_use]
    pub fn without_attribute(mut self, name: &str) -> Self {
        self.vertex.remove(name);
        self.corner.remove(name);
        self
    }

    /// Removes the face attribute with this name.
    #[must_use]
    pub fn without_face(mut self, name: &str) -> Self {
        self.face.remove(name);
        self
    }

    /// Replaces the creases: pairs of vertices with a sharpness of at least 0. A crease of sharpness 10 or more never softens.
    ///
    /// # Errors
    /// If a crease refers to a missing vertex, or its sharpness is negative or NaN.
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
                return Err(MeshError::Invalid(format!(
                    "a crease refers to vertex {vertex}, but there are only {vertices}"
                )));
            }
            if sharpness.is_nan() || sharpness < 0.0 {
                return Err(MeshError::Invalid(format!(
                    "the crease between vertices {} and {} has the sharpness {sharpness}, expected a number of at least 0",
                    ends[0], ends[1]
                )));
            }
        }
        creases.sort_by_key(|crease| crease.vertices);
        self.creases = creases.into();
        Ok(self)
    }

    /// Replaces the materials by one picture on the whole mesh.
    #[must_use]
    pub fn with_texture(self, texture: Option<Image>) -> Self {
        self.with_materials(Vec::from_iter(texture.map(Material::from_picture)))
    }

    /// Replaces the materials. With several materials, the face attribute [`MATERIAL_ATTRIBUTE`] keeps the material index of each face.
    /// With one or none, that attribute is dropped.
    #[must_use]
    pub fn with_materials(mut self, materials: impl Into<Arc<[Material]>>) -> Self {
        let materials = materials.into();
        if self.materials.len() > 1 && materials.len() < 2 {
            self.face.remove(MATERIAL_ATTRIBUTE);
        }
        self.materials = materials;
        self
    }

    /// Sets or removes the capture frame.
    #[must_use]
    pub fn with_frame(mut self, frame: Option<CaptureFrame>) -> Self {
        self.frame = frame;
        self
    }

    /// The positions of the vertices.
    pub fn positions(&self) -> &Column<Point3<f64>> {
        &self.positions
    }

    /// The faces of the mesh, as lists of vertex indices.
    pub fn faces(&self) -> &Faces {
        &self.faces
    }

    /// The attributes of the vertices.
    pub fn vertex(&self) -> &Attributes {
        &self.vertex
    }

    /// The attributes of the corners of faces.
    pub fn corner(&self) -> &Attributes {
        &self.corner
    }

    /// The attributes of the faces.
    pub fn face(&self) -> &Attributes {
        &self.face
    }

    /// The creased edges (a < b) with their sharpness, sorted by vertices.
    pub fn creases(&self) -> impl ExactSizeIterator<Item = ([u32; 2], f64)> {
        self.creases.iter().map(|crease| (crease.vertices, crease.sharpness))
    }

    /// The texture, if any: the picture of the first material that has one.
    pub fn texture(&self) -> Option<&Image> {
        self.materials.iter().find_map(|material| material.picture.as_ref())
    }

    /// The materials; empty if none are known.
    pub fn materials(&self) -> &Arc<[Material]> {
        &self.materials
    }

    /// The material index of each face. `None` if all faces have the same material. An index out of range means the first material.
    pub fn face_materials(&self) -> Option<&Column<u32>> {
        match self.face.get(MATERIAL_ATTRIBUTE) {
            Some(Attribute::Index(numbers)) if self.materials.len() > 1 => Some(numbers),
            _ => None,
        }
    }

    /// Resolves an index from [`face_materials`](Self::face_materials): the index itself, or 0 if it is out of range.
    pub fn resolve_material(&self, number: u32) -> u32 {
        if (number as usize) < self.materials.len() { number } else { 0 }
    }

    /// The material of a face, if there is one.
    pub fn material_of(&self, face: usize) -> Option<&Material> {
        let number = self.face_materials().map_or(0, |all| self.resolve_material(all[face]));
        self.materials.get(number as usize)
    }

    /// The frame of the capture that the mesh came from, if any.
    pub fn frame(&self) -> Option<&CaptureFrame> {
        self.frame.as_ref()
    }

    /// Computes the edges of the faces.
    pub fn edges(&self) -> Edges {
        self.faces.edges()
    }

    /// The minimum and maximum coordinates; `None` without vertices.
    pub fn bounds(&self) -> Option<(Point3<f64>, Point3<f64>)> {
        bounds(self.positions.iter())
    }
}

/// The name of the face attribute that holds the material index of each face.
pub const MATERIAL_ATTRIBUTE: &str = "material";

/// The number of elements per parallel task.
const BLOCK: usize = 8192;

fn check_positions(positions: &[Point3<f64>]) -> Result<(), MeshError> {
    let bad = super::first_not_finite(positions);
    bad.map_or(Ok(()), |vertex| Err(MeshError::not_finite(vertex)))
}

/// The minimum and maximum coordinates; `None` without points.
pub fn bounds<'a>(
    mut points: impl Iterator<Item = &'a Point3<f64>>,
) -> Option<(Point3<f64>, Point3<f64>)> {
    let first = *points.next()?;
    Some(points.fold((first, first), |(low, high), point| {
        (low.coords.inf(&point.coords).into(), high.coords.sup(&point.coords).into())
    }))
}

/// The length of the diagonal of the bounding box of some points.
pub(super) fn diagonal(points: &[Point3<f64>]) -> f64 {
    bounds(points.iter()).map_or(0.0, |(low, high)| (high - low).norm())
}

/// The distance from a point to the bounding box of some points.
pub(super) fn distance_from_box<'a>(
    to: Point3<f64>,
    points: impl Iterator<Item = &'a Point3<f64>>,
) -> f64 {
    bounds(points).map_or(f64::INFINITY, |(low, high)| {
        (low - to).sup(&(to - high)).sup(&Vector3::zeros()).norm()
    })
}

/// Adds the bounding box of some points to a summary.
pub(super) fn describe_bounds<'a>(
    summary: Summary,
    points: impl Iterator<Item = &'a Point3<f64>>,
) -> Summary {
    match bounds(points) {
        None => summary,
        Some((low, high)) => summary
            .with_fact("lowest", low.coords.as_slice().to_vec())
            .with_fact("highest", high.coords.as_slice().to_vec()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A sheet of `width` x `height` vertices, whose faces have 3 or 4 sides. `z` gives the height of each vertex.
    pub(super) fn sheet([width, height]: [u32; 2], sides: usize, z: impl Fn(u32) -> f64) -> Mesh {
        let points = (0..width * height)
            .map(|k| Point3::new(f64::from(k % width), f64::from(k / width), z(k)));
        let cells = (0..height - 1).flat_map(|row| (0..width - 1).map(move |k| row * width + k));
        let corners = cells.flat_map(|a: u32| {
            let below = a + width;
            match sides {
                3 => vec![a, a + 1, below, a + 1, below + 1, below],
                _ => vec![a, a + 1, below + 1, below],
            }
        });
        let faces = Faces::uniform(sides, corners.collect::<Vec<_>>()).unwrap();
        Mesh::new(points.collect::<Vec<_>>(), faces).unwrap()
    }

    fn quad_and_triangle() -> Mesh {
        fn point_xy(x: f64, y: f64) -> Point3<f64> {
            Point3::new(x, y, 0.0)
        }
        let positions = vec![
            point_xy(0., 0.),
            point_xy(1., 0.),
            point_xy(1., 1.),
            point_xy(0., 1.),
            point_xy(2., 0.),
        ];
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
    fn counter_clockwise_faces_point_towards_the_viewer() {
        let mesh = quad_and_triangle();
        assert_eq!(mesh.area_vector(mesh.faces().face(0)), Vector3::new(0.0, 0.0, 1.0));
        assert!(mesh.vertex_normals().iter().all(|normal| *normal == Vector3::z()));
    }

    #[test]
    fn normals_are_the_same_for_any_number_of_threads() {
        let mesh = sheet([150, 140], 3, |k| f64::from(k * k % 7));
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
    fn large_faces_are_checked_fast_for_repeated_vertices() {
        let count = 300_000;
        let points = vec![Point3::origin(); count as usize];
        fn face(corners: Vec<u32>) -> Faces {
            Faces::uniform(corners.len(), corners).unwrap()
        }
        assert!(Mesh::new(points.clone(), face((0..count).collect())).is_ok());
        let mut corners: Vec<u32> = (0..count).collect();
        (corners[70], corners[90]) = (50, 7);
        let error = Mesh::new(points, face(corners)).unwrap_err();
        assert_eq!(error.to_string(), "face 0 contains vertex 50 twice");
    }

    #[test]
    fn misoriented_edges_are_counted() {
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
    fn invalid_meshes_are_refused() {
        fn points(n: usize) -> Vec<Point3<f64>> {
            vec![Point3::origin(); n]
        }
        fn triangle(face: [u32; 3]) -> Faces {
            Faces::triangles(vec![face])
        }
        fn error(count: usize, face: [u32; 3]) -> String {
            Mesh::new(points(count), triangle(face)).unwrap_err().to_string()
        }
        assert_eq!(error(2, [0, 1, 2]), "face 0 refers to vertex 2, but there are only 2");
        assert_eq!(error(3, [0, 1, 1]), "face 0 contains vertex 1 twice");
        assert!(Faces::uniform(3, vec![0, 1]).is_err());
        assert!(Faces::polygons(&[2], vec![0, 1]).is_err());
        let nowhere = vec![Point3::new(f64::NAN, 0.0, 0.0); 3];
        assert!(Mesh::new(nowhere, triangle([0, 1, 2])).is_err());
        let mesh = quad_and_triangle();
        assert!(mesh.with_vertex("filled", Attribute::Flag(vec![1].into())).is_err());
    }

    #[test]
    fn creases_must_end_at_existing_vertices() {
        fn error(ends: [u32; 2], sharpness: f64) -> String {
            quad_and_triangle().with_creases([(ends, sharpness)]).unwrap_err().to_string()
        }
        assert_eq!(error([5, 1], 2.0), "a crease refers to vertex 5, but there are only 5");
        assert_eq!(
            error([2, 1], -1.0),
            "the crease between vertices 1 and 2 has the sharpness -1, expected a number of at least 0"
        );
        assert!(quad_and_triangle().with_creases([([2, 1], 2.0)]).is_ok());
    }

    #[test]
    fn texture_coordinates_and_normals_must_be_finite() {
        let mesh = quad_and_triangle();
        let uv =
            Attribute::Pair((0..5).map(|k| [0.5, if k == 3 { f64::NAN } else { 0.0 }]).collect());
        let error = mesh.clone().with_vertex("uv", uv.clone()).unwrap_err().to_string();
        assert_eq!(error, "attribute `uv` of vertex 3 is not finite");
        let normals =
            (0..7).map(|k| [if k == 6 { f64::INFINITY } else { 0.0 }, 0.0, 1.0]).collect();
        let error = mesh.clone().with_corner("normal", Attribute::Vector(normals)).unwrap_err();
        assert_eq!(error.to_string(), "attribute `normal` of corner 6 is not finite");
        // Attributes other than `uv` and `normal` may contain NaN.
        assert!(mesh.with_vertex("distance", uv).is_ok());
    }
}
