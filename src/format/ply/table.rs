//! Tables of the scalar properties of PLY elements, and the mesh that is built from the tables of vertices and faces.

use std::borrow::Cow;

use maquette_syntax::error::Error;
use maquette_value::{Attribute, Mesh, Rgb};
use nalgebra::Point3;

use super::body::{Body, Rows};
use super::faces::FaceTable;
use super::header::{Element, Header, Kind, Property, Scalar};
use crate::colors::{self, ColorRange};
use crate::corners::add_corner_data;
use crate::finite::{self, FiniteMask};

/// The possible names of the three color channels, in lower or upper case.
const COLORS: [[&str; 3]; 3] =
    [["red", "green", "blue"], ["diffuse_red", "diffuse_green", "diffuse_blue"], ["r", "g", "b"]];

/// The scalar properties of an element, stored row by row.
pub(super) struct Table<'a> {
    pub(super) columns: Vec<Column>,
    pub(super) rows: Rows<'a>,
    /// The range of color channels, if the user has set it.
    pub(super) color_range: Option<ColorRange>,
}

/// A property in a table: its declaration in the file, and its offset and storage type in the table.
pub(super) struct Column {
    pub(super) property: Property,
    pub(super) offset: usize,
    pub(super) stored: Scalar,
}

impl<'a> Table<'a> {
    /// Reads the rows of an element. Binary rows of equal length are used unchanged; all others are converted to doubles.
    pub(super) fn read(element: &Element, body: &mut Body<'a>) -> Result<Self, Error> {
        let properties = element.properties.iter();
        let scalars = properties.clone().filter(|property| property.length.is_none());
        let raw = if scalars.clone().count() == element.properties.len() {
            body.take_rows(element)?
        } else {
            None
        };
        let mut stride = 0;
        let columns = scalars.map(|property| {
            let stored = if raw.is_some() { property.scalar } else { Scalar::F64 };
            let offset = stride;
            stride += stored.size();
            Column { property: property.clone(), offset, stored }
        });
        let columns: Vec<_> = columns.collect();
        let (bytes, big_endian) = match raw {
            Some((bytes, big_endian)) => (Cow::Borrowed(bytes), big_endian),
            None => (Cow::Owned(read_numbers(element, body, stride)?), false),
        };
        let count = if columns.is_empty() { 0 } else { element.count };
        let rows = Rows { bytes, stride, count, big_endian };
        Ok(Self { columns, rows, color_range: None })
    }

    /// Removes and returns the columns with these names. If one of them is missing, removes nothing and returns `None`.
    pub(super) fn take<const N: usize>(&mut self, names: [&str; N]) -> Option<[Column; N]> {
        self.take_if(names, |column, name| column.property.name == name)
    }

    /// Removes and returns, for each name, the first column that matches the name. If a name has no match, removes nothing and returns
    /// `None`.
    pub(super) fn take_if<const N: usize>(
        &mut self,
        names: [&str; N],
        is: impl Fn(&Column, &str) -> bool,
    ) -> Option<[Column; N]> {
        names.iter().all(|name| self.columns.iter().any(|column| is(column, name))).then(|| {
            names.map(|name| {
                let index = self.columns.iter().position(|column| is(column, name));
                self.columns.remove(index.expect("it was found before"))
            })
        })
    }

    /// Removes and returns the columns of colors, if they have known names.
    pub(super) fn take_colors(&mut self, notes: &mut Vec<String>) -> Option<Vec<Rgb>> {
        let columns = COLORS.into_iter().find_map(|names| {
            // Floating-point properties with such short names may have any meaning, so only integers count as colors.
            let is_short = names[0].len() == 1;
            self.take_if(names, |Column { property, .. }, name| {
                property.name.eq_ignore_ascii_case(name)
                    && !(is_short && property.scalar.is_float())
            })
        })?;
        Some(self.colors(&columns, notes))
    }

    /// Reads the colors in three columns.
    fn colors(&self, columns: &[Column; 3], notes: &mut Vec<String>) -> Vec<Rgb> {
        let usual = match columns[0].property.scalar {
            Scalar::U8 => {
                return self.rows.gather(columns, |color| color.map(|channel| channel as u8));
            }
            Scalar::F32 | Scalar::F64 => ColorRange::To1,
            Scalar::U16 => ColorRange::To65535,
            _ => ColorRange::To255,
        };
        let colors = self.rows.gather(columns, |color| color);
        let (all, are_whole) = (colors.iter().flatten().copied(), usual != ColorRange::To1);
        let range = colors::decide(self.color_range, all, are_whole, usual, notes);
        colors
            .into_iter()
            .map(|color: [f64; 3]| color.map(|channel| colors::byte(range, channel)))
            .collect()
    }

    /// Removes and returns an attribute that this crate has declared in a comment.
    fn take_attribute(
        &mut self,
        kind: Kind,
        name: &str,
        notes: &mut Vec<String>,
    ) -> Option<Attribute> {
        let suffixes = kind.suffixes().iter();
        let names: Vec<_> = suffixes.map(|suffix| format!("{name}{suffix}")).collect();
        let names: Vec<_> = names.iter().map(|name| &**name).collect();
        Some(match (kind, &names[..]) {
            (Kind::Flag, &[flag]) => {
                let columns = self.take([flag])?;
                Attribute::Flag(self.rows.gather(&columns, |[flag]| u8::from(flag != 0.0)).into())
            }
            (Kind::Pair, &[first, second]) => {
                let columns = self.take([first, second])?;
                Attribute::Pair(self.rows.gather(&columns, |pair| pair).into())
            }
            (Kind::Vector, &[x, y, z]) => {
                let columns = self.take([x, y, z])?;
                Attribute::Vector(self.rows.gather(&columns, |vector| vector).into())
            }
            (_, &[red, green, blue]) => {
                let columns = self.take([red, green, blue])?;
                Attribute::Color(self.colors(&columns, notes).into())
            }
            _ => return None,
        })
    }

