//! The scene of a GLB file put together: its parts moved to their places, vertices joined.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use maquette_value::{Attribute, Column, Image, Mesh, MeshError, Rgb, srgb_from_linear};
use nalgebra::{Matrix3, Matrix4, Point3, Quaternion, UnitQuaternion, Vector3};

use super::accessor::{Buffer, Document, Node};
use super::read::GlbReadError;
use crate::corners::{FaceList, with_corners};
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
    positions: Vec<Point3<f64>>,
    normals: Option<Vec<[f64; 3]>>,
    uv: Option<Vec<[f64; 2]>>,
    colors: Option<Vec<Rgb>>,
    triangles: Vec<[u32; 3]>,
    texture: Option<Image>,
}

impl<'a> Scene<'a> {
    pub(super) fn new(document: &'a Document, buffer: Buffer<'a>) -> Self {
        Self {
            document,
            buffer,
            positions: Vec::new(),
            normals: Some(Vec::new()),
            uv: Some(Vec::new()),
            colors: Some(Vec::new()),
            triangles: Vec::new(),
            texture: None,
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
            if let Some(mesh) = node.mesh {
                self.add_mesh(mesh, &motion)?;
            }
        }
        Ok(())
    }

    fn add_mesh(&mut self, index: usize, motion: &Matrix4<f64>) -> Result<(), GlbReadError> {
        let document = self.document;
        let missing = GlbReadError::Part { part: "mesh", index, what: "does not exist" };
        for primitive in &document.meshes.get(index).ok_or(missing)?.primitives {
            if ![POINTS, TRIANGLES, STRIP, FAN].contains(&primitive.mode) {
                continue;
            }
            let Some(&positions) = primitive.attributes.get("POSITION") else { continue };
            let start = self.positions.len();
            let places = self.buffer.rows::<3>(positions)?;
            let count = places.len();
            let place = |place: [f64; 3]| motion.transform_point(&Point3::from(place));
            self.positions.extend(places.into_iter().map(place));
            self.add_attributes(&primitive.attributes, count, positions, motion)?;
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
            if self.texture.is_none() && primitive.attributes.contains_key("TEXCOORD_0") {
                self.texture = self.read_texture(primitive.material)?;
            }
        }
        Ok(())
    }

    /// Adds what the vertices of a part carry; what it lacks, the whole lacks.
    fn add_attributes(
        &mut self,
        attributes: &BTreeMap<String, usize>,
        count: usize,
        positions: usize,
        motion: &Matrix4<f64>,
    ) -> Result<(), GlbReadError> {
        let attribute = |name| attributes.get(name).copied();
        let check = |found: usize| match found == count {
            true => Ok(()),
            false => {
                let what = "has another number of entries than the positions of its part";
                Err(GlbReadError::Part { part: "accessor", index: positions, what })
            }
        };
        match (&mut self.normals, attribute("NORMAL")) {
            (Some(all), Some(accessor)) => {
                let linear: Matrix3<f64> = motion.fixed_view::<3, 3>(0, 0).into_owned();
                // Cofactors turn normals as the motion turns surfaces, even where it flattens them.
                let side = if linear.determinant() < 0.0 { -1.0 } else { 1.0 };
                let turn = cofactors(&linear) * side;
                let rows = self.buffer.rows::<3>(accessor)?;
                check(rows.len())?;
                let unit = |normal| (turn * Vector3::from(normal)).try_normalize(0.0);
                all.extend(
                    rows.into_iter().map(|row| <[f64; 3]>::from(unit(row).unwrap_or_default())),
                );
            }
            (all, _) => *all = None,
        }
        match (&mut self.uv, attribute("TEXCOORD_0")) {
            (Some(all), Some(accessor)) => {
                let rows = self.buffer.rows::<2>(accessor)?;
                check(rows.len())?;
                // In glTF (0, 0) is the picture's upper left corner.
                all.extend(rows.into_iter().map(|[s, t]| [s, 1.0 - t]));
            }
            (all, _) => *all = None,
        }
        match (&mut self.colors, attribute("COLOR_0")) {
            (Some(all), Some(accessor)) => {
                let rows = self.buffer.rows::<3>(accessor)?;
                check(rows.len())?;
                all.extend(rows.into_iter().map(|color| color.map(srgb_from_linear)));
            }
            (all, _) => *all = None,
        }
        Ok(())
    }

    /// The picture of a material, if it has one in this file.
    fn read_texture(&self, material: Option<usize>) -> Result<Option<Image>, GlbReadError> {
        let document = self.document;
        let material = material.and_then(|material| document.materials.get(material));
        let shading = material.and_then(|material| material.pbr_metallic_roughness.as_ref());
        let texture = shading.and_then(|shading| shading.base_color_texture.as_ref());
        let Some(texture) = texture.filter(|texture| texture.tex_coord == 0) else {
            return Ok(None);
        };
        let source = document.textures.get(texture.index).and_then(|texture| texture.source);
        let image = source.and_then(|source| document.images.get(source));
        let Some(view) = image.and_then(|image| image.buffer_view) else { return Ok(None) };
        Ok(Some(picture_file::read(self.buffer.view(view)?.bytes)?))
    }

    pub(super) fn finish(self) -> Result<Mesh, GlbReadError> {
        if self.positions.is_empty() {
            return Err(GlbReadError::Empty);
        }
        // Points of a cloud that coincide stay apart; corners of triangles do not.
        let (positions, vertices) = match self.triangles.is_empty() {
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
        let (faces, origins) = list.finish()?;
        let corners = self.triangles.as_flattened();
        let mut mesh = Mesh::new(positions, faces)?;
        let textured = self.uv.is_some();
        if let Some(uv) = self.uv {
            mesh = carry(mesh, "uv", uv, &origins, corners, [0.0; 2], Attribute::Pair)?;
        }
        if let Some(normals) = self.normals {
            mesh = carry(mesh, "normal", normals, &origins, corners, [0.0; 3], Attribute::Vector)?;
        }
        if let Some(colors) = self.colors {
            // Colors belong to vertices; where they differ at one the last counts.
            let mut joined = vec![[0; 3]; mesh.positions().len()];
            for (index, color) in (0..).zip(colors) {
                joined[vertex(index) as usize] = color;
            }
            mesh = mesh.with_vertex("color", Attribute::Color(joined.into()))?;
        }
        Ok(mesh.with_texture(self.texture.filter(|_| textured)))
    }
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
