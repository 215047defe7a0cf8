//! The scene of a GLB file put together: its parts moved to their places, vertices joined.

use std::collections::{BTreeSet, HashMap};

use maquette_value::{
    Attribute, Column, Image, Mesh, MeshError, Rgb, linear_from_srgb, srgb_from_linear,
};
use nalgebra::{Matrix3, Matrix4, Point3, Quaternion, UnitQuaternion, Vector3};

use super::accessor::{Buffer, Document, Node, Primitive, TextureUse, Transform};
use super::read::{Find, GlbReadError, way_out};
use crate::corners::{FaceList, with_corners};
use crate::finite::{self, Finite};
use crate::picture_file;

/// glTF has meters.
const MILLIMETERS: f64 = 1000.0;

// Numbers of the specification.
const POINTS: u32 = 0;
const TRIANGLES: u32 = 4;
const STRIP: u32 = 5;
const FAN: u32 = 6;

/// The parts of a scene as they are put together. Corners name vertices of the file until the end.
pub(super) struct Scene<'a> {
    document: &'a Document,
    buffer: Buffer<'a>,
    find: Find<'a>,
    positions: Vec<Point3<f64>>,
    /// Of each vertex; zeros and white where a part has none.
    normals: Vec<[f64; 3]>,
    uv: Vec<[f64; 2]>,
    colors: Vec<Rgb>,
    /// How many parts have normals, texture coordinates and colors.
    with: [usize; 3],
    parts: usize,
    triangles: Vec<[u32; 3]>,
    /// The picture that is shown, and which it is; none if it cannot be had.
    texture: Option<(Texture, Option<Image>)>,
    notes: Vec<String>,
}

/// A picture on a part: its number, and what it is multiplied with.
type Texture = (usize, [f64; 3]);

/// What a part has its color from.
struct Paint<'a> {
    /// Linear.
    factor: [f64; 3],
    texture: Option<&'a TextureUse>,
}

impl<'a> Scene<'a> {
    pub(super) fn new(document: &'a Document, buffer: Buffer<'a>, find: Find<'a>) -> Self {
        Self {
            document,
            buffer,
            find,
            positions: Vec::new(),
            normals: Vec::new(),
            uv: Vec::new(),
            colors: Vec::new(),
            with: [0; 3],
            parts: 0,
            triangles: Vec::new(),
            texture: None,
            notes: Vec::new(),
        }
    }

    /// Notes once what the user should know.
    fn note(&mut self, note: impl Into<String>) {
        let note = note.into();
        if !self.notes.contains(&note) {
            self.notes.push(note);
        }
    }

    /// Visits the nodes of the scene, parents first. The specification wants trees: no node has two parents.
    pub(super) fn collect(&mut self) -> Result<(), GlbReadError> {
        let nodes = &self.document.nodes;
        let scene = self.document.scene.unwrap_or(0);
        let roots = match self.document.scenes.get(scene) {
            Some(scene) => scene.nodes.clone(),
            None => {
                let children = nodes.iter().flat_map(|node| &node.children).copied();
                let children = BTreeSet::from_iter(children);
                (0..nodes.len()).filter(|node| !children.contains(node)).collect()
            }
        };
        let mut visited = vec![false; nodes.len()];
        let root = Matrix4::new_scaling(MILLIMETERS);
        let mut open = Vec::from_iter(roots.into_iter().rev().map(|node| (node, root)));
        while let Some((index, parent)) = open.pop() {
            let wrong = |what| GlbReadError::Part { part: "node", index, what };
            let node = nodes.get(index).ok_or(wrong("does not exist"))?;
            if std::mem::replace(&mut visited[index], true) {
                return Err(wrong("has two parents"));
            }
            let motion = parent * node.motion();
            open.extend(node.children.iter().rev().map(|&child| (child, motion)));
            if node.extensions.contains_key("EXT_mesh_gpu_instancing") {
                self.note(
                    "copies by `EXT_mesh_gpu_instancing` are left out: each mesh is read once",
                );
            }
            if node.skin.is_some() {
                self.note("skins are left out: meshes are read as they are without bones");
            }
            if let Some(mesh) = node.mesh {
                self.add_mesh(mesh, &motion)?;
            }
        }
        if !self.document.animations.is_empty() {
            self.note("animations are left out");
        }
        Ok(())
    }

