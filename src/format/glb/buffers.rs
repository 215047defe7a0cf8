//! Writes the binary buffer of a GLB file, and prepares the vertices for it.

use std::mem::discriminant;

use bytemuck::NoUninit;
use maquette_value::parallel::*;
use maquette_value::{Attribute, Column, Mesh, UvTransform, linear_from_srgb};
use nalgebra::{Point3, Vector3};
use serde_json::{Value, json};

use super::{
    ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER, FLOAT, UNSIGNED_BYTE, UNSIGNED_INT, UNSIGNED_SHORT,
    material_writer,
};
use crate::BLOCK;
use crate::corners::{Split, split};
use crate::rows::{Table, floats, indices};

/// The vertices of a glTF mesh: the vertices of `mesh`, duplicated where their corners have different data.
pub(super) struct Vertices<'a> {
    mesh: &'a Mesh,
    split: Option<Split>,
}

impl<'a> Vertices<'a> {
    pub(super) fn new(mesh: &'a Mesh) -> Self {
        // A vertex is split where its corners have different data.
        let of_corners = mesh.corner().iter().filter(|(name, attribute)| {
            let is_known = ["uv", "normal", "color"].contains(name);
            let other = mesh.vertex().get(name);
            !matches!(attribute, Attribute::Flag(_))
                && other
                    .is_none_or(|other| is_known && discriminant(other) != discriminant(attribute))
        });
        let of_corners: Vec<_> = of_corners.map(|(_, attribute)| attribute).collect();
        let is_split = !mesh.faces().is_empty() && !of_corners.is_empty();
        Self {
            mesh,
            split: is_split.then(|| {
                split(mesh, |a, b| of_corners.iter().all(|attribute| attribute.is_same(a, b)))
            }),
        }
    }

    /// Returns all attributes that are written. If a vertex attribute and a corner attribute have the same name, only the vertex attribute
    /// is written.
    pub(super) fn attributes(&self) -> impl Iterator<Item = (&'a str, &'a Attribute)> {
        let mesh = self.mesh;
        let corners = mesh
            .corner()
            .iter()
            .filter(move |(name, _)| self.split.is_some() && mesh.vertex().get(name).is_none());
        let all = mesh.vertex().iter().chain(corners);
        all.filter(|(_, attribute)| !matches!(attribute, Attribute::Flag(_)))
    }

    pub(super) fn pairs_names(&self) -> impl Iterator<Item = &'a str> {
        let pairs = self.attributes().filter(|it| matches!(it.1, Attribute::Pair(_)));
        pairs.map(|(name, _)| name)
    }

    /// Returns the attributes for which glTF defines no name.
    pub(super) fn custom_attributes(&self) -> impl Iterator<Item = (&'a str, &'a Attribute)> {
        let sets = material_writer::coordinate_sets(self);
        self.attributes().filter(move |(name, attribute)| match attribute {
            Attribute::Pair(_) => !sets.iter().any(|set| set == name),
            Attribute::Vector(_) => *name != "normal",
            Attribute::Color(_) => *name != "color",
            _ => true,
        })
    }

    pub(super) fn has_colors(&self) -> bool {
        self.mesh.vertex().colors("color").is_some()
            || self.split.is_some() && self.mesh.corner().colors("color").is_some()
    }

    /// Returns the data of each glTF vertex. They are taken from the vertex of the mesh if `per_vertex` is given, else from the corner.
    fn gather<T: Copy + Send + Sync>(
        &self,
        per_vertex: Option<&Column<T>>,
        per_corner: Option<&Column<T>>,
    ) -> Column<T> {
        let corners = self.mesh.faces().corners();
        match (per_vertex, per_corner, &self.split) {
            (Some(data), _, None) => data.clone(),
            (Some(data), _, Some(split)) => {
                let vertices = split.corners.iter().map(|&corner| corners[corner as usize]);
                vertices.map(|vertex| data[vertex as usize]).collect()
            }
            (None, Some(data), Some(split)) => {
                split.corners.iter().map(|&corner| data[corner as usize]).collect()
            }
            _ => unreachable!("data are asked for only where there are some"),
        }
    }

    /// Returns the data of a custom attribute, which belongs to vertices if `on_vertices` is true, else to corners.
    fn gather_custom<T: Copy + Send + Sync>(
        &self,
        data: &Column<T>,
        on_vertices: bool,
    ) -> Column<T> {
        if on_vertices { self.gather(Some(data), None) } else { self.gather(None, Some(data)) }
    }
}

