//! What of a value lies in space, as a graphics card takes it: triangles, with a normal, a color and a place on the texture at each
//! vertex.
//!
//! What is seen is what [`render_layers`](super::render_layers) draws: the same normals, colors and solids. Places are single precision,
//! measured from a `center` in units of a `scale`; both are round numbers, so that a small change of a value does not move all of it.

use nalgebra::{Point3, Vector3};

use super::scene::{Data, FLAT, Paint, fans_of};
use super::solid::meshes_of;
use crate::parallel::*;
use crate::value::{Attribute, Axes, Image, Layer, Mesh, On, Rgb, bounds};

/// Triangles that one task looks at.
const CHUNK: usize = 8192;

/// No display vertex.
const NONE: u32 = u32::MAX;

/// All that a value shows in space.
pub(crate) struct Shapes {
    /// Which way its axes go.
    pub(crate) axes: Axes,
    /// What places are measured from, in mm.
    pub(crate) center: Point3<f64>,
    /// The unit of places, in mm.
    pub(crate) scale: f64,
    /// Its faces, each mesh by itself, then the solids of points, lines and arrows.
    pub(crate) shapes: Vec<Shape>,
}

/// One mesh.
pub(crate) struct Shape {
    mesh: Mesh,
    /// Whether it is made of points, lines and arrows.
    pub(crate) is_solid: bool,
    pub(crate) places: Vec<[f32; 3]>,
    /// Three numbers of ten bits, -511 to 511 for -1 to 1, from the lowest bit on.
    pub(crate) normals: Vec<u32>,
    /// sRGB, and 255.
    pub(crate) colors: Option<Vec<[u8; 4]>>,
    /// From the lower left corner of the texture.
    pub(crate) uv: Option<Vec<[f32; 2]>>,
    pub(crate) triangles: Vec<[u32; 3]>,
    /// The vertex of the mesh of each vertex here.
    origins: Vec<u32>,
}

/// Numbers that a mesh has, to be shown as colors.
pub(crate) struct Field {
    pub(crate) name: String,
    /// Vertices, or corners or faces.
    pub(crate) on: On,
    /// The least and the greatest of them.
    pub(crate) range: [f64; 2],
    /// What most of them are between: a few that are far off leave colors for the rest.
    pub(crate) usual: [f64; 2],
}

impl Shapes {
    /// Nothing if none of it lies in space.
    pub(crate) fn of(layers: &[Layer]) -> Option<Self> {
        let (meshes, axes) = meshes_of(layers, None);
        let all = meshes.iter().flat_map(|(mesh, _)| mesh.positions().iter());
        let (low, high) = bounds(all)?;
        // Halves, because the difference of two huge numbers is infinite.
        let half = (high.coords / 2.0 - low.coords / 2.0).amax();
        let scale = if half > 0.0 { libm::exp2(libm::log2(half).ceil()) } else { 1.0 };
        let middle = low.coords / 2.0 + high.coords / 2.0;
        let center = Point3::from(middle.map(|x| (x / scale).round() * scale));
        let shape = |(mesh, is_solid)| Shape::new(mesh, is_solid, center, scale);
        let shapes = meshes.into_iter().map(shape).collect();
        Some(Self { axes, center, scale, shapes })
    }
}

