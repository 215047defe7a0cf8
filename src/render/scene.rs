//! Prepares meshes for drawing one picture: computes projected positions, normals and colors.

use std::borrow::Cow;

use maquette_value::parallel::*;
use maquette_value::{Image, Material, Mesh, Rgb, Wrap};
use nalgebra::Vector3;

use super::camera::{Camera, ProjectedVertex};
use super::light::{self, BackFaces, Light};
use super::{array3, array4, pad};

/// The number of vertices that one parallel task processes.
const CHUNK: usize = 4096;

/// The cosine of 50 degrees. If a computed vertex normal deviates by a larger angle from the normal of a face, the face is shaded flat at
/// that vertex. With a smaller limit round objects would show facets; with a larger one boxes would look like pillows.
pub(super) const FLAT: f32 = 0.642_787_6;

/// The corners, triangles and vertices of all meshes in a picture, mesh after mesh.
pub(super) struct Scene<'a> {
    corners: Cow<'a, [u32]>,
    /// The three corners of each triangle, as indices into `corners`. `None` if all faces are triangles, so that triangle k has the corners
    /// 3k to 3k + 2.
    triangles: Option<Vec<[u32; 3]>>,
    pub(super) projected: Vec<ProjectedVertex>,
    /// The position of each vertex in view space.
    view_positions: Vec<[f32; 3]>,
    shadings: Vec<MeshShading<'a>>,
    perspective: bool,
    back_face: Light,
}

/// The data for shading one mesh of a scene.
struct MeshShading<'a> {
    /// The index in the scene of the mesh's first corner and of its first vertex.
    first: [u32; 2],
    normals: Data<'a, [f32; 3]>,
    /// True if the normals were computed from the faces, false if the mesh contains them.
    is_computed: bool,
    paint: Paint<'a>,
}

/// Data with one item per corner of the faces, or one item per vertex.
pub(super) enum Data<'a, T: Clone> {
    Vertex(Cow<'a, [T]>),
    Corner(Cow<'a, [T]>),
}

impl<T: Copy> Data<'_, T> {
    pub(super) fn get(&self, corner: u32, vertex: u32) -> T {
        match self {
            Self::Vertex(data) => data[vertex as usize],
            Self::Corner(data) => data[corner as usize],
        }
    }
}

/// The colors of a mesh. They come from its textures, otherwise from its vertices, corners or materials. Without any of these, all are the
/// color of clay.
pub(super) struct Paint<'a> {
    mesh: &'a Mesh,
    uv: Option<Data<'a, [f64; 2]>>,
    colors: Option<Data<'a, Rgb>>,
    /// The texture of each material, with the wrap modes that continue it beyond its border. `None` for a material without a texture.
    pictures: Vec<Option<(&'a Image, [Wrap; 2])>>,
    /// The index of the material at each corner. Present only if there are several materials.
    materials: Option<Vec<u32>>,
}

/// A triangle of a mesh. Its corners are in the same order as in their face.
#[derive(Clone, Copy)]
pub(super) struct Triangle {
    corners: [u32; 3],
    pub(super) vertices: [u32; 3],
}

impl<'a> Scene<'a> {
    pub(super) fn new(meshes: &[&'a Mesh], camera: &Camera, back_faces: BackFaces) -> Self {
        let perspective = camera.is_perspective();
        let (corners, triangles) = triangles_of(meshes);
        let (mut projected, mut view_positions) = (Vec::new(), Vec::new());
        let (mut shadings, mut first) = (Vec::with_capacity(meshes.len()), [0; 2]);
        for &mesh in meshes {
            shadings.push(MeshShading::new(mesh, first, camera));
            first = [
                first[0] + mesh.faces().corners().len() as u32,
                first[1] + mesh.positions().len() as u32,
            ];
            let points = mesh.positions().par_iter().with_min_len(CHUNK);
            let seen: (Vec<ProjectedVertex>, Vec<[f32; 3]>) = points
                .map(|&point| {
                    let view = camera.view(point);
                    (camera.project(view), <[f32; 3]>::from(view.cast::<f32>()))
                })
                .unzip();
            append(&mut projected, seen.0);
            append(&mut view_positions, seen.1);
        }
        let back_face = light::back_face(back_faces);
        Self { corners, triangles, projected, view_positions, shadings, perspective, back_face }
    }

    /// Returns the number of triangles in the scene.
    pub(super) fn len(&self) -> usize {
        self.triangles.as_ref().map_or(self.corners.len() / 3, Vec::len)
    }

    pub(super) fn triangle(&self, index: usize) -> Triangle {
        let first = 3 * index as u32;
        let corners = match &self.triangles {
            Some(triangles) => triangles[index],
            None => [first, first + 1, first + 2],
        };
        Triangle { corners, vertices: array3(|k| self.corners[corners[k] as usize]) }
    }

    /// Collects the data for shading a triangle.
    pub(super) fn facet(&self, triangle: Triangle) -> Facet<'_> {
        let [a, b, c] =
            array3(|k| Vector3::from(self.view_positions[triangle.vertices[k] as usize]));
        let flat = unit(pad((b - a).cross(&(c - a)).into()));
        let (shading, local) = self.shading(triangle);
        let normals = array3(|k| {
            let normal = pad(local.corner(k, &shading.normals));
            let leans = shading.is_computed && dot(normal, flat.unwrap_or_default()) < FLAT;
            if leans { flat.unwrap_or_default() } else { normal }
        });
        let paint = &shading.paint;
        let number = paint.materials.as_ref().map_or(0, |all| all[local.corners[0] as usize]);
        let picture = paint.pictures.get(number as usize).copied().flatten();
        let color = match (picture.zip(paint.uv.as_ref()), &paint.colors) {
            (Some(((image, wrap), uv)), _) => {
                Color::Texture(image, wrap, array3(|k| local.corner(k, uv)))
            }
            (None, Some(colors)) => Color::Mixed(array3(|k| {
                let [r, g, b] = local.corner(k, colors);
                light::linear([f64::from(r), f64::from(g), f64::from(b)])
            })),
            (None, None) => Color::Clay,
        };
        Facet {
            nears: self.perspective.then(|| {
                pad(array3(|k: usize| {
                    f64::from(self.projected[triangle.vertices[k] as usize].near)
                }))
            }),
            flat,
            normals,
            color,
            back_face: self.back_face,
        }
    }

