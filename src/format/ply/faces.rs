//! Reads the faces of a PLY file.

use std::borrow::Cow;

use maquette_syntax::bail;
use maquette_syntax::error::Error;
use maquette_value::Faces;

use super::body::{Body, Rows};
use super::header::{CORNER_UV, Element, Property, Scalar, TEXCOORD};
use super::table::{Column, Table};
use crate::corners::FaceList;

/// The corners of all faces, with their texture coordinates.
#[derive(Default)]
pub(super) struct FaceTable {
    /// All faces, if the file has a binary table of triangles without repeated corners and without other properties.
    pub(super) triangles: Option<Faces>,
    /// All faces, if the file has another form.
    pub(super) list: FaceList,
    pub(super) uv: Option<Vec<[f64; 2]>>,
    /// The scalar properties of the faces in `list`.
    pub(super) scalars: Option<Table<'static>>,
}

impl FaceTable {
    /// Reads the faces. They can be stored in [`triangles`](Self::triangles) only if no other faces follow (`alone` is true).
    pub(super) fn read(
        element: &Element,
        body: &mut Body<'_>,
        alone: bool,
        notes: &mut Vec<String>,
    ) -> Result<Self, Error> {
        let corner_list = corner_list(element, notes);
        if alone
            && corner_list == Some(0)
            && let Some(triangles) = body.take_triangles(element)
        {
            return Ok(Self { triangles: Some(triangles), ..Self::default() });
        }
        let list = FaceList::with_capacity(body.room_for_faces(element));
        let mut table = Self { triangles: None, list, uv: Some(Vec::new()), scalars: None };
        let (mut corners, mut uv) = (Vec::new(), Vec::new());
        let (mut numbers, mut count) = (Vec::new(), 0);
        for _ in 0..element.count {
            corners.clear();
            uv.clear();
            let before = numbers.len();
            for (index, Property { name, length, scalar }) in element.properties.iter().enumerate()
            {
                match (length, &**name) {
                    (Some(length), _) if corner_list == Some(index) => {
                        for _ in 0..body.length(*length)? {
                            let index = body.number(*scalar)?;
                            corners.push(corner(index, body)?);
                        }
                    }
                    (Some(length), TEXCOORD | CORNER_UV) => {
                        for _ in 0..body.length(*length)? {
                            uv.push(body.number(*scalar)?);
                        }
                    }
                    (Some(length), _) => body.skip_list(*length, *scalar)?,
                    (None, _) => {
                        numbers.extend_from_slice(&body.number(*scalar)?.to_le_bytes());
                    }
                }
            }
            body.end_row(element)?;
            let faces = table.list.push(&corners);
            count += faces;
            let row = numbers.split_off(before);
            (0..faces).for_each(|_| numbers.extend_from_slice(&row));
            match &mut table.uv {
                Some(all) if uv.len() == 2 * corners.len() => {
                    all.extend_from_slice(uv.as_chunks::<2>().0);
                }
                _ => table.uv = None,
            }
        }
        if table.uv.is_none()
            && element
                .properties
                .iter()
                .any(|property| matches!(&*property.name, TEXCOORD | CORNER_UV))
        {
            notes
                .push("texture coordinates of faces are left out: some faces have none".to_owned());
        }
        table.uv = table.uv.filter(|uv| !uv.is_empty());
        let scalars = element.properties.iter().filter(|property| property.length.is_none());
        let scalars = (0..).zip(scalars).map(|(number, property)| Column {
            property: property.clone(),
            offset: number * size_of::<f64>(),
            stored: Scalar::F64,
        });
        let columns: Vec<_> = scalars.collect();
        let stride = columns.len() * size_of::<f64>();
        let rows = Rows { bytes: Cow::Owned(numbers), stride, count, big_endian: false };
        table.scalars = (!columns.is_empty()).then_some(Table { columns, rows, color_range: None });
        Ok(table)
    }

    /// Adds the triangles of triangle strips. Each corner forms a triangle with the previous two corners, every second triangle is
    /// reversed, and -1 begins a new strip.
    pub(super) fn add_strips(
        &mut self,
        element: &Element,
        body: &mut Body<'_>,
        notes: &mut Vec<String>,
    ) -> Result<(), Error> {
        let mut corners = Vec::new();
        for _ in 0..element.count {
            for Property { name, length, scalar } in &element.properties {
                match length {
                    Some(length) if name == "vertex_indices" || name == "vertex_index" => {
                        corners.clear();
                        for _ in 0..body.length(*length)? {
                            let index = body.number(*scalar)?;
                            corners.push(if index == -1.0 { END } else { corner(index, body)? });
                        }
                        for strip in corners.split(|&corner| corner == END) {
                            for (odd, triangle) in strip.windows(3).enumerate() {
                                let [a, b, c] = [triangle[0], triangle[1], triangle[2]];
                                self.list.push(&if odd % 2 == 0 { [a, b, c] } else { [b, a, c] });
                            }
                        }
                    }
                    Some(length) => body.skip_list(*length, *scalar)?,
                    None => drop(body.number(*scalar)?),
                }
            }
            body.end_row(element)?;
        }
        if self.uv.take().is_some() || self.scalars.take().is_some() {
            notes
                .push("attributes of faces are left out: strips of triangles have none".to_owned());
        }
        Ok(())
    }
}

/// Marks the end of a triangle strip.
const END: u32 = u32::MAX;

/// Returns the index of the list property that contains the corners of faces: the one with a usual name, or else the only integer list.
fn corner_list(element: &Element, notes: &mut Vec<String>) -> Option<usize> {
    if let Some(usual) = element.properties.iter().position(|property| {
        let usual = ["vertex_indices", "vertex_index", "vertexIndex", "vertex_ids", "indices"];
        property.length.is_some()
            && usual.iter().any(|name| property.name.eq_ignore_ascii_case(name))
    }) {
        return Some(usual);
    }
    fn is_whole(property: &Property) -> bool {
        property.length.is_some() && !property.scalar.is_float()
    }
    let mut lists = (0..).zip(&element.properties).filter(|(_, property)| is_whole(property));
    let found = lists.next().filter(|_| lists.next().is_none());
    notes.push(match found {
        Some((_, list)) => format!("the corners of faces are read from the list `{}`", list.name),
        None => {
            format!("all {} faces are left out: they have no list `vertex_indices`", element.count)
        }
    });
    found.map(|(index, _)| index)
}

/// Converts a number to a vertex index. The number must be the last one that was read from `body`, because an error reports the position of
/// that number.
pub(super) fn corner(index: f64, body: &Body<'_>) -> Result<u32, Error> {
    if !(0.0..f64::from(u32::MAX)).contains(&index) || index.fract() != 0.0 {
        bail!("{}: there is no vertex {index}", body.position());
    }
    Ok(index as u32)
}