impl Shape {
    fn new(mesh: Mesh, is_solid: bool, center: Point3<f64>, scale: f64) -> Self {
        let corners = mesh.faces().corners();
        let fans = (mesh.faces().sides() != Some(3)).then(|| fans_of(&[&mesh]));
        let count = fans.as_ref().map_or(corners.len() / 3, Vec::len);
        // The corners of the mesh's faces that each triangle has.
        let corner = |triangle: usize, k: usize| match &fans {
            Some(fans) => fans[triangle][k] as usize,
            None => 3 * triangle + k,
        };
        let paint = Paint::of(&mesh);
        let normals = Normals::of(&mesh);
        let by_corner = normals.is_by_corner() || paint.is_by_corner();
        let mut origins: Vec<u32> = (0..mesh.positions().len() as u32).collect();
        // The vertex here of each corner.
        let mut places = corners.to_vec();
        if by_corner {
            let key = |corner: usize| {
                let vertex = corners[corner];
                let uv = paint.uv(corner as u32, vertex).unwrap_or_default();
                let [r, g, b] = paint.color(corner as u32, vertex).unwrap_or_default();
                let color = u32::from_le_bytes([r, g, b, 0]);
                [normals.at(corner, vertex), color, uv[0].to_bits(), uv[1].to_bits()]
            };
            (places, origins) = welded(corners, mesh.positions().len(), key);
        }
        let mut corner_of = vec![NONE; origins.len()];
        for (corner, place) in places.iter().enumerate() {
            corner_of[*place as usize] = corner as u32;
        }
        let mut triangles: Vec<[u32; 3]> = (0..count)
            .into_par_iter()
            .with_min_len(CHUNK)
            .map(|triangle| [0, 1, 2].map(|k| places[corner(triangle, k)]))
            .collect();
        let mut packed =
            Vec::from_iter(origins.iter().zip(&corner_of).map(|(&vertex, &corner)| {
                if corner == NONE { 0 } else { normals.at(corner as usize, vertex) }
            }));
        // Where a normal leans too far away from its face, the face has a vertex of its own there.
        for (triangle, flat) in normals.leaning(&mesh, &triangles, &origins) {
            for (k, flat) in flat.into_iter().enumerate() {
                let Some(flat) = flat else { continue };
                let place = &mut triangles[triangle][k];
                let (origin, corner) = (origins[*place as usize], corner_of[*place as usize]);
                *place = origins.len() as u32;
                origins.push(origin);
                corner_of.push(corner);
                packed.push(flat);
            }
        }
        let at = |vertex: usize| {
            let place = mesh.positions()[vertex];
            ((place - center) / scale).map(|x| x as f32).into()
        };
        let of_corner = |k: usize| (corner_of[k] != NONE).then_some((corner_of[k], origins[k]));
        let all = 0..origins.len();
        let colors = paint.has_colors().then(|| {
            let color = |k| of_corner(k).and_then(|(corner, vertex)| paint.color(corner, vertex));
            all.clone().map(|k| opaque(color(k).unwrap_or_default())).collect()
        });
        let uv = paint.has_uv().then(|| {
            let uv = |k| of_corner(k).and_then(|(corner, vertex)| paint.uv(corner, vertex));
            all.map(|k| uv(k).unwrap_or_default()).collect()
        });
        let places = origins.par_iter().with_min_len(CHUNK).map(|&vertex| at(vertex as usize));
        let places = places.collect();
        let normals = packed;
        drop(paint);
        Self { mesh, is_solid, places, normals, colors, uv, triangles, origins }
    }

    /// How much memory it holds, in bytes, without the mesh.
    pub(crate) fn size(&self) -> usize {
        let vertex = size_of_val(&self.places[..]) + size_of_val(&self.normals[..]);
        vertex + size_of_val(&self.triangles[..]) + size_of_val(&self.origins[..])
    }

    /// The picture on it.
    pub(crate) fn texture(&self) -> Option<&Image> {
        self.mesh.texture().filter(|_| self.uv.is_some())
    }

    /// Its edges, without those that only divide faces of many corners into triangles.
    pub(crate) fn edges(&self) -> Vec<[u32; 2]> {
        let mut place = vec![NONE; self.mesh.positions().len()];
        for (k, &vertex) in self.origins.iter().enumerate().rev() {
            place[vertex as usize] = k as u32;
        }
        let edges = self.mesh.edges().vertices.into_iter();
        edges.map(|ends| ends.map(|vertex| place[vertex as usize])).collect()
    }

    /// Whether its vertices have parameters, as those of surfaces do.
    pub(crate) fn has_parameters(&self) -> bool {
        self.mesh.vertex().pairs("uv").is_some()
    }

    /// The parameters of each vertex.
    pub(crate) fn parameters(&self) -> Option<Vec<[f32; 2]>> {
        let uv = self.mesh.vertex().pairs("uv")?;
        let pair = |&vertex: &u32| uv[vertex as usize].map(|x| x as f32);
        Some(self.origins.iter().map(pair).collect())
    }

