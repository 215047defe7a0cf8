//! Prepares values in 3D space for a graphics card: as triangles whose vertices have a normal, a color and a texture coordinate.
//!
//! The shapes show the same as [`render_layers`](super::render_layers), with the same normals, colors and solids. Positions are in single
//! precision, relative to a `center` and in units of a `scale`. If only some vertices of a value have moved, a shape is [updated from the
//! previous one](update).
//!
//! The scale is a power of two near the size of the value, and the center is a multiple of the scale. So a small change of the value does
//! not change all positions. If the center followed the value exactly, every byte would change.

use std::sync::Arc;

use maquette_value::parallel::*;
use maquette_value::{Axes, Column, Layer, Material, Mesh};
use nalgebra::{Point3, Vector3};

use super::scene::{Data, FLAT, Paint};
use super::solid::meshes_of;

mod fields;
mod update;

pub use fields::Field;
use fields::fields_of;

/// The number of items that one parallel task processes.
const CHUNK: usize = 8192;

/// The index that means "no display vertex".
const NONE: u32 = u32::MAX;

/// All shapes that show a value in 3D space.
pub struct Shapes {
    /// The coordinate axes of the shapes.
    pub axes: Axes,
    pub normalization: Normalization,
    /// One shape for each mesh, and one for the solids that represent points, lines and arrows, which is the last.
    pub shapes: Vec<Arc<Shape>>,
}

/// The origin and the unit in which positions are given to the graphics card.
#[derive(Clone, Copy, PartialEq)]
pub struct Normalization {
    /// The origin of the positions, in mm.
    pub center: Point3<f64>,
    /// The unit of the positions, in mm.
    pub scale: f64,
}

/// The data with which a graphics card draws one mesh. A display vertex is a vertex in this data.
pub struct Shape {
    mesh: Mesh,
    normalization: Normalization,
    /// True if the mesh consists of the small solids that represent points, lines and arrows.
    pub is_solid: bool,
    pub positions: Column<[f32; 3]>,
    /// The normals, packed: three signed numbers of ten bits, from the lowest bit. -511 to 511 stand for -1 to 1.
    pub normals: Column<u32>,
    /// The colors: red, green and blue in sRGB, and 255. `None` if the mesh has no colors.
    pub colors: Option<Column<[u8; 4]>>,
    /// The texture coordinates. (0, 0) is the lower left corner of the texture. `None` if the mesh has no texture coordinates.
    pub uv: Option<Column<[f32; 2]>>,
    pub triangles: Column<[u32; 3]>,
    /// The runs of triangles with the same texture: the length of each run, and the index of the material with that texture. Empty if all
    /// triangles have the same texture.
    pub material_runs: Vec<(usize, Option<usize>)>,
    pub fields: Arc<[Field]>,
    /// The vertex of the mesh that each display vertex shows.
    origins: Column<u32>,
    /// The normals at the vertices of the mesh, if they were computed from the faces. `None` if the mesh contains normals.
    computed: Option<Column<[f32; 3]>>,
    leaning: Vec<Leaning>,
    /// True if a vertex of the mesh may become several display vertices, because the data at its corners differ.
    is_split: bool,
    /// The faces that are not triangulated as a fan, in ascending order. Used only if all faces have the same number of corners.
    bent: Vec<u32>,
}

/// A triangle that leans: at some of its corners, the computed vertex normal deviates too much from the normal of the triangle. At these
/// corners the triangle has its own display vertices with its own normal.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Leaning {
    triangle: usize,
    corners: [bool; 3],
    /// The normal of the triangle, packed into 30 bits.
    normal: u32,
}

