//! Builds a mesh from the scene of a GLB file: applies the transformations of the nodes and merges vertices.

use std::collections::{BTreeMap, BTreeSet};

use maquette_syntax::bail;
use maquette_syntax::error::Error;
use maquette_value::{
    Attribute, Column, DistinctPositions, MATERIAL_ATTRIBUTE, Mesh, MeshError, Rgb, UvTransform,
    srgb_from_linear,
};
use nalgebra::{Matrix3, Matrix4, Point3, Quaternion, UnitQuaternion, Vector3};

use super::accessor::{Buffer, Document, Node, Primitive};
use super::material::{Materials, drop_default, uv_name};
use super::read::{FindFile, extension_error, part_error};
use crate::corners::{FaceList, add_corner_data};
use crate::finite::{self, FiniteMask};

/// Millimeters per meter, the unit of glTF.
const MILLIMETERS: f64 = 1000.0;

// The glTF specification defines the following constants.
const POINTS: u32 = 0;
const TRIANGLES: u32 = 4;
const STRIP: u32 = 5;
const FAN: u32 = 6;

/// Collects the primitives (parts of meshes) in a scene. Corners are indices of glTF vertices until `finish` merges vertices.
pub(super) struct Scene<'a> {
    document: &'a Document,
    buffer: Buffer<'a>,
    positions: Vec<Point3<f64>>,
    normals: Rows<[f64; 3]>,
    /// The vertex colors; white for primitives without colors.
    colors: Rows<Rgb>,
    /// The texture coordinates that become the attributes `uv`, `uv1`, ..
    sets: Vec<Rows<[f64; 2]>>,
    custom: BTreeMap<String, (CustomKind, Rows<[f64; 3]>)>,
    parts: usize,
    /// The number of primitives that have a picture but no vertex colors. They need no vertex colors, because the picture has the colors.
    pictured: usize,
    triangles: Vec<[u32; 3]>,
    materials: Materials<'a>,
    /// For each triangle the index of its material.
    triangle_materials: Vec<u32>,
    notes: Vec<String>,
}

/// Vertex data, and the number of primitives that have such data. Vertices of other primitives have zeros.
#[derive(Default)]
struct Rows<T> {
    rows: Vec<T>,
    parts: usize,
}

impl<T: Copy> Rows<T> {
    /// Adds the data of a primitive whose first vertex has the index `start`. Earlier vertices without data get `none`.
    fn add(&mut self, rows: Vec<T>, start: usize, none: T) {
        self.rows.resize(start, none);
        self.rows.extend(rows);
        self.parts += 1;
    }
}

/// The type of a custom vertex attribute.
#[derive(Clone, Copy, PartialEq)]
enum CustomKind {
    Number,
    Index,
    Pair,
    Vector,
    Color,
}

impl<'a> Scene<'a> {
    pub(super) fn new(document: &'a Document, buffer: Buffer<'a>, find: FindFile<'a>) -> Self {
        Self {
            document,
            buffer,
            positions: Vec::new(),
            normals: Rows::default(),
            colors: Rows::default(),
            sets: Vec::new(),
            custom: BTreeMap::new(),
            parts: 0,
            pictured: 0,
            triangles: Vec::new(),
            materials: Materials::new(document, find),
            triangle_materials: Vec::new(),
            notes: Vec::new(),
        }
    }

    /// Adds a warning unless it has been added before.
    fn note(&mut self, note: impl Into<String>) {
        let note = note.into();
        if !self.notes.contains(&note) {
            self.notes.push(note);
        }
    }