    /// The numbers that it has beside those which are seen anyway.
    pub(crate) fn fields(&self) -> Vec<Field> {
        let all = [
            (On::Vertex, self.mesh.vertex()),
            (On::Corner, self.mesh.corner()),
            (On::Face, self.mesh.face()),
        ];
        let named = all.into_iter().flat_map(|(on, attributes)| {
            attributes.iter().map(move |(name, attribute)| (on, name, attribute))
        });
        let field = |(on, name, attribute): (On, &str, &Attribute)| {
            if name == "normal" {
                return None;
            }
            let mut numbers = Vec::from_iter(numbers_of(attribute)?.filter(|x| x.is_finite()));
            let range = numbers
                .iter()
                .fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], &x| [a.min(x), b.max(x)]);
            if numbers.is_empty() {
                return None;
            }
            let tenth = (numbers.len() - 1) / 10;
            let last = numbers.len() - 1 - tenth;
            let low = *numbers.select_nth_unstable_by(tenth, f64::total_cmp).1;
            let high = *numbers.select_nth_unstable_by(last, f64::total_cmp).1;
            let more = (high - low) / 2.0;
            let usual = [range[0].max(low - more), range[1].min(high + more)];
            let usual = if low < high { usual } else { range };
            let name = name.to_owned();
            Some(Field { name, on, range, usual })
        };
        named.filter_map(field).collect()
    }

    /// The numbers of a field: for each vertex here if it is one of vertices, else for each corner of each triangle.
    pub(crate) fn field(&self, field: &Field) -> Vec<f32> {
        let attributes = match field.on {
            On::Vertex => self.mesh.vertex(),
            On::Corner => self.mesh.corner(),
            _ => self.mesh.face(),
        };
        let numbers = attributes.get(&field.name).and_then(numbers_of);
        let numbers = Vec::from_iter(numbers.into_iter().flatten().map(|x| x as f32));
        if field.on == On::Vertex {
            return self.origins.iter().map(|&vertex| numbers[vertex as usize]).collect();
        }
        let mut first = 0;
        let mut all = Vec::with_capacity(3 * self.triangles.len());
        for (face, corners) in self.mesh.faces().iter().enumerate() {
            for k in 1..corners.len() - 1 {
                let corner = |k: usize| numbers[first + k];
                match field.on {
                    On::Corner => all.extend([0, k, k + 1].map(corner)),
                    _ => all.extend([numbers[face]; 3]),
                }
            }
            first += corners.len();
        }
        all
    }
}

/// The numbers of an attribute, lengths of vectors among them; none of colors and pairs.
fn numbers_of(attribute: &Attribute) -> Option<Box<dyn Iterator<Item = f64> + '_>> {
    Some(match attribute {
        Attribute::Number(column) => Box::new(column.iter().copied()),
        Attribute::Index(column) => Box::new(column.iter().map(|&x| f64::from(x))),
        Attribute::Flag(column) => Box::new(column.iter().map(|&x| f64::from(x))),
        Attribute::Vector(column) => Box::new(column.iter().map(|&x| Vector3::from(x).norm())),
        Attribute::Pair(_) | Attribute::Color(_) => return None,
    })
}

fn opaque([r, g, b]: Rgb) -> [u8; 4] {
    [r, g, b, 255]
}

/// One vertex for all corners at a vertex that have the same key, vertices without corners left out: the new vertex of each corner, and
/// the old one of each new vertex.
fn welded<K: PartialEq>(
    corners: &[u32],
    vertices: usize,
    key: impl Fn(usize) -> K,
) -> (Vec<u32>, Vec<u32>) {
    let (mut first, mut next) = (vec![NONE; vertices], Vec::new());
    let (mut keys, mut origins) = (Vec::new(), Vec::new());
    let place = |(corner, &vertex): (usize, &u32)| {
        let key = key(corner);
        let mut place = first[vertex as usize];
        while place != NONE && keys[place as usize] != key {
            place = next[place as usize];
        }
        if place == NONE {
            place = origins.len() as u32;
            next.push(std::mem::replace(&mut first[vertex as usize], place));
            keys.push(key);
            origins.push(vertex);
        }
        place
    };
    let places = corners.iter().enumerate().map(place).collect();
    (places, origins)
}

/// The normals of a mesh, packed.
enum Normals {
    Given(Data<u32>),
    /// By vertex, as they are and packed.
    Computed(Vec<Vector3<f64>>, Vec<u32>),
}

impl Normals {
    fn of(mesh: &Mesh) -> Self {
        let pack_all = |normals: &[[f64; 3]]| normals.iter().map(|&n| packed(n.into())).collect();
        match (mesh.corner().vectors("normal"), mesh.vertex().vectors("normal")) {
            (Some(corner), _) => Self::Given(Data::Corner(pack_all(corner))),
            (None, Some(vertex)) => Self::Given(Data::Vertex(pack_all(vertex))),
            (None, None) => {
                let normals = mesh.vertex_normals();
                let each = normals.par_iter().with_min_len(CHUNK).map(|&normal| packed(normal));
                let packed = each.collect();
                Self::Computed(normals, packed)
            }
        }
    }

    fn is_by_corner(&self) -> bool {
        matches!(self, Self::Given(Data::Corner(_)))
    }

    fn at(&self, corner: usize, vertex: u32) -> u32 {
        match self {
            Self::Given(data) => data.at(corner as u32, vertex),
            Self::Computed(_, packed) => packed[vertex as usize],
        }
    }