impl Shapes {
    /// Builds the shapes of some layers. Returns `None` if no layer is in 3D space. `before` contains the shapes shown previously. Where
    /// possible, a shape is updated from the shape with the same index in `before`.
    pub fn from_layers(layers: &[Layer], before: &[Arc<Shape>]) -> Option<Self> {
        let (meshes, axes) = meshes_of(layers, None);
        let bounds = meshes.iter().filter_map(|(mesh, _)| mesh.cached_bounds());
        let (low, high) = bounds.reduce(|a, b| (a.0.inf(&b.0), a.1.sup(&b.1)))?;
        // Halve first: the difference of two huge numbers could be infinite.
        let half = (high.coords / 2.0 - low.coords / 2.0).amax();
        let scale = if half > 0.0 { libm::exp2(libm::log2(half).ceil()) } else { 1.0 };
        let middle = low.coords / 2.0 + high.coords / 2.0;
        let center = Point3::from(middle.map(|x| (x / scale).round() * scale));
        let normalization = Normalization { center, scale };
        let shapes = meshes
            .into_iter()
            .enumerate()
            .map(|(index, (mesh, is_solid)): (usize, (Mesh, bool))| {
                let after = before
                    .get(index)
                    .and_then(|before| before.update(&mesh, is_solid, normalization));
                after.unwrap_or_else(|| Shape::new(mesh, is_solid, normalization)).into()
            })
            .collect();
        Some(Self { axes, normalization, shapes })
    }
}

impl Normalization {
    fn apply(&self, point: Point3<f64>) -> [f32; 3] {
        ((point - self.center) / self.scale).map(|x| x as f32).into()
    }
}

impl Shape {
    fn new(mesh: Mesh, is_solid: bool, normalization: Normalization) -> Self {
        let corners = mesh.faces().corners();
        let (paint, normals) = (Paint::new(&mesh), Normals::new(&mesh));
        let split = (normals.is_by_corner() || paint.is_by_corner()).then(|| {
            weld(corners, mesh.positions().len(), |corner: u32| {
                let vertex = corners[corner as usize];
                let uv = paint.uv(corner, vertex).unwrap_or_default();
                let [r, g, b] = paint.color(corner, vertex).unwrap_or_default();
                let color = u32::from_le_bytes([r, g, b, 0]);
                [normals.packed_normal(corner, vertex), color, uv[0].to_bits(), uv[1].to_bits()]
            })
        });
        let is_split = split.is_some();
        // The display vertex of each corner.
        let (of_corners, firsts) = match &split {
            Some((of_corners, firsts)) => (&of_corners[..], Some(&firsts[..])),
            None => (&corners[..], None),
        };
        let cut = Triangulation::new(&mesh);
        let shared = |triangle| cut.vertices(triangle, of_corners);
        let leaning: Vec<Leaning> = (0..cut.len())
            .into_par_iter()
            .filter_map(|triangle| normals.find_leaning(&mesh, &cut, triangle))
            .collect();
        let count = firsts.map_or(mesh.positions().len(), <[u32]>::len);
        let separate = SeparateVertices::new(&leaning, count, shared);
        let mut triangles: Vec<[u32; 3]> = list(cut.len(), shared);
        separate.patch(&leaning, shared, |triangle, vertices| triangles[triangle] = vertices);

        let data = VertexData {
            mesh: &mesh,
            normalization,
            paint: &paint,
            normals: &normals,
            firsts,
            separate: &separate,
        };
        let count = separate.end();
        let positions = list(count, |k| data.position(k)).into();
        let packed = list(count, |k| data.normal(k)).into();
        let colors = paint.has_colors().then(|| list(count, |k| data.color(k)).into());
        let uv = paint.has_uv().then(|| list(count, |k| data.uv(k)).into());
        let origins = list(count, |k| data.origin(k)).into();
        let (triangles, fields) = (triangles.into(), fields_of(&mesh).into());
        let computed = normals.computed_normals().cloned();
        let bent = cut.bent;
        let material_runs = paint.material_runs();
        drop((cut.listed, paint, normals));
        Self {
            mesh,
            normalization,
            is_solid,
            positions,
            normals: packed,
            colors,
            uv,
            triangles,
            material_runs,
            fields,
            origins,
            computed,
            leaning,
            is_split,
            bent,
        }
    }

    /// Returns the memory that the shape needs in bytes, except for the mesh and the columns that a graphics card gets.
    pub fn size(&self) -> usize {
        let computed = self.computed.as_ref().map_or(0, Column::size);
        self.origins.size() + computed + size_of_val(&self.leaning[..])
    }

    /// Returns the first material of the shape that has a visible texture, or `None` if no material has one.
    pub fn textured_material(&self) -> Option<&Material> {
        self.materials()
            .iter()
            .find(|it| it.non_empty_picture().is_some())
            .filter(|_| self.uv.is_some())
    }