    pub(super) fn into_mesh(
        mut self,
        header: &Header,
        faces: FaceTable,
        notes: &mut Vec<String>,
    ) -> Result<(Mesh, FiniteMask), Error> {
        let columns = self.take(["x", "y", "z"]).ok_or_else(super::no_vertices)?;
        let mut positions = self.rows.gather(&columns, Point3::from);
        let finite = FiniteMask::clear_non_finite(&mut positions);
        let (uv, faces_table) = (faces.uv, faces.scalars);
        let (faces, origins) = match faces.triangles {
            Some(triangles) => (triangles, Vec::new()),
            None => faces.list.finish()?,
        };
        let mut mesh = Mesh::new(positions, faces)?;
        if let Some(normals) = self.take(["nx", "ny", "nz"]) {
            let mut normals = self.rows.gather(&normals, |normal| normal);
            notes.extend(finite::replace_non_finite(&mut normals, "normal", "vertex", |index| {
                finite.contains(index)
            }));
            mesh = mesh.with_vertex("normal", Attribute::Vector(normals.into()))?;
        }
        let pairs = [["s", "t"], ["u", "v"], ["texture_u", "texture_v"]];
        if let Some(uv) = pairs.into_iter().find_map(|names| self.take(names)) {
            let mut uv = self.rows.gather(&uv, |uv| uv);
            notes.extend(finite::replace_non_finite(&mut uv, "uv", "vertex", |index| {
                finite.contains(index)
            }));
            mesh = mesh.with_vertex("uv", Attribute::Pair(uv.into()))?;
        } else if let Some(uv) = uv {
            let mut corners: Vec<_> = origins.into_iter().map(|origin| uv[origin]).collect();
            notes.extend(finite::replace_non_finite(&mut corners, "uv", "corner", |_| true));
            mesh = add_corner_data(mesh, "uv", corners, [0.0; 2], Attribute::Pair)?;
        }
        for (name, attribute) in self.take_attributes(&header.attributes, "vertices", notes) {
            mesh = mesh.with_vertex(&name, attribute)?;
        }
        let known = &header.face_attributes;
        let of_faces = faces_table.map(|table| table.take_attributes(known, "faces", notes));
        for (name, attribute) in of_faces.unwrap_or_default() {
            mesh = mesh.with_face(&name, attribute)?;
        }
        Ok((mesh, finite))
    }

    /// Removes and returns all remaining attributes: colors, attributes that comments declare, and single columns, which keep their names.
    fn take_attributes(
        mut self,
        known: &[(Kind, String)],
        elements: &str,
        notes: &mut Vec<String>,
    ) -> Vec<(String, Attribute)> {
        let mut found = Vec::new();
        if let Some(colors) = self.take_colors(notes) {
            found.push(("color".to_owned(), Attribute::Color(colors.into())));
        }
        for (kind, name) in known {
            found.extend(self.take_attribute(*kind, name, notes).map(|it| (name.clone(), it)));
        }
        for column in std::mem::take(&mut self.columns) {
            let (property, column) = (column.property.clone(), [column]);
            let attribute = match property.scalar {
                Scalar::U8 if property.name == "filled" => Attribute::Flag(
                    self.rows.gather(&column, |[flag]| u8::from(flag != 0.0)).into(),
                ),
                Scalar::U32 => {
                    Attribute::Index(self.rows.gather(&column, |[index]| index as u32).into())
                }
                Scalar::F32 | Scalar::F64 => {
                    Attribute::Number(self.rows.gather(&column, |[number]| number).into())
                }
                _ if property.name == "alpha" => {
                    let alpha = self.rows.gather(&column, |[alpha]| alpha);
                    let first = alpha.first().copied().unwrap_or(255.0);
                    let is_opaque = [255.0, 65535.0].contains(&first);
                    if !is_opaque || alpha.iter().any(|alpha| *alpha != first) {
                        notes.push(format!("`alpha` of {elements} is left out: colors are opaque"));
                    }
                    continue;
                }
                Scalar::I8 | Scalar::U8 | Scalar::I16 | Scalar::U16 | Scalar::I32 => {
                    let numbers = self.rows.gather(&column, |[number]| number);
                    match numbers.iter().all(|number| *number >= 0.0) {
                        true => Attribute::Index(numbers.into_iter().map(|x| x as u32).collect()),
                        false => Attribute::Number(numbers.into()),
                    }
                }
            };
            found.push((property.name, attribute));
        }
        found
    }
}

/// Reads all scalar properties of an element, row by row, as little-endian doubles.
fn read_numbers(element: &Element, body: &mut Body<'_>, stride: usize) -> Result<Vec<u8>, Error> {
    // Do not loop over rows without properties: they take no bytes, so a small file may state any number of them.
    if element.properties.is_empty() {
        return Ok(Vec::new());
    }
    let mut bytes = Vec::with_capacity(stride * element.count);
    for _ in 0..element.count {
        for property in &element.properties {
            match property.length {
                Some(length) => body.skip_list(length, property.scalar)?,
                None => bytes.extend(body.number(property.scalar)?.to_le_bytes()),
            }
        }
        body.end_row(element)?;
    }
    Ok(bytes)
}