    /// The triangles with a corner at which a computed normal leans too far away, and their own normal there.
    fn leaning(
        &self,
        mesh: &Mesh,
        triangles: &[[u32; 3]],
        origins: &[u32],
    ) -> Vec<(usize, [Option<u32>; 3])> {
        let Self::Computed(normals, _) = self else { return Vec::new() };
        let leaning = |(index, triangle): (usize, &[u32; 3])| {
            let vertices = triangle.map(|place| origins[place as usize] as usize);
            let [a, b, c] = vertices.map(|vertex| mesh.positions()[vertex]);
            let flat = (b - a).cross(&(c - a)).try_normalize(0.0)?;
            let leans = |vertex: usize| normals[vertex].dot(&flat) < f64::from(FLAT);
            let leaning = vertices.map(|vertex| leans(vertex).then(|| packed(flat)));
            leaning.iter().any(Option::is_some).then_some((index, leaning))
        };
        let chunks = triangles.par_chunks(CHUNK).enumerate();
        let found: Vec<Vec<_>> = chunks
            .map(|(chunk, part)| {
                let each = part.iter().enumerate();
                each.filter_map(|(k, triangle)| leaning((chunk * CHUNK + k, triangle))).collect()
            })
            .collect();
        found.into_iter().flatten().collect()
    }
}

/// A direction in 30 bits; 0 for none.
fn packed(normal: Vector3<f64>) -> u32 {
    let unit = normal.try_normalize(0.0).unwrap_or_default();
    let bits = |x: f64| (x * 511.0).round() as i32 as u32 & 0x3ff;
    bits(unit.x) | bits(unit.y) << 10 | bits(unit.z) << 20
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::value::{Faces, TYPES};

    fn mesh(points: &[[f64; 3]], faces: &[[u32; 3]]) -> Mesh {
        let points = Vec::from_iter(points.iter().map(|&point| Point3::from(point)));
        Mesh::new(points, Faces::triangles(faces.to_vec())).unwrap()
    }

    fn shape(mesh: Mesh) -> Shape {
        Shapes::of(&[Layer::Triangles(Box::new(mesh))]).unwrap().shapes.remove(0)
    }

    fn unpacked(normal: u32) -> Vector3<f64> {
        let part = |shift: u32| f64::from(((normal >> shift << 22) as i32) >> 22) / 511.0;
        Vector3::new(part(0), part(10), part(20))
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
        let edge = |height: f64, depth: f64| {
            let points = [[0., 0., 0.], [0., 1., 0.], [1., 0., 0.], [height, 0., depth]];
            shape(mesh(&points, &[[0, 2, 1], [0, 1, 3]]))
        };
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
        assert_eq!(sheet.triangles, [[0, 1, 2], [0, 3, 4]]);
        let fields = sheet.fields();
        let names = Vec::from_iter(fields.iter().map(|field| (&field.name[..], field.range)));
        assert_eq!(names, [("far", [0., 9.]), ("part", [3., 4.])]);
        assert_eq!(sheet.field(&fields[0]), [0., 1., 2., 2., 9.]);
        assert_eq!(sheet.field(&fields[1]), [3., 3., 3., 4., 4., 4.]);
    }

    #[test]
    fn a_small_change_moves_a_small_part() {
        let row = |k: u32| [f64::from(k % 100), f64::from(k / 100), 0.0];
        let points = Vec::from_iter((0..10_000).map(row));
        let faces = (0..99).flat_map(|y| (0..99).map(move |x| y * 100 + x));
        let faces = Vec::from_iter(faces.map(|k| [k, k + 1, k + 101]));
        let before = shape(mesh(&points, &faces));
        let mut moved = points.clone();
        moved[4242][2] = 0.5;
        let after = shape(mesh(&moved, &faces));
        let differ = before.places.iter().zip(&after.places).filter(|(a, b)| a != b).count();
        let turned = before.normals.iter().zip(&after.normals).filter(|(a, b)| a != b).count();
        assert_eq!((differ, before.triangles == after.triangles), (1, true));
        assert!((1..=7).contains(&turned), "{turned}");
    }

    #[test]
    fn every_type_of_values_and_none_stops_the_program() {
        for kind in TYPES {
            for value in kind.hostile() {
                let Some(shapes) = Shapes::of(&value.show()) else { continue };
                for shape in &shapes.shapes {
                    let count = shape.places.len() as u32;
                    assert!(shape.triangles.iter().flatten().all(|&place| place < count));
                    assert_eq!(shape.normals.len(), shape.places.len());
                    shape.edges();
                    shape.fields().iter().for_each(|field| drop(shape.field(field)));
                }
            }
        }
    }
}