/// Returns the bounding box of some points. There must be at least one.
fn bounds(points: &[Point3<f64>]) -> (Point3<f64>, Point3<f64>) {
    let blocks: Vec<_> = points
        .par_chunks(BLOCK)
        .map(|points| {
            points[1..]
                .iter()
                .fold((points[0], points[0]), |(low, high), it| (low.inf(it), high.sup(it)))
        })
        .collect();
    type Bounds = (Point3<f64>, Point3<f64>);
    blocks[1..]
        .iter()
        .fold(blocks[0], |all: Bounds, block| (all.0.inf(&block.0), all.1.sup(&block.1)))
}

/// The binary buffer of a GLB file, and the JSON entries that describe it.
#[derive(Default)]
pub(super) struct Buffers<'a> {
    pub(super) tables: Vec<Table<'a>>,
    /// The total length of the tables, in bytes.
    pub(super) length: usize,
    pub(super) views: Vec<Value>,
    pub(super) accessors: Vec<Value>,
}

impl<'a> Buffers<'a> {
    /// Adds a table, aligned to 4 bytes, and a buffer view for it. Returns the index of the view.
    pub(super) fn view(&mut self, table: Table<'a>, target: Option<u32>) -> usize {
        self.align();
        let (offset, length) = (self.length, table.size());
        let mut view = json!({ "buffer": 0, "byteOffset": offset, "byteLength": length });
        if let Some(target) = target {
            view["target"] = target.into();
        }
        self.views.push(view);
        self.add(table);
        self.views.len() - 1
    }

    fn add(&mut self, table: Table<'a>) {
        self.length += table.size();
        self.tables.push(table);
    }

    /// Pads the buffer to a multiple of 4 bytes.
    pub(super) fn align(&mut self) {
        self.add(Table::from_bytes(vec![0; self.length.next_multiple_of(4) - self.length]));
    }