    /// Returns the materials of the mesh.
    pub fn materials(&self) -> &[Material] {
        self.mesh.materials()
    }

    /// Returns the edges of the faces as pairs of display vertices. The diagonals by which polygons are triangulated are left out.
    pub fn edges(&self) -> Vec<[u32; 2]> {
        let mut display_vertices = vec![NONE; self.mesh.positions().len()];
        for (k, &vertex) in self.origins.iter().enumerate().rev() {
            display_vertices[vertex as usize] = k as u32;
        }
        let edges = self.mesh.edges().vertices.into_iter();
        edges.map(|ends| ends.map(|vertex| display_vertices[vertex as usize])).collect()
    }

    /// Returns true if the vertices have surface parameters, as those of tessellated surfaces do.
    pub fn has_parameters(&self) -> bool {
        self.mesh.vertex().pairs("uv").is_some()
    }

    /// Returns the surface parameters (u, v) of each display vertex, or `None` if the mesh has no surface parameters.
    pub fn parameters(&self) -> Option<Vec<[f32; 2]>> {
        let uv = self.mesh.vertex().pairs("uv")?;
        Some(self.origins.iter().map(|&vertex| uv[vertex as usize].map(|x| x as f32)).collect())
    }
}

/// Builds a list of `count` items in parallel.
fn list<T: Send>(count: usize, item: impl Fn(usize) -> T + Copy + Send + Sync) -> Vec<T> {
    (0..count).into_par_iter().with_min_len(CHUNK).map(item).collect()
}

/// Merges corners of faces into display vertices. Corners become one display vertex if they are at the same mesh vertex and have equal
/// keys. Mesh vertices without corners are left out. Returns the display vertex of each corner, and the first corner of each display
/// vertex.
fn weld<K: PartialEq>(
    corners: &[u32],
    vertices: usize,
    key: impl Fn(u32) -> K,
) -> (Vec<u32>, Vec<u32>) {
    let (mut first, mut next) = (vec![NONE; vertices], Vec::new());
    let (mut keys, mut firsts) = (Vec::new(), Vec::new());
    let mut display_vertices = Vec::with_capacity(corners.len());
    for (corner, &vertex) in corners.iter().enumerate() {
        let key = key(corner as u32);
        let mut found = first[vertex as usize];
        while found != NONE && keys[found as usize] != key {
            found = next[found as usize];
        }
        if found == NONE {
            found = firsts.len() as u32;
            next.push(std::mem::replace(&mut first[vertex as usize], found));
            keys.push(key);
            firsts.push(corner as u32);
        }
        display_vertices.push(found);
    }
    (display_vertices, firsts)
}

/// The division of a mesh's faces into triangles.
struct Triangulation<'a> {
    mesh: &'a Mesh,
    /// The three corners of each triangle. Present only if the faces differ in their numbers of corners.
    listed: Option<Vec<[u32; 3]>>,
    /// The faces that are not triangulated as a fan, in ascending order. Used only if all faces have the same number of corners.
    bent: Vec<u32>,
}

impl<'a> Triangulation<'a> {
    fn new(mesh: &'a Mesh) -> Self {
        let listed = mesh.faces().sides().is_none().then(|| mesh.triangle_corners());
        let faces = if listed.is_some() || mesh.faces().sides() == Some(3) {
            0
        } else {
            mesh.faces().len() as u32
        };
        Self {
            mesh,
            listed,
            bent: (0..faces).into_par_iter().filter(|face| !mesh.is_fan(*face as usize)).collect(),
        }
    }

    fn len(&self) -> usize {
        match &self.listed {
            Some(triangles) => triangles.len(),
            None => self.mesh.faces().len() * self.of_face(),
        }
    }

    /// Returns the number of triangles into which each face is divided, or 0 if this number differs between faces.
    fn of_face(&self) -> usize {
        self.mesh.faces().sides().map_or(0, |sides| sides - 2)
    }

