//! The scene of a GLB file put together: its parts moved to their places, vertices joined.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use maquette_value::{
    Attribute, Column, MATERIAL, Mesh, MeshError, Rgb, UvTransform, srgb_from_linear,
};
use nalgebra::{Matrix3, Matrix4, Point3, Quaternion, UnitQuaternion, Vector3};

use super::accessor::{Buffer, Document, Node, Primitive};
use super::material::{Materials, useful, uv_name};
use super::read::{Find, GlbReadError};
use crate::corners::{FaceList, with_corners};
use crate::finite::{self, Finite};

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
    normals: Rows<[f64; 3]>,
    /// White where a part has none.
    colors: Rows<Rgb>,
    /// Texture coordinates: `uv`, `uv1`, ..
    sets: Vec<Rows<[f64; 2]>>,
    own: BTreeMap<String, (OwnKind, Rows<[f64; 3]>)>,
    parts: usize,
    /// Parts that have a picture and no colors, and need none.
    pictured: usize,
    triangles: Vec<[u32; 3]>,
    materials: Materials<'a>,
    /// The number of the material of each triangle.
    of_triangles: Vec<u32>,
    notes: Vec<String>,
}

/// Data of vertices, and how many parts have them; zeros where a part has none.
#[derive(Default)]
struct Rows<T> {
    rows: Vec<T>,
    parts: usize,
}

impl<T: Copy> Rows<T> {
    /// Adds what a part has, if it has any, behind `start` vertices.
    fn add(&mut self, rows: Vec<T>, start: usize, none: T) {
        self.rows.resize(start, none);
        self.rows.extend(rows);
        self.parts += 1;
    }
}

/// What an attribute of vertices is that glTF does not know.
#[derive(Clone, Copy, PartialEq)]
enum OwnKind {
    Number,
    Index,
    Pair,
    Vector,
    Color,
}

