//! What of a value lies in space, as a graphics card takes it: triangles, with a normal, a color and a place on the texture at each
//! vertex.
//!
//! What is seen is what [`render_layers`](super::render_layers) draws: the same normals, colors and solids. Places are single precision,
//! measured from a `center` in units of a `scale`; both are round numbers, so that a small change of a value does not move all of it.
//! Where only some vertices have moved, a shape is [made of the one before](after).
//!
//! The scale is a power of two near the size of the value, and the center a multiple of the scale. A center that follows the value would
//! change every byte.

use std::sync::Arc;

use maquette_value::parallel::*;
use maquette_value::{Axes, Column, Layer, Material, Mesh};
use nalgebra::{Point3, Vector3};

use super::scene::{Data, FLAT, Paint};
use super::solid::meshes_of;

mod after;
mod fields;

pub use fields::Field;
use fields::fields_of;

/// Triangles that one task looks at.
const CHUNK: usize = 8192;

/// No display vertex.
const NONE: u32 = u32::MAX;

/// All that a value shows in space.
pub struct Shapes {
    /// Which way its axes go.
    pub axes: Axes,
    pub ruler: Ruler,
    /// Its faces, each mesh by itself, then the solids of points, lines and arrows.
    pub shapes: Vec<Arc<Shape>>,
}

/// How places are measured.
#[derive(Clone, Copy, PartialEq)]
pub struct Ruler {
    /// From where, in mm.
    pub center: Point3<f64>,
    /// The unit, in mm.
    pub scale: f64,
}

/// One mesh.
pub struct Shape {
    mesh: Mesh,
    ruler: Ruler,
    /// Whether it is made of points, lines and arrows.
    pub is_solid: bool,
    pub places: Column<[f32; 3]>,
    /// Three numbers of ten bits, -511 to 511 for -1 to 1, from the lowest bit on.
    pub normals: Column<u32>,
    /// sRGB, and 255.
    pub colors: Option<Column<[u8; 4]>>,
    /// From the lower left corner of the texture.
    pub uv: Option<Column<[f32; 2]>>,
    pub triangles: Column<[u32; 3]>,
    /// Where its triangles have different pictures: how many follow each other with the same one, and the material that has it.
    pub stretches: Vec<(usize, Option<usize>)>,
    pub fields: Arc<[Field]>,
    /// The vertex of the mesh of each vertex here.
    origins: Column<u32>,
    /// The normals of the mesh's vertices, if they were computed.
    computed: Option<Column<[f32; 3]>>,
    leaning: Vec<Leaning>,
    /// Whether a vertex of the mesh can be several here, because its corners have other data.
    is_split: bool,
    /// The faces that are not fans, in order, if all have the same number of corners.
    bent: Vec<u32>,
}

/// A triangle with corners at which a computed normal leans too far away from it: it has a vertex of its own there.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Leaning {
    triangle: usize,
    corners: [bool; 3],
    /// Its own normal, packed.
    normal: u32,
}

impl Shapes {
    /// Nothing if none of it lies in space. What was shown `before` in the same place is a start.
    pub fn of(layers: &[Layer], before: &[Arc<Shape>]) -> Option<Self> {
        let (meshes, axes) = meshes_of(layers, None);
        let bounds = meshes.iter().filter_map(|(mesh, _)| mesh.known_bounds());
        let (low, high) = bounds.reduce(|a, b| (a.0.inf(&b.0), a.1.sup(&b.1)))?;
        // Halves, because the difference of two huge numbers is infinite.
        let half = (high.coords / 2.0 - low.coords / 2.0).amax();
        let scale = if half > 0.0 { libm::exp2(libm::log2(half).ceil()) } else { 1.0 };
        let middle = low.coords / 2.0 + high.coords / 2.0;
        let center = Point3::from(middle.map(|x| (x / scale).round() * scale));
        let ruler = Ruler { center, scale };
        let shapes = meshes
            .into_iter()
            .enumerate()
            .map(|(place, (mesh, is_solid)): (usize, (Mesh, bool))| {
                let after =
                    before.get(place).and_then(|before| before.after(&mesh, is_solid, ruler));
                after.unwrap_or_else(|| Shape::new(mesh, is_solid, ruler)).into()
            })
            .collect();
        Some(Self { axes, ruler, shapes })
    }
}

impl Ruler {
    fn at(&self, place: Point3<f64>) -> [f32; 3] {
        ((place - self.center) / self.scale).map(|x| x as f32).into()
    }
}