    /// Returns the three corners of a triangle. The corners of all faces are numbered in one sequence.
    fn corners(&self, triangle: usize) -> [usize; 3] {
        if let Some(triangles) = &self.listed {
            return triangles[triangle].map(|corner| corner as usize);
        }
        let (face, k) = (triangle / self.of_face(), triangle % self.of_face());
        let first = face * (self.of_face() + 2);
        if self.bent.binary_search(&(face as u32)).is_err() {
            return [first, first + k + 1, first + k + 2];
        }
        let corners = self.mesh.face_triangles(face).nth(k);
        corners.expect("as many triangles as in a fan").map(|corner| first + corner as usize)
    }

    /// Returns the three vertices of a triangle. `of_corners` contains the vertex at each corner of all faces.
    fn vertices(&self, triangle: usize, of_corners: &[u32]) -> [u32; 3] {
        self.corners(triangle).map(|corner| of_corners[corner])
    }
}

/// The display vertices that belong only to leaning triangles. They are stored after the shared display vertices. Some spare capacity is
/// reserved, so that other data does not move when the number of these vertices changes a little.
struct SeparateVertices {
    /// The number of display vertices that triangles share.
    count: usize,
    /// For each separate display vertex, the shared vertex that it replaces, and its packed normal.
    vertices: Vec<(u32, u32)>,
}

impl SeparateVertices {
    fn new(leaning: &[Leaning], count: usize, vertices: impl Fn(usize) -> [u32; 3]) -> Self {
        let mut separate = Vec::new();
        for Leaning { triangle, corners, normal } in leaning {
            let vertices = vertices(*triangle).into_iter().zip(corners);
            separate
                .extend(vertices.filter(|(_, leans)| **leans).map(|(vertex, _)| (vertex, *normal)));
        }
        separate.resize(Self::room(separate.len(), count), (0, 0));
        Self { count, vertices: separate }
    }

    fn room(separate: usize, count: usize) -> usize {
        separate.next_multiple_of(count / 64 + 1)
    }

    /// Returns the number of all display vertices, shared and separate.
    fn end(&self) -> usize {
        self.count + self.vertices.len()
    }

    /// Returns the shared vertex that a separate display vertex replaces. For a shared vertex, returns the vertex itself.
    fn shared_vertex(&self, vertex: usize) -> usize {
        vertex.checked_sub(self.count).map_or(vertex, |separate| self.vertices[separate].0 as usize)
    }

    fn normal(&self, vertex: usize) -> Option<u32> {
        vertex.checked_sub(self.count).map(|separate| self.vertices[separate].1)
    }

    /// Calls `to` with each leaning triangle and its three display vertices.
    fn patch(
        &self,
        leaning: &[Leaning],
        shared: impl Fn(usize) -> [u32; 3],
        mut to: impl FnMut(usize, [u32; 3]),
    ) {
        let mut next = self.count as u32;
        for Leaning { triangle, corners, .. } in leaning {
            let mut vertices = shared(*triangle);
            for (vertex, _) in vertices.iter_mut().zip(corners).filter(|(_, leans)| **leans) {
                *vertex = next;
                next += 1;
            }
            to(*triangle, vertices);
        }
    }
}

/// The normals with which a mesh is shaded: those that it contains, or computed ones.
enum Normals<'a> {
    Given(Data<'a, [f64; 3]>),
    /// Normals computed from the faces, one per vertex of the mesh.
    Computed(Column<[f32; 3]>),
}

impl<'a> Normals<'a> {
    fn new(mesh: &'a Mesh) -> Self {
        match (mesh.corner().vectors("normal"), mesh.vertex().vectors("normal")) {
            (Some(corner), _) => Self::Given(Data::Corner((&corner[..]).into())),
            (None, Some(vertex)) => Self::Given(Data::Vertex((&vertex[..]).into())),
            (None, None) => Self::Computed(mesh.cached_normals()),
        }
    }

    fn is_by_corner(&self) -> bool {
        matches!(self, Self::Given(Data::Corner(_)))
    }

    fn computed_normals(&self) -> Option<&Column<[f32; 3]>> {
        match self {
            Self::Computed(normals) => Some(normals),
            Self::Given(_) => None,
        }
    }

    /// Returns the normal at a corner, packed into 30 bits.
    fn packed_normal(&self, corner: u32, vertex: u32) -> u32 {
        match self {
            Self::Given(data) => pack_normal(data.get(corner, vertex).into()),
            Self::Computed(normals) => pack_normal(Vector3::from(normals[vertex as usize]).cast()),
        }
    }