    /// Adds an accessor. Returns its index.
    fn accessor(&mut self, accessor: Value) -> usize {
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    /// Adds a vertex attribute. Returns the index of its accessor.
    fn attribute<T: NoUninit + Send + Sync, B: NoUninit>(
        &mut self,
        name: &'static str,
        items: Column<T>,
        kind: (u32, &str),
        entry: impl Fn(&T) -> B + Send + Sync + 'a,
    ) -> usize {
        let count = items.len();
        let view = self.view(Table::from_column(name, items, entry), Some(ARRAY_BUFFER));
        self.accessor(json!({
            "bufferView": view, "componentType": kind.0, "type": kind.1, "count": count,
        }))
    }

    pub(super) fn positions(&mut self, vertices: &Vertices<'_>) -> usize {
        let points = vertices.gather(Some(vertices.mesh.positions()), None);
        let known = vertices.split.is_none().then(|| vertices.mesh.cached_bounds()).flatten();
        let (low, high) = known.unwrap_or_else(|| bounds(&points));
        let accessor = self
            .attribute("position", points, (FLOAT, "VEC3"), |point| floats(point.coords.into()));
        self.accessors[accessor]["min"] = json!(low.cast::<f32>().coords.as_slice());
        self.accessors[accessor]["max"] = json!(high.cast::<f32>().coords.as_slice());
        accessor
    }

    /// Adds the normals. Returns the index of their accessor, and the normals themselves if they were computed here.
    pub(super) fn normals(&mut self, vertices: &Vertices<'_>) -> (usize, Option<Column<[f32; 3]>>) {
        let mesh = vertices.mesh;
        let per_vertex = mesh.vertex().vectors("normal");
        let per_corner = mesh.corner().vectors("normal").filter(|_| per_vertex.is_none());
        if per_vertex.or(per_corner).is_none() {
            let normals = mesh.cached_normals();
            let all = vertices.gather(Some(&normals), None);
            return (
                self.attribute("seen normal", all, (FLOAT, "VEC3"), |&normal| match normal {
                    // glTF requires unit normals, so a vertex without faces gets an arbitrary one.
                    [0.0, 0.0, 0.0] => [0.0, 0.0, 1.0].map(f32::to_le_bytes),
                    unit => unit.map(f32::to_le_bytes),
                }),
                Some(normals),
            );
        }
        let normals = vertices.gather(per_vertex, per_corner);
        let accessor = self.attribute("normal", normals, (FLOAT, "VEC3"), |&normal| {
            let unit = Vector3::from(normal).try_normalize(0.0).filter(|unit| unit.x.is_finite());
            floats(unit.unwrap_or(Vector3::z()).into())
        });
        (accessor, None)
    }

    /// Adds texture coordinates. They are transformed by the inverse of `by`, the transformation of their picture.
    pub(super) fn uv(&mut self, vertices: &Vertices<'_>, name: &str, by: UvTransform) -> usize {
        let mesh = vertices.mesh;
        let uv = vertices.gather(mesh.vertex().pairs(name), mesh.corner().pairs(name));
        // In glTF, (0, 0) is the upper left corner of the picture.
        if by == UvTransform::default() {
            return self.attribute("uv", uv, (FLOAT, "VEC2"), |&[s, t]| floats([s, 1.0 - t]));
        }
        let undone = uv.iter().map(|&[s, t]| by.apply_inverse([s, 1.0 - t])).collect();
        self.attribute("moved uv", undone, (FLOAT, "VEC2"), |&uv| floats(uv))
    }

    /// Adds colors in linear light with 16 bits per channel; 8 bits would be too coarse for dark colors.
    pub(super) fn colors(&mut self, vertices: &Vertices<'_>) -> usize {
        let mesh = vertices.mesh;
        let colors = vertices.gather(mesh.vertex().colors("color"), mesh.corner().colors("color"));
        let accessor = self.attribute("color", colors, (UNSIGNED_SHORT, "VEC4"), |&color| {
            let [red, green, blue] =
                color.map(|channel| (linear_from_srgb(channel) * 65535.0).round() as u16);
            [red, green, blue, u16::MAX].map(u16::to_le_bytes)
        });
        self.accessors[accessor]["normalized"] = true.into();
        accessor
    }

    /// Adds a custom attribute. Integers that do not fit in 16 bits are converted to single precision, because glTF does not allow larger
    /// integers in vertices.
    pub(super) fn custom_attribute(
        &mut self,
        vertices: &Vertices<'_>,
        name: &str,
        attribute: &Attribute,
    ) -> usize {
        let on_vertices = vertices.mesh.vertex().get(name).is_some();
        match attribute {
            Attribute::Number(data) => {
                let all = vertices.gather_custom(data, on_vertices);
                self.attribute("own number", all, (FLOAT, "SCALAR"), |&x| floats([x]))
            }
            Attribute::Index(data) if data.iter().all(|&x| x <= u16::MAX.into()) => {
                let all = vertices.gather_custom(data, on_vertices);
                // Each integer is followed by two bytes of padding, because rows must be aligned to four bytes.
                let accessor = self.attribute("own index", all, (UNSIGNED_SHORT, "SCALAR"), |&x| {
                    [(x as u16).to_le_bytes(), [0; 2]]
                });
                self.views.last_mut().expect("that of the accessor")["byteStride"] = 4.into();
                accessor
            }
            Attribute::Index(data) => {
                let all = vertices.gather_custom(data, on_vertices);
                self.attribute("own large index", all, (FLOAT, "SCALAR"), |&x| floats([x.into()]))
            }
            Attribute::Pair(data) => {
                let all = vertices.gather_custom(data, on_vertices);
                self.attribute("own pair", all, (FLOAT, "VEC2"), |&pair| floats(pair))
            }
            Attribute::Vector(data) => {
                let all = vertices.gather_custom(data, on_vertices);
                self.attribute("own vector", all, (FLOAT, "VEC3"), |&vector| floats(vector))
            }
            Attribute::Color(data) => {
                let all = vertices.gather_custom(data, on_vertices);
                let accessor = self.attribute(
                    "own color",
                    all,
                    (UNSIGNED_BYTE, "VEC4"),
                    |&[red, green, blue]| [red, green, blue, u8::MAX],
                );
                self.accessors[accessor]["normalized"] = true.into();
                accessor
            }
            Attribute::Flag(_) => unreachable!("flags are not written"),
        }
    }

    /// Adds the triangles; polygons are cut into triangles.
    pub(super) fn triangles(&mut self, vertices: Vertices<'_>) -> usize {
        let faces = vertices.mesh.faces();
        let table = match (vertices.split, faces.sides()) {
            // The corners are written unchanged.
            (None, Some(3)) => {
                Table::from_column("corner", faces.corners().clone(), |&corner| indices([corner]))
            }
            (Some(split), Some(3)) => {
                Table::from_column("corner", split.of_corner.into(), |&corner| indices([corner]))
            }
            (split, _) => {
                let corners = split.as_ref().map_or(&faces.corners()[..], |split| &split.of_corner);
                let triangles = vertices.mesh.triangle_corners().into_par_iter();
                let triangles = triangles.map(|it| it.map(|corner| corners[corner as usize]));
                let triangles: Vec<[u32; 3]> = triangles.collect();
                Table::from_column("triangle", triangles.into(), |&triangle| indices(triangle))
            }
        };
        let count = table.size() / 4;
        let view = self.view(table, Some(ELEMENT_ARRAY_BUFFER));
        self.accessor(json!({
            "bufferView": view, "componentType": UNSIGNED_INT, "type": "SCALAR", "count": count,
        }))
    }
}
