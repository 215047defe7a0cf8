//! Meshes as one picture needs them: places in the picture, normals and colors.

use std::borrow::Cow;

use maquette_value::parallel::*;
use maquette_value::{Image, Material, Mesh, Rgb, Wrap};
use nalgebra::Vector3;

use super::camera::{Camera, Spot};
use super::light::{self, Light};
use super::{each, four, padded};

/// Vertices that one task transforms.
const CHUNK: usize = 4096;

/// Where a computed vertex normal leans away from its face by more than this cosine (50 degrees), the face is drawn flat:
/// at less, round things show facets; at more, boxes look like pillows.
pub(super) const FLAT: f32 = 0.642_787_6;

/// What is drawn: the corners, triangles and vertices of all meshes, one mesh after the other.
pub(super) struct Scene<'a> {
    corners: Cow<'a, [u32]>,
    /// Three corners per triangle; none if all faces are triangles.
    triangles: Option<Vec<[u32; 3]>>,
    pub(super) spots: Vec<Spot>,
    /// In view space.
    places: Vec<[f32; 3]>,
    skins: Vec<Skin<'a>>,
    perspective: bool,
}

/// How one mesh of a scene looks.
struct Skin<'a> {
    /// Where its corners and its vertices begin in the scene.
    first: [u32; 2],
    normals: Data<'a, [f32; 3]>,
    /// Whether the normals were computed here.
    computed: bool,
    paint: Paint<'a>,
}

/// Data at the corners of faces, or at their vertices.
pub(super) enum Data<'a, T: Clone> {
    Vertex(Cow<'a, [T]>),
    Corner(Cow<'a, [T]>),
}

impl<T: Copy> Data<'_, T> {
    pub(super) fn at(&self, corner: u32, vertex: u32) -> T {
        match self {
            Self::Vertex(data) => data[vertex as usize],
            Self::Corner(data) => data[corner as usize],
        }
    }
}

/// The color of the surface: that of its pictures, else that of its vertices, corners or materials, else that of clay.
pub(super) struct Paint<'a> {
    mesh: &'a Mesh,
    uv: Option<Data<'a, [f64; 2]>>,
    colors: Option<Data<'a, Rgb>>,
    /// The picture of each material.
    pictures: Vec<Option<(&'a Image, [Wrap; 2])>>,
    /// The number of the material of each corner, if there are several.
    materials: Option<Vec<u32>>,
}

/// One triangle, in the order of the corners of its face.
#[derive(Clone, Copy)]
pub(super) struct Triangle {
    corners: [u32; 3],
    pub(super) vertices: [u32; 3],
}

impl<'a> Scene<'a> {
    pub(super) fn new(meshes: &[&'a Mesh], camera: &Camera) -> Self {
        let perspective = camera.weighs_by_nearness();
        let (corners, triangles) = triangles_of(meshes);
        let (mut spots, mut places) = (Vec::new(), Vec::new());
        let (mut skins, mut first) = (Vec::with_capacity(meshes.len()), [0; 2]);
        for &mesh in meshes {
            skins.push(Skin::new(mesh, first, camera));
            first = [
                first[0] + mesh.faces().corners().len() as u32,
                first[1] + mesh.positions().len() as u32,
            ];
            let points = mesh.positions().par_iter().with_min_len(CHUNK);
            let seen: (Vec<Spot>, Vec<[f32; 3]>) = points
                .map(|&point| {
                    let view = camera.view(point);
                    (camera.spot(view), <[f32; 3]>::from(view.cast::<f32>()))
                })
                .unzip();
            append(&mut spots, seen.0);
            append(&mut places, seen.1);
        }
        Self { corners, triangles, spots, places, skins, perspective }
    }

    /// Number of triangles.
    pub(super) fn len(&self) -> usize {
        self.triangles.as_ref().map_or(self.corners.len() / 3, Vec::len)
    }

    pub(super) fn triangle(&self, index: usize) -> Triangle {
        let first = 3 * index as u32;
        let corners = match &self.triangles {
            Some(triangles) => triangles[index],
            None => [first, first + 1, first + 2],
        };
        Triangle { corners, vertices: each(|k| self.corners[corners[k] as usize]) }
    }

    /// A triangle with all that its shading needs.
    pub(super) fn facet(&self, triangle: Triangle) -> Facet<'_> {
        let [a, b, c] = each(|k| Vector3::from(self.places[triangle.vertices[k] as usize]));
        let flat = unit(padded((b - a).cross(&(c - a)).into()));
        let (skin, local) = self.skin(triangle);
        let normals = each(|k| {
            let normal = padded(local.corner(k, &skin.normals));
            let leans = skin.computed && dot(normal, flat.unwrap_or_default()) < FLAT;
            if leans { flat.unwrap_or_default() } else { normal }
        });
        let paint = &skin.paint;
        let number = paint.materials.as_ref().map_or(0, |all| all[local.corners[0] as usize]);
        let picture = paint.pictures.get(number as usize).copied().flatten();
        let color = match (picture.zip(paint.uv.as_ref()), &paint.colors) {
            (Some(((image, wrap), uv)), _) => {
                Color::Texture(image, wrap, each(|k| local.corner(k, uv)))
            }
            (None, Some(colors)) => Color::Mixed(each(|k| {
                let [r, g, b] = local.corner(k, colors);
                light::linear([f64::from(r), f64::from(g), f64::from(b)])
            })),
            (None, None) => Color::Clay,
        };
        Facet {
            nears: self.perspective.then(|| {
                padded(each(|k: usize| f64::from(self.spots[triangle.vertices[k] as usize].near)))
            }),
            flat,
            normals,
            color,
        }
    }