    /// Finds the corners of a triangle at which the computed vertex normal deviates too much from the triangle's normal. Returns `None` if
    /// the triangle has no such corner.
    fn find_leaning(
        &self,
        mesh: &Mesh,
        cut: &Triangulation<'_>,
        triangle: usize,
    ) -> Option<Leaning> {
        let normals = self.computed_normals()?;
        let vertices = cut.vertices(triangle, mesh.faces().corners()).map(|k| k as usize);
        let [a, b, c] = vertices.map(|vertex| mesh.positions()[vertex]);
        let flat = (b - a).cross(&(c - a)).try_normalize(0.0)?;
        let corners = vertices
            .map(|vertex| Vector3::from(normals[vertex]).cast().dot(&flat) < f64::from(FLAT));
        let normal = pack_normal(flat);
        corners.contains(&true).then_some(Leaning { triangle, corners, normal })
    }
}

/// The source from which the data of each display vertex is computed.
#[derive(Clone, Copy)]
struct VertexData<'a> {
    mesh: &'a Mesh,
    normalization: Normalization,
    paint: &'a Paint<'a>,
    normals: &'a Normals<'a>,
    /// One of the corners of each shared display vertex. `None` if the shared display vertices are exactly the vertices of the mesh.
    firsts: Option<&'a [u32]>,
    separate: &'a SeparateVertices,
}

impl VertexData<'_> {
    /// Returns the vertex of the mesh that the display vertex `k` shows.
    fn origin(&self, k: usize) -> u32 {
        self.corner_and_vertex(k).1
    }

    fn position(&self, k: usize) -> [f32; 3] {
        self.normalization.apply(self.mesh.positions()[self.origin(k) as usize])
    }

    fn normal(&self, k: usize) -> u32 {
        let (corner, vertex) = self.corner_and_vertex(k);
        self.separate.normal(k).unwrap_or_else(|| self.normals.packed_normal(corner, vertex))
    }

    fn color(&self, k: usize) -> [u8; 4] {
        let (corner, vertex) = self.corner_and_vertex(k);
        let [r, g, b] = self.paint.color(corner, vertex).unwrap_or_default();
        [r, g, b, 255]
    }

    fn uv(&self, k: usize) -> [f32; 2] {
        let (corner, vertex) = self.corner_and_vertex(k);
        self.paint.uv(corner, vertex).unwrap_or_default()
    }

    fn corner_and_vertex(&self, k: usize) -> (u32, u32) {
        let shared = self.separate.shared_vertex(k);
        match self.firsts {
            Some(firsts) => (firsts[shared], self.mesh.faces().corners()[firsts[shared] as usize]),
            None => (NONE, shared as u32),
        }
    }
}

/// Packs a direction into 30 bits: three signed numbers of ten bits. The zero vector becomes 0.
fn pack_normal(normal: Vector3<f64>) -> u32 {
    let unit = normal.try_normalize(0.0).unwrap_or_default();
    fn bits(x: f64) -> u32 {
        (x * 511.0).round() as i32 as u32 & 0x3ff
    }
    bits(unit.x) | bits(unit.y) << 10 | bits(unit.z) << 20
}

#[cfg(test)]
mod tests {
    use maquette_value::{Attribute, Faces, TYPES};

    use super::*;

    fn mesh(points: &[[f64; 3]], faces: &[[u32; 3]]) -> Mesh {
        let points: Vec<_> = points.iter().map(|&point| Point3::from(point)).collect();
        Mesh::new(points, Faces::triangles(faces.to_vec())).unwrap()
    }

    fn shape(mesh: Mesh) -> Arc<Shape> {
        Shapes::from_layers(&[Layer::Triangles(Box::new(mesh))], &[]).unwrap().shapes.remove(0)
    }

    fn unpack_normal(normal: u32) -> Vector3<f64> {
        fn part(shift: u32, normal: u32) -> f64 {
            f64::from(((normal >> shift << 22) as i32) >> 22) / 511.0
        }
        Vector3::new(part(0, normal), part(10, normal), part(20, normal))
    }