    fn add_mesh(&mut self, index: usize, motion: &Matrix4<f64>) -> Result<(), GlbReadError> {
        let document = self.document;
        let missing = GlbReadError::Part { part: "mesh", index, what: "does not exist" };
        for primitive in &document.meshes.get(index).ok_or(missing)?.primitives {
            if ![POINTS, TRIANGLES, STRIP, FAN].contains(&primitive.mode) {
                self.note("lines are left out");
                continue;
            }
            if let Some(name) =
                primitive.extensions.keys().find(|name| name.contains("compression"))
            {
                return Err(GlbReadError::Extension { name: name.clone() });
            }
            if !primitive.targets.is_empty() {
                self.note("morph targets are left out");
            }
            let Some(&positions) = primitive.attributes.get("POSITION") else { continue };
            let start = self.positions.len();
            let places = self.buffer.rows::<3>(positions)?;
            let count = places.len();
            let place = |place: [f64; 3]| motion.transform_point(&Point3::from(place));
            self.positions.extend(places.into_iter().map(place));
            self.add_attributes(primitive, count, positions, motion)?;
            let corners = match primitive.indices {
                Some(indices) => self.buffer.indices(indices, count)?,
                None => Vec::from_iter(0..count as u32),
            };
            let linear = motion.fixed_view::<3, 3>(0, 0).into_owned();
            let mirrored = linear.determinant() < 0.0;
            let triangles = triangles(primitive.mode, &corners).map(|[a, b, c]| {
                let corners = if mirrored { [a, c, b] } else { [a, b, c] };
                corners.map(|corner| corner + start as u32)
            });
            self.triangles.extend(triangles);
        }
        Ok(())
    }

    /// Adds what the vertices of a part carry.
    fn add_attributes(
        &mut self,
        primitive: &'a Primitive,
        count: usize,
        positions: usize,
        motion: &Matrix4<f64>,
    ) -> Result<(), GlbReadError> {
        let attribute = |name: &str| primitive.attributes.get(name).copied();
        let check = |found: usize| match found == count {
            true => Ok(()),
            false => {
                let what = "has another number of entries than the positions of its part";
                Err(GlbReadError::Part { part: "accessor", index: positions, what })
            }
        };
        let all = self.positions.len();
        self.parts += 1;
        if let Some(accessor) = attribute("NORMAL") {
            let linear: Matrix3<f64> = motion.fixed_view::<3, 3>(0, 0).into_owned();
            // Cofactors turn normals as the motion turns surfaces, even where it flattens them.
            let side = if linear.determinant() < 0.0 { -1.0 } else { 1.0 };
            let turn = cofactors(&linear) * side;
            let rows = self.buffer.rows::<3>(accessor)?;
            check(rows.len())?;
            let unit = |normal| (turn * Vector3::from(normal)).try_normalize(0.0);
            let unit = |row| <[f64; 3]>::from(unit(row).unwrap_or_default());
            self.normals.extend(rows.into_iter().map(unit));
            self.with[0] += 1;
        }
        self.normals.resize(all, [0.0; 3]);
        let paint = self.paint(primitive.material);
        let transform = paint.texture.and_then(|texture| texture.extensions.transform);
        let set = paint.texture.map_or(0, |texture| texture.tex_coord);
        let set = transform.and_then(|transform| transform.tex_coord).unwrap_or(set);
        let set = format!("TEXCOORD_{set}");
        let uv = attribute(&set);
        if let Some(accessor) = uv {
            let rows = self.buffer.rows::<2>(accessor)?;
            check(rows.len())?;
            let transform = transform.unwrap_or_default();
            // In glTF (0, 0) is the picture's upper left corner.
            let place = |uv| {
                let [s, t] =
                    if transform == Transform::default() { uv } else { transform.apply(uv) };
                [s, 1.0 - t]
            };
            self.uv.extend(rows.into_iter().map(place));
            self.with[1] += 1;
        }
        self.uv.resize(all, [0.0; 2]);
        let texture = self.read_texture(paint.texture.filter(|_| uv.is_some()), paint.factor)?;
        let has_factor = paint.factor != [1.0; 3] && !texture;
        let by = if texture { [1.0; 3] } else { paint.factor };
        let color = |[r, g, b]: [f64; 3]| [r * by[0], g * by[1], b * by[2]].map(srgb_from_linear);
        if let Some(accessor) = attribute("COLOR_0") {
            let rows = self.buffer.rows::<3>(accessor)?;
            check(rows.len())?;
            self.colors.extend(rows.into_iter().map(color));
        }
        self.with[2] += usize::from(has_factor || attribute("COLOR_0").is_some());
        self.colors.resize(all, color([1.0; 3]));
        for name in primitive.attributes.keys() {
            // Tangents are those of the texture coordinates, and bones are told of.
            let is_read = ["POSITION", "NORMAL", "COLOR_0", "TANGENT", &set].contains(&&**name);
            if !is_read && !name.starts_with("JOINTS_") && !name.starts_with("WEIGHTS_") {
                self.note(format!("the attribute `{name}` is left out"));
            }
        }
        Ok(())
    }

