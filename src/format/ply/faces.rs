//! The faces of a PLY file.

use std::borrow::Cow;

use maquette_value::Faces;

use super::body::{Body, Rows};
use super::header::{CORNER_UV, Element, Property, Scalar, TEXCOORD};
use super::{Column, PlyError, Table};
use crate::corners::FaceList;

/// The corners of all faces, and their texture coordinates.
#[derive(Default)]
pub(super) struct FaceTable {
    /// All faces, if they are triangles without repeated corners in a binary table of nothing else.
    pub(super) triangles: Option<Faces>,
    /// All faces otherwise.
    pub(super) list: FaceList,
    pub(super) uv: Option<Vec<[f64; 2]>>,
    /// What is no list, of the faces in `list`.
    pub(super) scalars: Option<Table<'static>>,
}

impl FaceTable {
    pub(super) fn read(element: &Element, body: &mut Body<'_>) -> Result<Self, PlyError> {
        if let Some(triangles) = body.take_triangles(element) {
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
            for Property { name, length, scalar } in &element.properties {
                match (length, &**name) {
                    (Some(length), "vertex_indices" | "vertex_index") => {
                        read_corners(body, *length, *scalar, &mut corners)?;
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
            match table.list.push(&corners) {
                true => count += 1,
                false => numbers.truncate(before),
            }
            match &mut table.uv {
                Some(all) if uv.len() == 2 * corners.len() => {
                    all.extend_from_slice(uv.as_chunks::<2>().0);
                }
                _ => table.uv = None,
            }
        }
        table.uv = table.uv.filter(|uv| !uv.is_empty());
        let scalars = element.properties.iter().filter(|property| property.length.is_none());
        let scalars = (0..).zip(scalars).map(|(number, property)| Column {
            property: property.clone(),
            offset: number * size_of::<f64>(),
            stored: Scalar::F64,
        });
        let columns = Vec::from_iter(scalars);
        let stride = columns.len() * size_of::<f64>();
        let rows = Rows { bytes: Cow::Owned(numbers), stride, count, big_endian: false };
        table.scalars = (!columns.is_empty()).then_some(Table { columns, rows });
        Ok(table)
    }
}

fn read_corners(
    body: &mut Body<'_>,
    length: Scalar,
    scalar: Scalar,
    corners: &mut Vec<u32>,
) -> Result<(), PlyError> {
    for _ in 0..body.length(length)? {
        let index = body.number(scalar)?;
        if !(0.0..f64::from(u32::MAX)).contains(&index) || index.fract() != 0.0 {
            return Err(PlyError::Index { at: body.at(), index });
        }
        corners.push(index as u32);
    }
    Ok(())
}