impl Shape {
    fn new(mesh: Mesh, is_solid: bool, ruler: Ruler) -> Self {
        let corners = mesh.faces().corners();
        let (paint, normals) = (Paint::of(&mesh), Normals::of(&mesh));
        let split = (normals.is_by_corner() || paint.is_by_corner()).then(|| {
            welded(corners, mesh.positions().len(), |corner: u32| {
                let vertex = corners[corner as usize];
                let uv = paint.uv(corner, vertex).unwrap_or_default();
                let [r, g, b] = paint.color(corner, vertex).unwrap_or_default();
                let color = u32::from_le_bytes([r, g, b, 0]);
                [normals.at(corner, vertex), color, uv[0].to_bits(), uv[1].to_bits()]
            })
        });
        let is_split = split.is_some();
        // The vertex here of each corner.
        let (of_corners, firsts) = match &split {
            Some((of_corners, firsts)) => (&of_corners[..], Some(&firsts[..])),
            None => (&corners[..], None),
        };
        let cut = Triangles::of(&mesh);
        let shared = |triangle| cut.vertices(triangle, of_corners);
        let leaning: Vec<Leaning> = (0..cut.len())
            .into_par_iter()
            .filter_map(|triangle| normals.lean(&mesh, &cut, triangle))
            .collect();
        let count = firsts.map_or(mesh.positions().len(), <[u32]>::len);
        let own = Own::of(&leaning, count, shared);
        let mut triangles: Vec<[u32; 3]> = list(cut.len(), shared);
        own.patch(&leaning, shared, |triangle, vertices| triangles[triangle] = vertices);

        let seen = Seen { mesh: &mesh, ruler, paint: &paint, normals: &normals, firsts, own: &own };
        let count = own.end();
        let places = list(count, |k| seen.place(k)).into();
        let packed = list(count, |k| seen.normal(k)).into();
        let colors = paint.has_colors().then(|| list(count, |k| seen.color(k)).into());
        let uv = paint.has_uv().then(|| list(count, |k| seen.uv(k)).into());
        let origins = list(count, |k| seen.origin(k)).into();
        let (triangles, fields) = (triangles.into(), fields_of(&mesh).into());
        let computed = normals.computed().cloned();
        let bent = cut.bent;
        let stretches = paint.stretches();
        drop((cut.listed, paint, normals));
        Self {
            mesh,
            ruler,
            is_solid,
            places,
            normals: packed,
            colors,
            uv,
            triangles,
            stretches,
            fields,
            origins,
            computed,
            leaning,
            is_split,
            bent,
        }
    }

    /// How much memory it holds beside the mesh and what is shown of it, in bytes.
    pub fn size(&self) -> usize {
        let computed = self.computed.as_ref().map_or(0, Column::size);
        self.origins.size() + computed + size_of_val(&self.leaning[..])
    }

    /// The first material with a picture that is seen on it.
    pub fn textured(&self) -> Option<&Material> {
        self.materials().iter().find(|it| it.shown().is_some()).filter(|_| self.uv.is_some())
    }

    /// The materials of its faces.
    pub fn materials(&self) -> &[Material] {
        self.mesh.materials()
    }

    /// Its edges, without those that only divide faces of many corners into triangles.
    pub fn edges(&self) -> Vec<[u32; 2]> {
        let mut place = vec![NONE; self.mesh.positions().len()];
        for (k, &vertex) in self.origins.iter().enumerate().rev() {
            place[vertex as usize] = k as u32;
        }
        let edges = self.mesh.edges().vertices.into_iter();
        edges.map(|ends| ends.map(|vertex| place[vertex as usize])).collect()
    }

    /// Whether its vertices have parameters, as those of surfaces do.
    pub fn has_parameters(&self) -> bool {
        self.mesh.vertex().pairs("uv").is_some()
    }

    /// The parameters of each vertex.
    pub fn parameters(&self) -> Option<Vec<[f32; 2]>> {
        let uv = self.mesh.vertex().pairs("uv")?;
        Some(self.origins.iter().map(|&vertex| uv[vertex as usize].map(|x| x as f32)).collect())
    }
}

/// So many items, each made on some thread.
fn list<T: Send>(count: usize, item: impl Fn(usize) -> T + Copy + Send + Sync) -> Vec<T> {
    (0..count).into_par_iter().with_min_len(CHUNK).map(item).collect()
}