    /// Returns the mesh that contains a triangle, and the triangle with indices that count within that mesh.
    fn shading(&self, triangle: Triangle) -> (&MeshShading<'a>, Triangle) {
        let after =
            self.shadings.partition_point(|shading| shading.first[0] <= triangle.corners[0]);
        let shading = &self.shadings[after - 1];
        let [corner, vertex] = shading.first;
        let (corners, vertices) = (triangle.corners, triangle.vertices);
        let corners = array3(|k| corners[k] - corner);
        (shading, Triangle { corners, vertices: array3(|k| vertices[k] - vertex) })
    }
}

impl<'a> MeshShading<'a> {
    fn new(mesh: &'a Mesh, first: [u32; 2], camera: &Camera) -> Self {
        let given = match (mesh.corner().vectors("normal"), mesh.vertex().vectors("normal")) {
            (Some(corner), _) => Some(Data::Corner(rotate_normals(camera, corner))),
            (None, Some(vertex)) => Some(Data::Vertex(rotate_normals(camera, vertex))),
            (None, None) => None,
        };
        let is_computed = given.is_none();
        let normals = given.unwrap_or_else(|| {
            let normals = mesh.vertex_normals().into_iter();
            Data::Vertex(normals.map(|normal| rotate_normal(camera, normal)).collect())
        });
        Self { first, normals, is_computed, paint: Paint::new(mesh) }
    }
}

/// Transforms a normal of a mesh to view space.
fn rotate_normal(camera: &Camera, normal: Vector3<f64>) -> [f32; 3] {
    camera.rotate(normal).cast::<f32>().into()
}

/// Transforms normals of a mesh to view space, in parallel.
fn rotate_normals<'a>(camera: &Camera, normals: &[[f64; 3]]) -> Cow<'a, [[f32; 3]]> {
    let normals = normals.par_iter().with_min_len(CHUNK);
    normals.map(|&normal| rotate_normal(camera, normal.into())).collect::<Vec<_>>().into()
}

impl Triangle {
    fn corner<T: Copy>(&self, k: usize, data: &Data<'_, T>) -> T {
        data.get(self.corners[k], self.vertices[k])
    }
}

/// A triangle with the data that is needed to shade it.
pub(super) struct Facet<'a> {
    /// The nearness of each corner of the triangle to the viewer. `None` if the picture has no perspective.
    nears: Option<[f64; 4]>,
    flat: Option<[f32; 4]>,
    /// The normals at the corners of the triangle.
    normals: [[f32; 4]; 3],
    color: Color<'a>,
    back_face: Light,
}

/// The color of a triangle, as data at its corners.
enum Color<'a> {
    Clay,
    Mixed([Light; 3]),
    Texture(&'a Image, [Wrap; 2], [[f64; 2]; 3]),
}