impl<'a> Scene<'a> {
    pub(super) fn new(document: &'a Document, buffer: Buffer<'a>, find: Find<'a>) -> Self {
        Self {
            document,
            buffer,
            positions: Vec::new(),
            normals: Rows::default(),
            colors: Rows::default(),
            sets: Vec::new(),
            own: BTreeMap::new(),
            parts: 0,
            pictured: 0,
            triangles: Vec::new(),
            materials: Materials::new(document, find),
            of_triangles: Vec::new(),
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
        let mut open: Vec<_> = roots.into_iter().rev().map(|node| (node, root)).collect();
        while let Some((index, parent)) = open.pop() {
            fn wrong(what: &'static str, index: usize) -> GlbReadError {
                GlbReadError::Part { part: "node", index, what }
            }
            let node = nodes.get(index).ok_or(wrong("does not exist", index))?;
            if std::mem::replace(&mut visited[index], true) {
                return Err(wrong("has two parents", index));
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
            self.positions.extend(
                places
                    .into_iter()
                    .map(|place: [f64; 3]| motion.transform_point(&Point3::from(place))),
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
            self.of_triangles.resize(self.triangles.len(), material);
        }
        Ok(())
    }

    /// Adds what the vertices of a part carry; the number of its material.
    fn add_attributes(
        &mut self,
        primitive: &'a Primitive,
        count: usize,
        positions: usize,
        motion: &Matrix4<f64>,
    ) -> Result<u32, GlbReadError> {
        fn attribute(name: &str, primitive_attributes: &BTreeMap<String, usize>) -> Option<usize> {
            primitive_attributes.get(name).copied()
        }
        fn check(found: usize, positions: usize, count: usize) -> Result<(), GlbReadError> {
            match found == count {
                true => Ok(()),
                false => {
                    let what = "has another number of entries than the positions of its part";
                    Err(GlbReadError::Part { part: "accessor", index: positions, what })
                }
            }
        }
        let start = self.positions.len() - count;
        self.parts += 1;
        if let Some(accessor) = attribute("NORMAL", &primitive.attributes) {
            let linear: Matrix3<f64> = motion.fixed_view::<3, 3>(0, 0).into_owned();
            // Cofactors turn normals as the motion turns surfaces, even where it flattens them.
            let side = if linear.determinant() < 0.0 { -1.0 } else { 1.0 };
            let turn = cofactors(&linear) * side;
            let rows = self.buffer.rows::<3>(accessor)?;
            check(rows.len(), positions, count)?;
            fn unit(normal: [f64; 3], turn: &Matrix3<f64>) -> Option<Vector3<f64>> {
                (*turn * Vector3::from(normal)).try_normalize(0.0)
            }
            self.normals.add(
                rows.into_iter()
                    .map(|row| <[f64; 3]>::from(unit(row, &turn).unwrap_or_default()))
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
            self.materials.look(primitive.material, !coordinates.is_empty(), &self.buffer)?;
        // Those of pictures come first, then those that no picture uses.
        let mut sets = look.sets;
        let others = coordinates.keys().filter(|set| !sets.iter().any(|it| it.0 == **set));
        let others: Vec<_> = others.map(|&set| (set, UvTransform::default())).collect();
        sets.extend(others);
        for (place, (set, transform)) in sets.into_iter().enumerate() {
            let Some(&accessor) = coordinates.get(&set) else { continue };
            let rows = self.buffer.rows::<2>(accessor)?;
            check(rows.len(), positions, count)?;
            // In glTF (0, 0) is the picture's upper left corner.
            if self.sets.len() <= place {
                self.sets.resize_with(place + 1, Rows::default);
            }
            self.sets[place].add(
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
        let by = look.factor;
        let color = |[r, g, b]: [f64; 3]| [r * by[0], g * by[1], b * by[2]].map(srgb_from_linear);
        if let Some(accessor) = attribute("COLOR_0", &primitive.attributes) {
            let rows = self.buffer.rows::<3>(accessor)?;
            check(rows.len(), positions, count)?;
            self.colors.add(rows.into_iter().map(color).collect(), start, [255; 3]);
            let material = &mut self.materials.all[look.material as usize];
            material.has_vertex_colors = material.picture.is_some();
            let is_vec4 = self.buffer.kind(accessor).is_some_and(|(kind, ..)| kind == "VEC4");
            if is_vec4 && self.buffer.rows::<4>(accessor)?.iter().any(|row| row[3] < 1.0) {
                self.note("the opacity of the colors of vertices is left out");
            }
        } else if by != [1.0; 3] {
            self.colors.add(vec![color([1.0; 3]); count], start, [255; 3]);
        } else if self.materials.all[look.material as usize].picture.is_some() {
            self.pictured += 1;
        }
        for (name, &accessor) in &primitive.attributes {
            // Tangents are those of the texture coordinates, and bones are told of.
            let is_read = ["POSITION", "NORMAL", "COLOR_0", "TANGENT"].contains(&&**name);
            if is_read || ["TEXCOORD_", "JOINTS_", "WEIGHTS_"].iter().any(|it| name.starts_with(it))
            {
                continue;
            }
            let kind = name.strip_prefix('_').and_then(|_| self.own_kind(accessor));
            let Some(kind) = kind else {
                self.note(format!("the attribute `{name}` is left out"));
                continue;
            };
            let rows = match kind {
                OwnKind::Number | OwnKind::Index => self.first_components::<1>(accessor)?,
                OwnKind::Pair => self.first_components::<2>(accessor)?,
                OwnKind::Vector | OwnKind::Color => self.first_components::<3>(accessor)?,
            };
            check(rows.len(), positions, count)?;
            let (known, all) = self.own.entry(name.clone()).or_insert((kind, Rows::default()));
            match *known == kind {
                true => all.add(rows, start, [0.0; 3]),
                false => self.note(format!("the attribute `{name}` has several types in several parts, and is left out in some")),
            }
        }
        Ok(look.material)
    }

    /// What an attribute that glTF does not know is, by the type of its entries.
    fn own_kind(&self, accessor: usize) -> Option<OwnKind> {
        Some(match self.buffer.kind(accessor)? {
            ("SCALAR", true, false) => OwnKind::Index,
            ("SCALAR", ..) => OwnKind::Number,
            ("VEC2", ..) => OwnKind::Pair,
            ("VEC3" | "VEC4", true, true) => OwnKind::Color,
            ("VEC3", ..) => OwnKind::Vector,
            _ => return None,
        })
    }

    /// The first components of the entries of an accessor, with zeros behind them.
    fn first_components<const N: usize>(
        &mut self,
        accessor: usize,
    ) -> Result<Vec<[f64; 3]>, GlbReadError> {
        Ok(self
            .buffer
            .rows::<N>(accessor)?
            .into_iter()
            .map(|row: [f64; N]| std::array::from_fn(|k| row.get(k).copied().unwrap_or(0.0)))
            .collect())
    }

    /// The mesh, and what the user should know.
    pub(super) fn finish(mut self) -> Result<(Mesh, Vec<String>), GlbReadError> {
        if self.positions.is_empty() {
            return Err(GlbReadError::Empty);
        }
        let all = self.positions.len();
        self.normals.rows.resize(all, [0.0; 3]);
        self.colors.rows.resize(all, [255; 3]);
        self.sets.iter_mut().for_each(|set| set.rows.resize(all, [0.0; 2]));
        self.own.values_mut().for_each(|(_, own)| own.rows.resize(all, [0.0; 3]));
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
        let own = self.own.iter().map(|(name, (_, own))| (&name[..], own.parts));
        for (name, with) in counts.into_iter().chain(own) {
            let without = self.parts - with;
            if with > 0 && without > 0 {
                let none = if name == "colors" { "is white" } else { "are zeros" };
                self.notes.push(format!(
                    "{without} of {} parts have no {name}: there {none} in place of them",
                    self.parts
                ));
            }
        }
        let finite = Finite::of(&mut self.positions);
        let mend = finite::mend(&mut self.normals.rows, "normal", "vertex", |index| {
            finite.contains(index)
        });
        self.notes.extend(mend);
        for (place, set) in self.sets.iter_mut().enumerate() {
            let name = uv_name(place);
            self.notes.extend(finite::mend(&mut set.rows, &name, "vertex", |index| {
                finite.contains(index)
            }));
        }
        // Triangles with a corner nowhere are left out, and so are such points of a cloud.
        let before = self.triangles.len();
        let is_finite = |corners: &[u32; 3]| corners.iter().all(|&it| finite.contains(it as usize));
        let mut kept = self.triangles.iter().map(is_finite);
        self.of_triangles.retain(|_| kept.next() == Some(true));
        self.triangles.retain(is_finite);
        self.notes.extend(finite::doubt(before - self.triangles.len(), "face"));
        let is_cloud = before == 0;
        if is_cloud {
            self.notes.extend(finite::doubt(finite.n_left_out(), "point"));
            finite.retain(&mut self.positions);
            finite.retain(&mut self.normals.rows);
            finite.retain(&mut self.colors.rows);
            self.sets.iter_mut().for_each(|set| finite.retain(&mut set.rows));
            self.own.values_mut().for_each(|(_, own)| finite.retain(&mut own.rows));
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
        let mut list = FaceList::with_capacity(self.triangles.len());
        let mut of_faces = Vec::with_capacity(self.triangles.len());
        for (triangle, material) in self.triangles.iter().zip(self.of_triangles) {
            let count = list.push(
                &triangle
                    .map(|index: u32| vertices.as_ref().map_or(index, |all| all[index as usize])),
            );
            of_faces.resize(of_faces.len() + count, material);
        }
        self.notes.extend(list.notes());
        let (faces, origins) = list.finish()?;
        let corners = self.triangles.as_flattened();
        let mut mesh = Mesh::new(positions, faces)?;
        let sets = self.sets.into_iter().enumerate();
        for (place, set) in sets.filter(|(_, set)| set.parts > 0) {
            let name = uv_name(place);
            mesh = carry(mesh, &name, set.rows, &origins, corners, [0.0; 2], Attribute::Pair)?;
        }
        if self.normals.parts > 0 {
            let rows = self.normals.rows;
            mesh = carry(mesh, "normal", rows, &origins, corners, [0.0; 3], Attribute::Vector)?;
        }
        if self.colors.parts > 0 {
            let rows = self.colors.rows;
            mesh = carry(mesh, "color", rows, &origins, corners, [0; 3], Attribute::Color)?;
        }
        for (name, (kind, own)) in self.own {
            let plain = name.trim_start_matches('_');
            let is_taken = plain.is_empty()
                || ["position", "normal", "color", "uv", "material"].contains(&plain)
                || mesh.vertex().get(plain).is_some()
                || mesh.corner().get(plain).is_some();
            let name = if is_taken { &name } else { plain };
            mesh = carry(
                mesh,
                name,
                own.rows,
                &origins,
                corners,
                [0.0; 3],
                |rows: Column<[f64; 3]>| kind.attribute(&rows),
            )?;
        }
        let materials = useful(self.materials.all);
        if materials.len() > 1 {
            mesh = mesh.with_face(MATERIAL, Attribute::Index(of_faces.into()))?;
        }
        Ok((mesh.with_materials(materials), self.notes))
    }
}

impl OwnKind {
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
    let of_corners: Vec<_> = origins.iter().map(|&origin| data[corners[origin] as usize]).collect();
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
        fn of(mode: u32, corners: &[u32]) -> Vec<[u32; 3]> {
            triangles(mode, corners).collect()
        }
        assert_eq!(of(STRIP, &corners), [[0, 1, 2], [2, 1, 3]]);
        assert_eq!(of(FAN, &corners), [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(of(POINTS, &corners), [[0; 3]; 0]);
    }
}