/// One vertex for all corners at a vertex that have the same key, vertices without corners left out: the new vertex of each corner, and
/// the first corner of each new vertex.
fn welded<K: PartialEq>(
    corners: &[u32],
    vertices: usize,
    key: impl Fn(u32) -> K,
) -> (Vec<u32>, Vec<u32>) {
    let (mut first, mut next) = (vec![NONE; vertices], Vec::new());
    let (mut keys, mut firsts) = (Vec::new(), Vec::new());
    let place = |(corner, &vertex): (usize, &u32)| {
        let key = key(corner as u32);
        let mut place = first[vertex as usize];
        while place != NONE && keys[place as usize] != key {
            place = next[place as usize];
        }
        if place == NONE {
            place = firsts.len() as u32;
            next.push(std::mem::replace(&mut first[vertex as usize], place));
            keys.push(key);
            firsts.push(corner as u32);
        }
        place
    };
    let places = corners.iter().enumerate().map(place).collect();
    (places, firsts)
}

/// The triangles of a mesh's faces.
struct Triangles<'a> {
    mesh: &'a Mesh,
    /// The corners of each, if the faces have different numbers of them.
    listed: Option<Vec<[u32; 3]>>,
    /// The faces that are not fans, in order, if all have the same number of corners.
    bent: Vec<u32>,
}

impl<'a> Triangles<'a> {
    fn of(mesh: &'a Mesh) -> Self {
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

    /// The number of triangles of each face, if that is the same for all.
    fn of_face(&self) -> usize {
        self.mesh.faces().sides().map_or(0, |sides| sides - 2)
    }

    /// The corners of a triangle, by index among the corners of all faces.
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

    /// Its vertices, of which these are those of all corners.
    fn vertices(&self, triangle: usize, of_corners: &[u32]) -> [u32; 3] {
        self.corners(triangle).map(|corner| of_corners[corner])
    }
}

/// The vertices that single triangles have to themselves, behind those that they share: with room for some more, so that a few more or
/// less leave all others where they are.
struct Own {
    /// How many are shared.
    count: usize,
    /// The shared one in its place, and its normal.
    vertices: Vec<(u32, u32)>,
}

impl Own {
    fn of(leaning: &[Leaning], count: usize, vertices: impl Fn(usize) -> [u32; 3]) -> Self {
        let mut own = Vec::new();
        for Leaning { triangle, corners, normal } in leaning {
            let vertices = vertices(*triangle).into_iter().zip(corners);
            own.extend(vertices.filter(|(_, leans)| **leans).map(|(vertex, _)| (vertex, *normal)));
        }
        own.resize(Self::room(own.len(), count), (0, 0));
        Self { count, vertices: own }
    }

    fn room(own: usize, count: usize) -> usize {
        own.next_multiple_of(count / 64 + 1)
    }

    /// How many vertices there are in all.
    fn end(&self) -> usize {
        self.count + self.vertices.len()
    }

    /// The vertex in whose place this one is.
    fn shared(&self, place: usize) -> usize {
        place.checked_sub(self.count).map_or(place, |own| self.vertices[own].0 as usize)
    }

    fn normal(&self, place: usize) -> Option<u32> {
        place.checked_sub(self.count).map(|own| self.vertices[own].1)
    }

    /// Tells for each leaning triangle its vertices.
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

/// The normals of a mesh.
enum Normals<'a> {
    Given(Data<'a, [f64; 3]>),
    /// By vertex.
    Computed(Column<[f32; 3]>),
}

impl<'a> Normals<'a> {
    fn of(mesh: &'a Mesh) -> Self {
        match (mesh.corner().vectors("normal"), mesh.vertex().vectors("normal")) {
            (Some(corner), _) => Self::Given(Data::Corner((&corner[..]).into())),
            (None, Some(vertex)) => Self::Given(Data::Vertex((&vertex[..]).into())),
            (None, None) => Self::Computed(mesh.single_normals()),
        }
    }

    fn is_by_corner(&self) -> bool {
        matches!(self, Self::Given(Data::Corner(_)))
    }

    fn computed(&self) -> Option<&Column<[f32; 3]>> {
        match self {
            Self::Computed(normals) => Some(normals),
            Self::Given(_) => None,
        }
    }

    /// Packed.
    fn at(&self, corner: u32, vertex: u32) -> u32 {
        match self {
            Self::Given(data) => packed(data.at(corner, vertex).into()),
            Self::Computed(normals) => packed(Vector3::from(normals[vertex as usize]).cast()),
        }
    }