impl Facet<'_> {
    /// Returns the linear light from a point of the triangle. `barycentric` are the barycentric coordinates of the point in the picture.
    #[inline(always)]
    pub(super) fn shade(&self, barycentric: [f64; 4], inner: bool) -> Light {
        let barycentric = self.in_space(barycentric);
        let weights = array3(|k| barycentric[k] as f32);
        let normal =
            unit(mix(weights, &self.normals)).or(self.flat).unwrap_or([0.0, 0.0, 1.0, 0.0]);
        if inner {
            return light::lit(self.back_face, array4(|k| -normal[k]));
        }
        let color = match &self.color {
            Color::Clay => light::CLAY,
            Color::Mixed(colors) => mix(weights, colors),
            Color::Texture(image, wrap, uv) => {
                light::linear(image.sample_beyond(mix_uv(barycentric, uv), *wrap))
            }
        };
        light::lit(color, normal)
    }

    /// Converts barycentric coordinates in the picture to barycentric coordinates in space. The two differ if the picture has perspective.
    #[inline(always)]
    fn in_space(&self, barycentric: [f64; 4]) -> [f64; 4] {
        let Some(nears) = self.nears else { return barycentric };
        let weights = array4(|k| barycentric[k] * nears[k]);
        let sum = weights[0] + weights[1] + weights[2];
        if sum > 0.0 { array4(|k| weights[k] / sum) } else { barycentric }
    }
}

/// Interpolates between vectors at the corners of a triangle, with the given barycentric coordinates.
#[inline(always)]
fn mix([a, b, c]: [f32; 3], corners: &[[f32; 4]; 3]) -> [f32; 4] {
    array4(|k| a * corners[0][k] + b * corners[1][k] + c * corners[2][k])
}

/// Interpolates between texture coordinates at the corners of a triangle, with the given barycentric coordinates.
#[inline(always)]
fn mix_uv(barycentric: [f64; 4], uv: &[[f64; 2]; 3]) -> [f64; 2] {
    [
        barycentric[0] * uv[0][0] + barycentric[1] * uv[1][0] + barycentric[2] * uv[2][0],
        barycentric[0] * uv[0][1] + barycentric[1] * uv[1][1] + barycentric[2] * uv[2][1],
    ]
}

impl<'a> Paint<'a> {
    pub(super) fn new(mesh: &'a Mesh) -> Self {
        let uv = match (mesh.corner().pairs("uv"), mesh.vertex().pairs("uv")) {
            (Some(uv), _) => Some(Data::Corner((&uv[..]).into())),
            (None, uv) => uv.map(|uv| Data::Vertex((&uv[..]).into())),
        };
        let mut pictures: Vec<_> = mesh
            .materials()
            .iter()
            .map(|it| {
                it.non_empty_picture().map(|picture| (picture, it.wrap())).filter(|_| uv.is_some())
            })
            .collect();
        let materials = mesh.face_materials().map(|numbers| {
            let faces = mesh.faces().iter().zip(numbers.iter());
            faces
                .flat_map(|(face, &number): (&[u32], &u32)| {
                    std::iter::repeat_n(mesh.resolve_material(number), face.len())
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

    /// Returns true if the corners at one vertex may differ in color or texture coordinate.
    pub(super) fn is_by_corner(&self) -> bool {
        matches!(self.colors, Some(Data::Corner(_))) || matches!(self.uv, Some(Data::Corner(_)))
    }

    pub(super) fn has_colors(&self) -> bool {
        self.colors.is_some()
    }

    pub(super) fn has_uv(&self) -> bool {
        self.uv.is_some()
    }

    /// Returns the color of a corner, or `None` if the mesh has no colors.
    pub(super) fn color(&self, corner: u32, vertex: u32) -> Option<Rgb> {
        self.colors.as_ref().map(|colors| colors.get(corner, vertex))
    }

    /// Returns the texture coordinate of a corner, or `None` if the mesh has none.
    pub(super) fn uv(&self, corner: u32, vertex: u32) -> Option<[f32; 2]> {
        self.uv.as_ref().map(|uv| uv.get(corner, vertex).map(|x| x as f32))
    }

    /// Returns the runs of consecutive triangles with the same texture. Empty if all triangles have the same texture.
    pub(super) fn material_runs(&self) -> MaterialRuns {
        let Some(numbers) = self.mesh.face_materials().filter(|_| self.uv.is_some()) else {
            return Vec::new();
        };
        let mut runs: MaterialRuns = Vec::new();
        for (face, &number) in self.mesh.faces().iter().zip(numbers.iter()) {
            let number = self.mesh.resolve_material(number) as usize;
            let picture = self.pictures[number].is_some().then_some(number);
            match runs.last_mut() {
                Some((count, last)) if *last == picture => *count += face.len() - 2,
                _ => runs.push((face.len() - 2, picture)),
            }
        }
        runs
    }
}

/// Runs of consecutive triangles: the length of each run, and the index of its material if that has a texture.
pub(super) type MaterialRuns = Vec<(usize, Option<usize>)>;

/// Returns the vertex at each corner of all meshes. If some faces are not triangles, also returns the corners of each triangle.
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

/// Returns the three corners of each triangle of all meshes. The corners of all meshes are numbered in one sequence.
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

/// Appends `more` to `all`. If `all` is empty, nothing is copied.
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
    (length.is_finite() && length > 1e-12).then(|| array4(|k| vector[k] / length))
}