    #[test]
    fn directions_keep_a_quarter_of_a_degree() {
        for k in 0..1000 {
            let (s, c) = libm::sincos(f64::from(k));
            let (t, d) = libm::sincos(0.37 * f64::from(k));
            let unit = Vector3::new(s * t, c * t, d);
            assert!(unpack_normal(pack_normal(unit)).normalize().dot(&unit) > 0.99999, "{unit}");
        }
        assert_eq!(pack_normal(Vector3::zeros()), 0);
    }

    #[test]
    fn smooth_faces_share_vertices_and_sharp_ones_do_not() {
        let flat = [[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]];
        let sheet = shape(mesh(&flat, &[[0, 1, 2], [0, 2, 3]]));
        assert_eq!((sheet.positions.len(), sheet.triangles.len(), sheet.edges().len()), (4, 2, 5));
        // Two faces that meet at a right angle: the normals at their common edge deviate by 45 degrees from the normals of the faces. At a
        // sharper edge they deviate by more.
        fn edge(height: f64, depth: f64) -> Arc<Shape> {
            let points = [[0., 0., 0.], [0., 1., 0.], [1., 0., 0.], [height, 0., depth]];
            shape(mesh(&points, &[[0, 2, 1], [0, 1, 3]]))
        }
        assert_eq!(edge(0.0, 1.0).positions.len(), 4);
        let sharp = edge(0.7, 0.7);
        assert_eq!(sharp.positions.len(), 8);
        assert_eq!(sharp.edges().iter().flatten().max(), Some(&3));
    }

    #[test]
    fn corners_with_different_data_are_different_vertices() {
        let flat = [[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]];
        let sheet = mesh(&flat, &[[0, 1, 2], [0, 2, 3]]);
        let colors = [[9; 3], [8; 3], [7; 3], [9; 3], [6; 3], [5; 3]];
        let sheet = sheet.with_corner("color", Attribute::Color(colors.to_vec().into())).unwrap();
        let sheet = sheet.with_face("part", Attribute::Index(vec![3, 4].into())).unwrap();
        let sheet = sheet.with_vertex("far", Attribute::Number(vec![0., 1., 2., 9.].into()));
        let sheet = shape(sheet.unwrap());
        assert_eq!(sheet.colors.as_ref().unwrap().len(), 5);
        assert_eq!(sheet.triangles[..], [[0, 1, 2], [0, 3, 4]]);
        let fields = &sheet.fields;
        let names: Vec<_> = fields.iter().map(|field| (&field.name[..], field.range)).collect();
        assert_eq!(names, [("far", [0., 9.]), ("part", [3., 4.])]);
        assert_eq!(sheet.field(&fields[0]), [0., 1., 2., 2., 9.]);
        assert_eq!(sheet.field(&fields[1]), [3., 3., 3., 4., 4., 4.]);
    }

    #[test]
    fn a_small_change_changes_few_vertices() {
        let points: Vec<_> =
            (0..10_000).map(|k: u32| [f64::from(k % 100), f64::from(k / 100), 0.0]).collect();
        let faces = (0..99).flat_map(|y| (0..99).map(move |x| y * 100 + x));
        let faces: Vec<_> = faces.map(|k| [k, k + 1, k + 101]).collect();
        let before = shape(mesh(&points, &faces));
        let mut moved = points.clone();
        moved[4242][2] = 0.5;
        let after = shape(mesh(&moved, &faces));
        let differ =
            before.positions.iter().zip(&after.positions[..]).filter(|(a, b)| a != b).count();
        let turned = before.normals.iter().zip(&after.normals[..]).filter(|(a, b)| a != b).count();
        assert_eq!((differ, before.triangles == after.triangles), (1, true));
        assert!((1..=7).contains(&turned), "{turned}");
    }

    #[test]
    fn no_edge_case_of_a_value_causes_a_panic() {
        for kind in TYPES {
            for value in kind.edge_cases() {
                let Some(shapes) = Shapes::from_layers(&value.show(), &[]) else { continue };
                for shape in &shapes.shapes {
                    let count = shape.positions.len() as u32;
                    assert!(shape.triangles.iter().flatten().all(|&vertex| vertex < count));
                    assert_eq!(shape.normals.len(), shape.positions.len());
                    shape.edges();
                    shape.fields.iter().for_each(|field| drop(shape.field(field)));
                }
            }
        }
    }
}