    /// Adds the meshes of all nodes in the scene, parents before children. The nodes must form trees; a node with two parents is an error.
    pub(super) fn collect(&mut self) -> Result<(), Error> {
        let nodes = &self.document.nodes;
        let scene = self.document.scene.unwrap_or(0);
        let roots = match self.document.scenes.get(scene) {
            Some(scene) => scene.nodes.clone(),
            None => {
                let children = nodes.iter().flat_map(|node| &node.children).copied();
                let children: BTreeSet<_> = children.collect();
                (0..nodes.len()).filter(|node| !children.contains(node)).collect()
            }
        };
        let mut is_visited = vec![false; nodes.len()];
        let root = Matrix4::new_scaling(MILLIMETERS);
        let mut open: Vec<_> = roots.into_iter().rev().map(|node| (node, root)).collect();
        while let Some((index, parent)) = open.pop() {
            let node = nodes.get(index);
            let node = node.ok_or_else(|| part_error("node", index, "does not exist"))?;
            if std::mem::replace(&mut is_visited[index], true) {
                return Err(part_error("node", index, "has two parents"));
            }
            let motion = parent * node.motion();
            open.extend(node.children.iter().rev().map(|&child| (child, motion)));
            if node.extensions.contains_key("EXT_mesh_gpu_instancing") {
                self.note(
                    "copies by `EXT_mesh_gpu_instancing` are left out: each mesh is read once",
                );
            }
            if node.skin.is_some() {
                self.note("skins are left out: meshes are read in their rest pose");
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

    fn add_mesh(&mut self, index: usize, motion: &Matrix4<f64>) -> Result<(), Error> {
        let document = self.document;
        let mesh = document.meshes.get(index);
        let mesh = mesh.ok_or_else(|| part_error("mesh", index, "does not exist"))?;
        for primitive in &mesh.primitives {
            if ![POINTS, TRIANGLES, STRIP, FAN].contains(&primitive.mode) {
                self.note("lines are left out");
                continue;
            }
            if let Some(name) =
                primitive.extensions.keys().find(|name| name.contains("compression"))
            {
                return Err(extension_error(name));
            }
            if !primitive.targets.is_empty() {
                self.note("morph targets are left out");
            }
            let Some(&positions) = primitive.attributes.get("POSITION") else { continue };
            let start = self.positions.len();
            let points = self.buffer.rows::<3>(positions)?;
            let count = points.len();
            self.positions.extend(
                points
                    .into_iter()
                    .map(|point: [f64; 3]| motion.transform_point(&Point3::from(point))),
            );
            let material = self.add_attributes(primitive, count, positions, motion)?;
            let corners = match primitive.indices {
                Some(indices) => self.buffer.indices(indices, count)?,
                None => (0..count as u32).collect::<Vec<_>>(),
            };
            let linear = motion.fixed_view::<3, 3>(0, 0).into_owned();
            let mirrored = linear.determinant() < 0.0;
            let triangles = triangles(primitive.mode, &corners).map(|[a, b, c]| {
                let corners = if mirrored { [a, c, b] } else { [a, b, c] };
                corners.map(|corner| corner + start as u32)
            });
            self.triangles.extend(triangles);
            self.triangle_materials.resize(self.triangles.len(), material);
        }
        Ok(())
    }

    /// Adds the vertex attributes of a primitive. Returns the index of the primitive's material.
    fn add_attributes(
        &mut self,
        primitive: &'a Primitive,
        count: usize,
        positions: usize,
        motion: &Matrix4<f64>,
    ) -> Result<u32, Error> {
        fn check_count(found: usize, positions: usize, count: usize) -> Result<(), Error> {
            if found != count {
                bail!(
                    "accessor {positions} has another number of entries than the other attributes of its primitive"
                );
            }
            Ok(())
        }
        let start = self.positions.len() - count;
        self.parts += 1;
        if let Some(accessor) = primitive.attributes.get("NORMAL").copied() {
            let linear: Matrix3<f64> = motion.fixed_view::<3, 3>(0, 0).into_owned();
            // Normals are transformed by the cofactor matrix: it rotates them as the transformation rotates surfaces, even if the
            // transformation is singular.
            let side = if linear.determinant() < 0.0 { -1.0 } else { 1.0 };
            let normal_matrix = cofactors(&linear) * side;
            let rows = self.buffer.rows::<3>(accessor)?;
            check_count(rows.len(), positions, count)?;
            fn unit(normal: [f64; 3], matrix: &Matrix3<f64>) -> Option<Vector3<f64>> {
                (*matrix * Vector3::from(normal)).try_normalize(0.0)
            }
            self.normals.add(
                rows.into_iter()
                    .map(|row| <[f64; 3]>::from(unit(row, &normal_matrix).unwrap_or_default()))
                    .collect(),
                start,
                [0.0; 3],
            );
        }
        let coordinates = primitive.attributes.iter().filter_map(|(name, accessor)| {
            Some((name.strip_prefix("TEXCOORD_")?.parse::<usize>().ok()?, *accessor))
        });
        let coordinates: BTreeMap<usize, usize> = coordinates.collect();
        let look =
            self.materials.appearance(primitive.material, !coordinates.is_empty(), &self.buffer)?;
        // First the sets of texture coordinates that pictures use, then the unused ones.
        let mut sets = look.sets;
        let others = coordinates.keys().filter(|set| !sets.iter().any(|it| it.0 == **set));
        let others: Vec<_> = others.map(|&set| (set, UvTransform::default())).collect();
        sets.extend(others);
        for (set_index, (set, transform)) in sets.into_iter().enumerate() {
            let Some(&accessor) = coordinates.get(&set) else { continue };
            let rows = self.buffer.rows::<2>(accessor)?;
            check_count(rows.len(), positions, count)?;
            // In glTF, (0, 0) is the upper left corner of the picture.
            if self.sets.len() <= set_index {
                self.sets.resize_with(set_index + 1, Rows::default);
            }
            self.sets[set_index].add(
                rows.into_iter()
                    .map(|uv| {
                        let is_moved = transform != UvTransform::default();
                        let [s, t] = if is_moved { transform.apply(uv) } else { uv };
                        [s, 1.0 - t]
                    })
                    .collect(),
                start,
                [0.0; 2],
            );
        }
        let factor = look.factor;
        let color = |[r, g, b]: [f64; 3]| {
            [r * factor[0], g * factor[1], b * factor[2]].map(srgb_from_linear)
        };
        if let Some(accessor) = primitive.attributes.get("COLOR_0").copied() {
            let rows = self.buffer.rows::<3>(accessor)?;
            check_count(rows.len(), positions, count)?;
            self.colors.add(rows.into_iter().map(color).collect(), start, [255; 3]);
            let material = &mut self.materials.all[look.material as usize];
            material.has_vertex_colors = material.picture.is_some();
            let is_vec4 = self.buffer.kind(accessor).is_some_and(|(kind, ..)| kind == "VEC4");
            if is_vec4 && self.buffer.rows::<4>(accessor)?.iter().any(|row| row[3] < 1.0) {
                self.note("the opacity of the colors of vertices is left out");
            }
        } else if factor != [1.0; 3] {
            self.colors.add(vec![color([1.0; 3]); count], start, [255; 3]);
        } else if self.materials.all[look.material as usize].picture.is_some() {
            self.pictured += 1;
        }
        for (name, &accessor) in &primitive.attributes {
            // Tangents are left out without a warning, because they follow from the texture coordinates. For skins there is a separate
            // warning.
            let is_read = ["POSITION", "NORMAL", "COLOR_0", "TANGENT"].contains(&&**name);
            if is_read || ["TEXCOORD_", "JOINTS_", "WEIGHTS_"].iter().any(|it| name.starts_with(it))
            {
                continue;
            }
            let kind = name.strip_prefix('_').and_then(|_| self.custom_kind(accessor));
            let Some(kind) = kind else {
                self.note(format!("the attribute `{name}` is left out"));
                continue;
            };
            let rows = match kind {
                CustomKind::Number | CustomKind::Index => self.first_components::<1>(accessor)?,
                CustomKind::Pair => self.first_components::<2>(accessor)?,
                CustomKind::Vector | CustomKind::Color => self.first_components::<3>(accessor)?,
            };
            check_count(rows.len(), positions, count)?;
            let (known, all) = self.custom.entry(name.clone()).or_insert((kind, Rows::default()));
            match *known == kind {
                true => all.add(rows, start, [0.0; 3]),
                false => self.note(format!("the attribute `{name}` has different types in different primitives, and is left out in some")),
            }
        }
        Ok(look.material)
    }

    /// Returns the type of a custom attribute, which follows from the type of its accessor; `None` if the type is not supported.
    fn custom_kind(&self, accessor: usize) -> Option<CustomKind> {
        Some(match self.buffer.kind(accessor)? {
            ("SCALAR", true, false) => CustomKind::Index,
            ("SCALAR", ..) => CustomKind::Number,
            ("VEC2", ..) => CustomKind::Pair,
            ("VEC3" | "VEC4", true, true) => CustomKind::Color,
            ("VEC3", ..) => CustomKind::Vector,
            _ => return None,
        })
    }

    /// Reads the first N components of an accessor's entries. Entries with fewer components are padded with zeros.
    fn first_components<const N: usize>(
        &mut self,
        accessor: usize,
    ) -> Result<Vec<[f64; 3]>, Error> {
        Ok(self
            .buffer
            .rows::<N>(accessor)?
            .into_iter()
            .map(|row: [f64; N]| std::array::from_fn(|k| row.get(k).copied().unwrap_or(0.0)))
            .collect())
    }

    /// Returns the mesh and the warnings.
    pub(super) fn finish(mut self) -> Result<(Mesh, Vec<String>), Error> {
        if self.positions.is_empty() {
            bail!("the file has no vertices");
        }
        let all = self.positions.len();
        self.normals.rows.resize(all, [0.0; 3]);
        self.colors.rows.resize(all, [255; 3]);
        self.sets.iter_mut().for_each(|set| set.rows.resize(all, [0.0; 2]));
        self.custom.values_mut().for_each(|(_, custom)| custom.rows.resize(all, [0.0; 3]));
        self.notes.append(&mut self.materials.notes);
        let coordinates = self.sets.first().map_or(0, |set| set.parts);
        let colors = match self.colors.parts {
            0 => 0,
            parts => parts + self.pictured,
        };
        let counts = [
            ("normals", self.normals.parts),
            ("texture coordinates", coordinates),
            ("colors", colors),
        ];
        let custom = self.custom.iter().map(|(name, (_, custom))| (&name[..], custom.parts));
        for (name, with) in counts.into_iter().chain(custom) {
            let without = self.parts - with;
            if with > 0 && without > 0 {
                let none = if name == "colors" { "is white" } else { "are zeros" };
                self.notes.push(format!(
                    "{without} of {} parts have no {name}: there {none} in place of them",
                    self.parts
                ));
            }
        }
        let finite = FiniteMask::clear_non_finite(&mut self.positions);
        let mend =
            finite::replace_non_finite(&mut self.normals.rows, "normal", "vertex", |index| {
                finite.contains(index)
            });
        self.notes.extend(mend);
        for (set_index, set) in self.sets.iter_mut().enumerate() {
            let name = uv_name(set_index);
            self.notes.extend(finite::replace_non_finite(
                &mut set.rows,
                &name,
                "vertex",
                |index| finite.contains(index),
            ));
        }
        // Triangles that have a corner with NaN or infinite coordinates are left out. In a point cloud, points with NaN or infinite
        // coordinates are left out.
        let before = self.triangles.len();
        let is_finite: Vec<bool> = self
            .triangles
            .iter()
            .map(|corners| corners.iter().all(|&vertex| finite.contains(vertex as usize)))
            .collect();
        let mut kept = is_finite.iter();
        self.triangle_materials.retain(|_| kept.next() == Some(&true));
        let mut kept = is_finite.iter();
        self.triangles.retain(|_| kept.next() == Some(&true));
        self.notes.extend(finite::left_out_note(before - self.triangles.len(), "face"));
        let is_cloud = before == 0;
        if is_cloud {
            self.notes.extend(finite::left_out_note(finite.n_left_out(), "point"));
            finite.retain(&mut self.positions);
            finite.retain(&mut self.normals.rows);
            finite.retain(&mut self.colors.rows);
            self.sets.iter_mut().for_each(|set| finite.retain(&mut set.rows));
            self.custom.values_mut().for_each(|(_, custom)| finite.retain(&mut custom.rows));
            if self.positions.is_empty() {
                bail!("the file has no vertices");
            }
        }
        // Coincident corners of triangles are merged; coincident points of a point cloud are not.
        let (positions, vertices) = match is_cloud {
            true => (self.positions, None),
            false => {
                let (positions, vertices) = merge_positions(&self.positions);
                (positions, Some(vertices))
            }
        };
        let mut list = FaceList::with_capacity(self.triangles.len());
        let mut face_materials = Vec::with_capacity(self.triangles.len());
        for (triangle, material) in self.triangles.iter().zip(self.triangle_materials) {
            let count = list.push(
                &triangle
                    .map(|index: u32| vertices.as_ref().map_or(index, |all| all[index as usize])),
            );
            face_materials.resize(face_materials.len() + count, material);
        }
        self.notes.extend(list.notes());
        let (faces, origins) = list.finish()?;
        let corners = self.triangles.as_flattened();
        let mut mesh = Mesh::new(positions, faces)?;
        let sets = self.sets.into_iter().enumerate();
        for (set_index, set) in sets.filter(|(_, set)| set.parts > 0) {
            let name = uv_name(set_index);
            mesh = add_data(mesh, &name, set.rows, &origins, corners, [0.0; 2], Attribute::Pair)?;
        }
        if self.normals.parts > 0 {
            let rows = self.normals.rows;
            mesh = add_data(mesh, "normal", rows, &origins, corners, [0.0; 3], Attribute::Vector)?;
        }
        if self.colors.parts > 0 {
            let rows = self.colors.rows;
            mesh = add_data(mesh, "color", rows, &origins, corners, [0; 3], Attribute::Color)?;
        }
        for (name, (kind, custom)) in self.custom {
            let plain = name.trim_start_matches('_');
            let is_taken = plain.is_empty()
                || ["position", "normal", "color", "uv", "material"].contains(&plain)
                || mesh.vertex().get(plain).is_some()
                || mesh.corner().get(plain).is_some();
            let name = if is_taken { &name } else { plain };
            mesh = add_data(
                mesh,
                name,
                custom.rows,
                &origins,
                corners,
                [0.0; 3],
                |rows: Column<[f64; 3]>| kind.attribute(&rows),
            )?;
        }
        let materials = drop_default(self.materials.all);
        if materials.len() > 1 {
            mesh = mesh.with_face(MATERIAL_ATTRIBUTE, Attribute::Index(face_materials.into()))?;
        }
        Ok((mesh.with_materials(materials), self.notes))
    }
}

impl CustomKind {
    fn attribute(self, rows: &[[f64; 3]]) -> Attribute {
        match self {
            Self::Number => Attribute::Number(rows.iter().map(|row| row[0]).collect()),
            Self::Index => Attribute::Index(rows.iter().map(|row| row[0] as u32).collect()),
            Self::Pair => Attribute::Pair(rows.iter().map(|row| [row[0], row[1]]).collect()),
            Self::Vector => Attribute::Vector(rows.iter().copied().collect()),
            Self::Color => Attribute::Color(
                rows.iter()
                    .map(|row| row.map(|x| (x.clamp(0.0, 1.0) * 255.0).round() as u8))
                    .collect(),
            ),
        }
    }
}

/// Adds data of glTF vertices to a mesh: directly for a point cloud, else by the corners of the remaining faces.
fn add_data<T: Copy + PartialEq>(
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
    let of_corners: Vec<_> = origins.iter().map(|&origin| data[corners[origin] as usize]).collect();
    add_corner_data(mesh, name, of_corners, none, attribute)
}

/// Merges vertices with equal positions. Returns the distinct positions in the order of first use, and for each vertex the index of its
/// position.
fn merge_positions(positions: &[Point3<f64>]) -> (Vec<Point3<f64>>, Vec<u32>) {
    let mut distinct = DistinctPositions::with_capacity(positions.len());
    let vertices = positions.iter().map(|&point| distinct.insert(point)).collect();
    (distinct.into_positions(), vertices)
}

/// Returns the corners of the triangles in a primitive. In a strip every second triangle is reversed.
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
    /// Returns the transformation from the node's coordinates to the coordinates of its parent.
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
        fn triangle_list(mode: u32, corners: &[u32]) -> Vec<[u32; 3]> {
            triangles(mode, corners).collect()
        }
        assert_eq!(triangle_list(STRIP, &corners), [[0, 1, 2], [2, 1, 3]]);
        assert_eq!(triangle_list(FAN, &corners), [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(triangle_list(POINTS, &corners), [[0; 3]; 0]);
    }
}