    /// What a part of this material has its color from; what else the material has is noted.
    fn paint(&mut self, material: Option<usize>) -> Paint<'a> {
        let document = self.document;
        let Some(material) = material.and_then(|material| document.materials.get(material)) else {
            return Paint { factor: [1.0; 3], texture: None };
        };
        let shading = &material.pbr_metallic_roughness;
        let maps = [
            ("normals", &material.normal_texture),
            ("metal and roughness", &shading.metallic_roughness_texture),
            ("occlusion", &material.occlusion_texture),
            ("emission", &material.emissive_texture),
        ];
        for (what, map) in maps {
            if map.is_some() {
                self.note(format!(
                    "the picture of {what} is left out: a mesh has one picture, of its color"
                ));
            }
        }
        for (name, extension) in &material.extensions.others {
            let is_picture = |(key, _): (&String, _)| key.ends_with("Texture");
            if extension.as_object().is_some_and(|extension| extension.iter().any(is_picture)) {
                self.note(format!(
                    "pictures of `{name}` are left out: a mesh has one picture, of its color"
                ));
            }
        }
        let (mut factor, mut texture) =
            (shading.base_color_factor, shading.base_color_texture.as_ref());
        if let Some(glossiness) = &material.extensions.glossiness
            && factor.is_none()
            && texture.is_none()
        {
            (factor, texture) = (glossiness.diffuse_factor, glossiness.diffuse_texture.as_ref());
        }
        let [red, green, blue, _] = factor.unwrap_or([1.0; 4]);
        Paint { factor: [red, green, blue], texture }
    }

    /// Takes the picture of a part as that of the mesh, if no other is; whether the part has one.
    fn read_texture(
        &mut self,
        texture: Option<&TextureUse>,
        factor: [f64; 3],
    ) -> Result<bool, GlbReadError> {
        let document = self.document;
        let Some(texture) = texture else { return Ok(false) };
        let Some(found) = document.textures.get(texture.index) else { return Ok(false) };
        let Some(source) = found.picture() else {
            if let Some(name) = found.unread() {
                self.note(format!("a picture is left out, which needs `{name}`{}", way_out(name)));
            }
            return Ok(false);
        };
        let wanted = (source, factor);
        if let Some((shown, _)) = &self.texture {
            if *shown != wanted {
                self.note("the mesh has several pictures, but shows the first, also where another one belongs");
            }
            return Ok(true);
        }
        let Some(image) = document.images.get(source) else { return Ok(false) };
        let image = match (image.buffer_view, &image.uri) {
            (Some(view), _) => Some(picture_file::read(self.buffer.view(view)?.bytes)?),
            (None, Some(uri)) => {
                let read =
                    |bytes: Vec<u8>| picture_file::read(&bytes).map_err(|error| error.to_string());
                let image = (self.find)(uri).and_then(read);
                image.map_err(|why| self.note(format!("picture {source} is left out: {why}"))).ok()
            }
            (None, None) => None,
        };
        let image =
            image.map(|image| if factor == [1.0; 3] { image } else { multiplied(&image, factor) });
        self.texture = Some((wanted, image));
        Ok(true)
    }

    /// The mesh, and what the user should know.
    pub(super) fn finish(mut self) -> Result<(Mesh, Vec<String>), GlbReadError> {
        if self.positions.is_empty() {
            return Err(GlbReadError::Empty);
        }
        let names = ["normals", "texture coordinates", "colors"];
        for (name, with) in names.into_iter().zip(self.with) {
            let without = self.parts - with;
            if with > 0 && without > 0 {
                let none = if name == "colors" { "is white" } else { "are zeros" };
                self.note(format!(
                    "{without} of {} parts have no {name}: there {none} in place of them",
                    self.parts
                ));
            }
        }
        let [has_normals, has_uv, has_colors] = self.with.map(|with| with > 0);
        let finite = Finite::of(&mut self.positions);
        let mend =
            finite::mend(&mut self.normals, "normal", "vertex", |index| finite.contains(index));
        let uv = finite::mend(&mut self.uv, "uv", "vertex", |index| finite.contains(index));
        self.notes.extend(mend.into_iter().chain(uv));
        // Triangles with a corner nowhere are left out, and so are such points of a cloud.
        let before = self.triangles.len();
        self.triangles
            .retain(|corners| corners.iter().all(|&corner| finite.contains(corner as usize)));
        self.notes.extend(finite::doubt(before - self.triangles.len(), "face"));
        let is_cloud = before == 0;
        if is_cloud {
            self.notes.extend(finite::doubt(finite.n_left_out(), "point"));
            finite.retain(&mut self.positions);
            finite.retain(&mut self.normals);
            finite.retain(&mut self.uv);
            finite.retain(&mut self.colors);
            if self.positions.is_empty() {
                return Err(GlbReadError::Empty);
            }
        }
        // Points of a cloud that coincide stay apart; corners of triangles do not.
        let (positions, vertices) = match is_cloud {
            true => (self.positions, None),
            false => {
                let (positions, vertices) = join(&self.positions);
                (positions, Some(vertices))
            }
        };
        let vertex = |index: u32| vertices.as_ref().map_or(index, |all| all[index as usize]);
        let mut list = FaceList::with_capacity(self.triangles.len());
        for triangle in &self.triangles {
            list.push(&triangle.map(vertex));
        }
        self.notes.extend(list.notes());
        let (faces, origins) = list.finish()?;
        let corners = self.triangles.as_flattened();
        let mut mesh = Mesh::new(positions, faces)?;
        if has_uv {
            mesh = carry(mesh, "uv", self.uv, &origins, corners, [0.0; 2], Attribute::Pair)?;
        }
        if has_normals {
            mesh = carry(
                mesh,
                "normal",
                self.normals,
                &origins,
                corners,
                [0.0; 3],
                Attribute::Vector,
            )?;
        }
        if has_colors {
            mesh = carry(mesh, "color", self.colors, &origins, corners, [0; 3], Attribute::Color)?;
        }
        let texture = self.texture.and_then(|(_, image)| image);
        Ok((mesh.with_texture(texture.filter(|_| has_uv)), self.notes))
    }
}