    /// The mesh of a triangle, and the triangle as that mesh counts its corners and vertices.
    fn skin(&self, triangle: Triangle) -> (&Skin<'a>, Triangle) {
        let after = self.skins.partition_point(|skin| skin.first[0] <= triangle.corners[0]);
        let skin = &self.skins[after - 1];
        let [corner, vertex] = skin.first;
        let (corners, vertices) = (triangle.corners, triangle.vertices);
        let corners = each(|k| corners[k] - corner);
        (skin, Triangle { corners, vertices: each(|k| vertices[k] - vertex) })
    }
}

impl<'a> Skin<'a> {
    fn new(mesh: &'a Mesh, first: [u32; 2], camera: &Camera) -> Self {
        let turn = |normal: Vector3<f64>| camera.turn(normal).cast::<f32>().into();
        let turn_all = |normals: &[[f64; 3]]| {
            let normals = normals.par_iter().with_min_len(CHUNK);
            normals.map(|&normal| turn(normal.into())).collect::<Vec<_>>().into()
        };
        let given = match (mesh.corner().vectors("normal"), mesh.vertex().vectors("normal")) {
            (Some(corner), _) => Some(Data::Corner(turn_all(corner))),
            (None, Some(vertex)) => Some(Data::Vertex(turn_all(vertex))),
            (None, None) => None,
        };
        let computed = given.is_none();
        let normals = given
            .unwrap_or_else(|| Data::Vertex(mesh.vertex_normals().into_iter().map(turn).collect()));
        Self { first, normals, computed, paint: Paint::of(mesh) }
    }
}

impl Triangle {
    fn corner<T: Copy>(&self, k: usize, data: &Data<'_, T>) -> T {
        data.at(self.corners[k], self.vertices[k])
    }
}

/// A triangle, ready to be shaded at any place.
pub(super) struct Facet<'a> {
    /// How near its corners are, where far things look smaller.
    nears: Option<[f64; 4]>,
    flat: Option<[f32; 4]>,
    /// By its corners.
    normals: [[f32; 4]; 3],
    color: Color<'a>,
}

/// The color of a triangle, by its corners.
enum Color<'a> {
    Clay,
    Mixed([Light; 3]),
    Texture(&'a Image, [Wrap; 2], [[f64; 2]; 3]),
}

impl Facet<'_> {
    /// The light that comes from it, linear; `shares` weighs its corners as the picture sees them.
    #[inline(always)]
    pub(super) fn shade(&self, shares: [f64; 4], inner: bool) -> Light {
        let shares = self.in_space(shares);
        let [a, b, c] = each(|k| shares[k] as f32);
        let mix =
            |parts: &[[f32; 4]; 3]| four(|k| a * parts[0][k] + b * parts[1][k] + c * parts[2][k]);
        let normal = unit(mix(&self.normals)).or(self.flat).unwrap_or([0.0, 0.0, 1.0, 0.0]);
        if inner {
            return light::lit(light::INNER, four(|k| -normal[k]));
        }
        let color = match &self.color {
            Color::Clay => light::CLAY,
            Color::Mixed(colors) => mix(colors),
            Color::Texture(image, wrap, uv) => {
                #[inline(always)]
                fn at(k: usize, shares: [f64; 4], uv: &[[f64; 2]; 3]) -> f64 {
                    shares[0] * uv[0][k] + shares[1] * uv[1][k] + shares[2] * uv[2][k]
                }
                light::linear(image.sample_beyond([at(0, shares, uv), at(1, shares, uv)], *wrap))
            }
        };
        light::lit(color, normal)
    }

    /// Weights of the corners in space, from those in the picture.
    #[inline(always)]
    fn in_space(&self, shares: [f64; 4]) -> [f64; 4] {
        let Some(nears) = self.nears else { return shares };
        let weights = four(|k| shares[k] * nears[k]);
        let sum = weights[0] + weights[1] + weights[2];
        if sum > 0.0 { four(|k| weights[k] / sum) } else { shares }
    }
}

