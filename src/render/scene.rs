//! A mesh as one picture needs it: places in the picture, normals and colors.

use nalgebra::Vector3;
use rayon::prelude::*;

use super::camera::{Camera, Spot};
use super::light;
use crate::value::{Image, Mesh, Rgb};

/// Vertices that one task transforms.
const CHUNK: usize = 4096;

/// Where a computed vertex normal leans away from its face by more than this cosine (50 degrees), the face is drawn flat:
/// at less, round things show facets; at more, boxes look like pillows.
const FLAT: f32 = 0.642_787_6;

/// What is drawn.
pub(super) struct Scene<'a> {
    corners: &'a [u32],
    /// Three corners per triangle; none if all faces are triangles.
    fans: Option<Vec<[u32; 3]>>,
    pub(super) spots: Vec<Spot>,
    /// In view space.
    places: Vec<[f32; 3]>,
    normals: Data<[f32; 3]>,
    /// Whether the normals were computed here.
    computed: bool,
    paint: Paint<'a>,
    perspective: bool,
}

/// Data at the corners of faces, or at their vertices.
enum Data<T> {
    Vertex(Vec<T>),
    Corner(Vec<T>),
}

impl<T: Copy> Data<T> {
    fn at(&self, corner: u32, vertex: u32) -> T {
        match self {
            Self::Vertex(data) => data[vertex as usize],
            Self::Corner(data) => data[corner as usize],
        }
    }
}

/// The color of the surface.
enum Paint<'a> {
    Clay,
    Colors(Data<Rgb>),
    Texture(&'a Image, Data<[f64; 2]>),
}

/// One triangle, in the order of the corners of its face.
#[derive(Clone, Copy)]
pub(super) struct Triangle {
    corners: [u32; 3],
    pub(super) vertices: [u32; 3],
}

impl<'a> Scene<'a> {
    pub(super) fn new(mesh: &'a Mesh, camera: &Camera) -> Self {
        let points = mesh.positions().par_iter().with_min_len(CHUNK);
        let (spots, places) = points
            .map(|&point| {
                let view = camera.view(point);
                (camera.spot(view), <[f32; 3]>::from(view.cast::<f32>()))
            })
            .unzip();
        let turn = |normal: Vector3<f64>| camera.turn(normal).cast::<f32>().into();
        let turn_all = |normals: &[[f64; 3]]| {
            let normals = normals.par_iter().with_min_len(CHUNK);
            normals.map(|&normal| turn(normal.into())).collect()
        };
        let given = match (mesh.corner().vectors("normal"), mesh.vertex().vectors("normal")) {
            (Some(corner), _) => Some(Data::Corner(turn_all(corner))),
            (None, Some(vertex)) => Some(Data::Vertex(turn_all(vertex))),
            (None, None) => None,
        };
        let computed = given.is_none();
        let normals = given
            .unwrap_or_else(|| Data::Vertex(mesh.vertex_normals().into_iter().map(turn).collect()));
        let fans = mesh.faces().sides() != Some(3);
        Self {
            corners: mesh.faces().corners(),
            fans: fans.then(|| fans_of(mesh)),
            spots,
            places,
            normals,
            computed,
            paint: Paint::of(mesh),
            perspective: camera.weighs_by_nearness(),
        }
    }

    /// Number of triangles.
    pub(super) fn len(&self) -> usize {
        self.fans.as_ref().map_or(self.corners.len() / 3, Vec::len)
    }

    pub(super) fn triangle(&self, index: usize) -> Triangle {
        let first = 3 * index as u32;
        let corners =
            self.fans.as_ref().map_or_else(|| [first, first + 1, first + 2], |fans| fans[index]);
        Triangle { corners, vertices: corners.map(|corner| self.corners[corner as usize]) }
    }

    /// The light that comes from a triangle, linear; `shares` weighs its corners as the picture sees them.
    pub(super) fn shade(&self, triangle: Triangle, shares: [f64; 3], inner: bool) -> [f32; 3] {
        let shares = self.in_space(triangle, shares);
        let mix3 = |parts: [[f32; 3]; 3]| {
            [0, 1, 2].map(|k| (0..3).map(|i| shares[i] as f32 * parts[i][k]).sum::<f32>())
        };
        let flat = self.flat_normal(triangle);
        let normal = mix3([0, 1, 2].map(|i| {
            let normal = self.normals.at(triangle.corners[i], triangle.vertices[i]);
            let leans = self.computed && dot(normal, flat) < FLAT;
            if leans { flat } else { normal }
        }));
        let normal = unit(normal).or(unit(flat)).unwrap_or([0.0, 0.0, 1.0]);
        if inner {
            return light::lit(light::INNER, normal.map(|x| -x));
        }
        let color = match &self.paint {
            Paint::Clay => light::CLAY,
            Paint::Colors(colors) => mix3([0, 1, 2].map(|i| {
                light::linear(colors.at(triangle.corners[i], triangle.vertices[i]).map(f64::from))
            })),
            Paint::Texture(image, uv) => {
                let uv = [0, 1, 2].map(|i| uv.at(triangle.corners[i], triangle.vertices[i]));
                let at = [0, 1].map(|k| (0..3).map(|i| shares[i] * uv[i][k]).sum::<f64>());
                light::linear(image.sample(at))
            }
        };
        light::lit(color, normal)
    }

    /// Weights of a triangle's corners in space, from those in the picture.
    fn in_space(&self, triangle: Triangle, shares: [f64; 3]) -> [f64; 3] {
        if !self.perspective {
            return shares;
        }
        let near = |i: usize| f64::from(self.spots[triangle.vertices[i] as usize].near);
        let weighed = [0, 1, 2].map(|i| shares[i] * near(i));
        let sum: f64 = weighed.iter().sum();
        if sum > 0.0 { weighed.map(|weight| weight / sum) } else { shares }
    }

    fn flat_normal(&self, triangle: Triangle) -> [f32; 3] {
        let [a, b, c] = triangle.vertices.map(|vertex| Vector3::from(self.places[vertex as usize]));
        unit((b - a).cross(&(c - a)).into()).unwrap_or_default()
    }
}

impl<'a> Paint<'a> {
    fn of(mesh: &'a Mesh) -> Self {
        let picture = mesh.texture().filter(|picture| !picture.pixels().is_empty());
        if let Some(picture) = picture {
            if let Some(uv) = mesh.corner().pairs("uv") {
                return Self::Texture(picture, Data::Corner(uv.to_vec()));
            }
            if let Some(uv) = mesh.vertex().pairs("uv") {
                return Self::Texture(picture, Data::Vertex(uv.to_vec()));
            }
        }
        match (mesh.corner().colors("color"), mesh.vertex().colors("color")) {
            (Some(colors), _) => Self::Colors(Data::Corner(colors.to_vec())),
            (None, Some(colors)) => Self::Colors(Data::Vertex(colors.to_vec())),
            (None, None) => Self::Clay,
        }
    }
}

fn fans_of(mesh: &Mesh) -> Vec<[u32; 3]> {
    let mut first = 0;
    let mut fans = Vec::with_capacity(mesh.faces().corners().len());
    for face in mesh.faces().iter() {
        let sides = face.len() as u32;
        fans.extend((1..sides - 1).map(|k| [first, first + k, first + k + 1]));
        first += sides;
    }
    fans
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn unit(vector: [f32; 3]) -> Option<[f32; 3]> {
    let length = dot(vector, vector).sqrt();
    (length.is_finite() && length > 1e-12).then(|| vector.map(|x| x / length))
}