/// A picture whose colors are multiplied with a linear one.
fn multiplied(image: &Image, factor: [f64; 3]) -> Image {
    let table = factor.map(|factor| {
        Vec::from_iter(
            (0..=255).map(|level| srgb_from_linear(f64::from(linear_from_srgb(level)) * factor)),
        )
    });
    let color = |color: &Rgb| [0, 1, 2].map(|k| table[k][usize::from(color[k])]);
    let pixels = Vec::from_iter(image.pixels().iter().map(color));
    Image::new(image.width(), image.height(), pixels).expect("a picture of the same size")
}

/// Adds data of the file's vertices to a mesh: as they are for a cloud, else by way of the corners that were kept.
fn carry<T: Copy + PartialEq>(
    mesh: Mesh,
    name: &str,
    data: Vec<T>,
    origins: &[usize],
    corners: &[u32],
    none: T,
    attribute: impl Fn(Column<T>) -> Attribute,
) -> Result<Mesh, MeshError> {
    if corners.is_empty() {
        return mesh.with_vertex(name, attribute(data.into()));
    }
    let corner = |&origin: &usize| data[corners[origin] as usize];
    let of_corners = Vec::from_iter(origins.iter().map(corner));
    with_corners(mesh, name, of_corners, none, attribute)
}

/// The different places in the order in which they are first met, and the place of each vertex.
fn join(positions: &[Point3<f64>]) -> (Vec<Point3<f64>>, Vec<u32>) {
    let mut places = Vec::with_capacity(positions.len());
    let mut known = HashMap::with_capacity(positions.len());
    let vertices = positions.iter().map(|point| {
        let bits = [point.x, point.y, point.z].map(f64::to_bits);
        *known.entry(bits).or_insert_with(|| {
            places.push(*point);
            (places.len() - 1) as u32
        })
    });
    let vertices = vertices.collect();
    (places, vertices)
}