impl<'a> Paint<'a> {
    pub(super) fn of(mesh: &'a Mesh) -> Self {
        let uv = match (mesh.corner().pairs("uv"), mesh.vertex().pairs("uv")) {
            (Some(uv), _) => Some(Data::Corner((&uv[..]).into())),
            (None, uv) => uv.map(|uv| Data::Vertex((&uv[..]).into())),
        };
        let mut pictures: Vec<_> = mesh
            .materials()
            .iter()
            .map(|it| it.shown().map(|picture| (picture, it.wrap())).filter(|_| uv.is_some()))
            .collect();
        let materials = mesh.face_materials().map(|numbers| {
            let faces = mesh.faces().iter().zip(numbers.iter());
            faces
                .flat_map(|(face, &number): (&[u32], &u32)| {
                    std::iter::repeat_n(mesh.known_material(number), face.len())
                })
                .collect::<Vec<_>>()
        });
        if materials.is_none() {
            pictures.truncate(1);
        }
        let has_picture = pictures.iter().any(Option::is_some);
        let is_whole = has_picture && pictures.iter().all(Option::is_some);
        let given = match (mesh.corner().colors("color"), mesh.vertex().colors("color")) {
            (Some(colors), _) => Some(Data::Corner((&colors[..]).into())),
            (None, colors) => colors.map(|colors| Data::Vertex((&colors[..]).into())),
        };
        let colors = if is_whole {
            None
        } else {
            given.or_else(|| {
                let colors: Vec<_> = mesh.materials().iter().map(Material::color).collect();
                match &materials {
                    Some(numbers) => Some(Data::Corner(
                        numbers.iter().map(|number| colors[*number as usize]).collect(),
                    )),
                    None => {
                        let color = *colors.first().filter(|color| **color != [255; 3])?;
                        Some(Data::Vertex(vec![color; mesh.positions().len()].into()))
                    }
                }
            })
        };
        Self { mesh, uv: uv.filter(|_| has_picture), colors, pictures, materials }
    }

    /// Whether corners at the same vertex may look different.
    pub(super) fn is_by_corner(&self) -> bool {
        matches!(self.colors, Some(Data::Corner(_))) || matches!(self.uv, Some(Data::Corner(_)))
    }

    pub(super) fn has_colors(&self) -> bool {
        self.colors.is_some()
    }

    pub(super) fn has_uv(&self) -> bool {
        self.uv.is_some()
    }

    /// The color of a corner, if it has one of its own.
    pub(super) fn color(&self, corner: u32, vertex: u32) -> Option<Rgb> {
        self.colors.as_ref().map(|colors| colors.at(corner, vertex))
    }

    /// Where a corner lies on the texture.
    pub(super) fn uv(&self, corner: u32, vertex: u32) -> Option<[f32; 2]> {
        self.uv.as_ref().map(|uv| uv.at(corner, vertex).map(|x| x as f32))
    }

    /// The pictures, and for each stretch of triangles, one after the other, how many there are and the place of their picture; nothing if
    /// all have the same one.
    pub(super) fn stretches(&self) -> Stretches {
        let Some(numbers) = self.mesh.face_materials().filter(|_| self.uv.is_some()) else {
            return Vec::new();
        };
        let mut stretches: Stretches = Vec::new();
        for (face, &number) in self.mesh.faces().iter().zip(numbers.iter()) {
            let number = self.mesh.known_material(number) as usize;
            let picture = self.pictures[number].is_some().then_some(number);
            match stretches.last_mut() {
                Some((count, last)) if *last == picture => *count += face.len() - 2,
                _ => stretches.push((face.len() - 2, picture)),
            }
        }
        stretches
    }
}

/// How many triangles follow each other with the same material, and its number if it has a picture.
pub(super) type Stretches = Vec<(usize, Option<usize>)>;

/// The vertex of each corner of all meshes, and the corners of each triangle if some faces are none.
fn triangles_of<'a>(meshes: &[&'a Mesh]) -> (Cow<'a, [u32]>, Option<Vec<[u32; 3]>>) {
    let has_polygons = meshes.iter().any(|mesh| mesh.faces().sides() != Some(3));
    let triangles = has_polygons.then(|| triangle_corners(meshes));
    if let [mesh] = meshes {
        return (Cow::Borrowed(mesh.faces().corners()), triangles);
    }
    let (mut corners, mut first) = (Vec::new(), 0);
    for mesh in meshes {
        corners.extend(mesh.faces().corners().iter().map(|vertex| first + vertex));
        first += mesh.positions().len() as u32;
    }
    (Cow::Owned(corners), triangles)
}

/// The triangles of all meshes, with their corners by index among the corners of all meshes.
fn triangle_corners(meshes: &[&Mesh]) -> Vec<[u32; 3]> {
    let mut first = 0;
    let of_meshes = meshes.iter().map(|mesh| {
        let mut triangles = mesh.triangle_corners();
        triangles.as_flattened_mut().par_iter_mut().for_each(|corner| *corner += first);
        first += mesh.faces().corners().len() as u32;
        triangles
    });
    of_meshes.reduce(|all, more| [all, more].concat()).unwrap_or_default()
}

/// Puts a list behind another, without a copy behind an empty one.
fn append<T>(all: &mut Vec<T>, mut more: Vec<T>) {
    if all.is_empty() {
        *all = more;
    } else {
        all.append(&mut more);
    }
}

#[inline(always)]
fn dot(a: [f32; 4], b: [f32; 4]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
fn unit(vector: [f32; 4]) -> Option<[f32; 4]> {
    let length = dot(vector, vector).sqrt();
    (length.is_finite() && length > 1e-12).then(|| four(|k| vector[k] / length))
}