    /// Whether a computed normal leans too far away from a triangle at a corner of it.
    fn lean(&self, mesh: &Mesh, cut: &Triangles<'_>, triangle: usize) -> Option<Leaning> {
        let normals = self.computed()?;
        let vertices = cut.vertices(triangle, mesh.faces().corners()).map(|k| k as usize);
        let [a, b, c] = vertices.map(|vertex| mesh.positions()[vertex]);
        let flat = (b - a).cross(&(c - a)).try_normalize(0.0)?;
        let lean =
            |vertex: usize| Vector3::from(normals[vertex]).cast().dot(&flat) < f64::from(FLAT);
        let corners = vertices.map(lean);
        let normal = packed(flat);
        corners.contains(&true).then_some(Leaning { triangle, corners, normal })
    }
}

/// What is at the vertices of a shape.
#[derive(Clone, Copy)]
struct Seen<'a> {
    mesh: &'a Mesh,
    ruler: Ruler,
    paint: &'a Paint<'a>,
    normals: &'a Normals<'a>,
    /// One corner of each vertex that is shared; none if they are the mesh's vertices, all data of which are their own.
    firsts: Option<&'a [u32]>,
    own: &'a Own,
}

impl Seen<'_> {
    /// The vertex of the mesh here.
    fn origin(&self, k: usize) -> u32 {
        self.corner_and_vertex(k).1
    }

    fn place(&self, k: usize) -> [f32; 3] {
        self.ruler.at(self.mesh.positions()[self.origin(k) as usize])
    }

    fn normal(&self, k: usize) -> u32 {
        let (corner, vertex) = self.corner_and_vertex(k);
        self.own.normal(k).unwrap_or_else(|| self.normals.at(corner, vertex))
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
        let shared = self.own.shared(k);
        match self.firsts {
            Some(firsts) => (firsts[shared], self.mesh.faces().corners()[firsts[shared] as usize]),
            None => (NONE, shared as u32),
        }
    }
}

/// A direction in 30 bits; 0 for none.
fn packed(normal: Vector3<f64>) -> u32 {
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
        Shapes::of(&[Layer::Triangles(Box::new(mesh))], &[]).unwrap().shapes.remove(0)
    }

    fn unpacked(normal: u32) -> Vector3<f64> {
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
            assert!(unpacked(packed(unit)).normalize().dot(&unit) > 0.99999, "{unit}");
        }
        assert_eq!(packed(Vector3::zeros()), 0);
    }

    #[test]
    fn smooth_faces_share_vertices_and_sharp_ones_do_not() {
        let flat = [[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]];
        let sheet = shape(mesh(&flat, &[[0, 1, 2], [0, 2, 3]]));
        assert_eq!((sheet.places.len(), sheet.triangles.len(), sheet.edges().len()), (4, 2, 5));
        // Two squares that meet at a right angle: the normals at their edge lean by 45 degrees, those of a sharper edge by more.
        fn edge(height: f64, depth: f64) -> Arc<Shape> {
            let points = [[0., 0., 0.], [0., 1., 0.], [1., 0., 0.], [height, 0., depth]];
            shape(mesh(&points, &[[0, 2, 1], [0, 1, 3]]))
        }
        assert_eq!(edge(0.0, 1.0).places.len(), 4);
        let sharp = edge(0.7, 0.7);
        assert_eq!(sharp.places.len(), 8);
        assert_eq!(sharp.edges().iter().flatten().max(), Some(&3));
    }

    #[test]
    fn corners_with_other_data_are_other_vertices() {
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
    fn a_small_change_moves_a_small_part() {
        let points: Vec<_> =
            (0..10_000).map(|k: u32| [f64::from(k % 100), f64::from(k / 100), 0.0]).collect();
        let faces = (0..99).flat_map(|y| (0..99).map(move |x| y * 100 + x));
        let faces: Vec<_> = faces.map(|k| [k, k + 1, k + 101]).collect();
        let before = shape(mesh(&points, &faces));
        let mut moved = points.clone();
        moved[4242][2] = 0.5;
        let after = shape(mesh(&moved, &faces));
        let differ = before.places.iter().zip(&after.places[..]).filter(|(a, b)| a != b).count();
        let turned = before.normals.iter().zip(&after.normals[..]).filter(|(a, b)| a != b).count();
        assert_eq!((differ, before.triangles == after.triangles), (1, true));
        assert!((1..=7).contains(&turned), "{turned}");
    }

    #[test]
    fn every_type_of_values_and_none_stops_the_program() {
        for kind in TYPES {
            for value in kind.hostile() {
                let Some(shapes) = Shapes::of(&value.show(), &[]) else { continue };
                for shape in &shapes.shapes {
                    let count = shape.places.len() as u32;
                    assert!(shape.triangles.iter().flatten().all(|&place| place < count));
                    assert_eq!(shape.normals.len(), shape.places.len());
                    shape.edges();
                    shape.fields.iter().for_each(|field| drop(shape.field(field)));
                }
            }
        }
    }
}