/// The corners of the triangles of a part. Every other triangle of a strip is turned round.
fn triangles(mode: u32, corners: &[u32]) -> impl Iterator<Item = [u32; 3]> {
    let count = match mode {
        TRIANGLES => corners.len() / 3,
        STRIP | FAN => corners.len().saturating_sub(2),
        _ => 0,
    };
    (0..count).map(move |k| match mode {
        TRIANGLES => [corners[3 * k], corners[3 * k + 1], corners[3 * k + 2]],
        FAN => [corners[0], corners[k + 1], corners[k + 2]],
        _ if k % 2 == 0 => [corners[k], corners[k + 1], corners[k + 2]],
        _ => [corners[k + 1], corners[k], corners[k + 2]],
    })
}

fn cofactors(matrix: &Matrix3<f64>) -> Matrix3<f64> {
    let [x, y, z] = [0, 1, 2].map(|k| matrix.column(k).into_owned());
    Matrix3::from_columns(&[y.cross(&z), z.cross(&x), x.cross(&y)])
}

impl Node {
    /// From the node's own frame to its parent's.
    fn motion(&self) -> Matrix4<f64> {
        if let Some(matrix) = &self.matrix {
            return Matrix4::from_column_slice(matrix);
        }
        let [x, y, z, w] = self.rotation;
        let rotation = UnitQuaternion::try_new(Quaternion::new(w, x, y, z), 0.0);
        let rotation = rotation.unwrap_or_default().to_homogeneous();
        Matrix4::new_translation(&self.translation.into())
            * rotation
            * Matrix4::new_nonuniform_scaling(&self.scale.into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strips_and_fans_are_triangles() {
        let corners = [0, 1, 2, 3];
        let of = |mode| triangles(mode, &corners).collect::<Vec<_>>();
        assert_eq!(of(STRIP), [[0, 1, 2], [2, 1, 3]]);
        assert_eq!(of(FAN), [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(of(POINTS), [[0; 3]; 0]);
    }
}
