//! The sizes of meshes, points and grids that the header of a PLY file states.

use maquette_node::{Certainty, FileHead, ValueSize};

use super::header::{self, Element, Encoding, Header};

/// Returns the memory of a vertex's attributes in bytes: 3 for a color, 24 for a normal, 8 for every other number.
fn attribute_bytes(vertex: &Element) -> f64 {
    let bytes = vertex.properties.iter().map(|property| match &property.name[..] {
        "x" | "y" | "z" | "alpha" => 0.0,
        "red" | "green" | "blue" => 1.0,
        _ => 8.0,
    });
    bytes.sum()
}

/// Returns the number of corners of all faces, if it follows from the length of the file: the last element is that of the faces, and it has
/// one list.
fn corners(header: &Header, length: u64) -> Option<f64> {
    let (last, others) = header.elements.split_last()?;
    let mut of_others = others.iter().flat_map(|element| &element.properties);
    if last.name != "face"
        || header.encoding == Encoding::Ascii
        || of_others.any(|property| property.length.is_some())
    {
        return None;
    }
    let mut lists = last.properties.iter().filter(|property| property.length.is_some());
    let (list, None) = (lists.next()?, lists.next()) else { return None };
    let rows = header.elements.iter();
    let rows = rows.map(|it| it.count as f64 * header.encoding.min_row_size(it) as f64);
    let rest = length as f64 - header.start as f64 - rows.sum::<f64>();
    Some((rest / list.scalar.size() as f64).max(0.0))
}

/// Returns the size of the mesh in a PLY file.
pub(super) fn mesh(head: &FileHead<'_>) -> Option<ValueSize> {
    let header = header::read(head.start).ok()?;
    let vertex = header.elements.iter().find(|element| element.name == "vertex")?;
    let faces = header.elements.iter().find(|it| it.name == "face").map_or(0, |it| it.count) as f64;
    let (corners, certainty) = match corners(&header, head.length) {
        _ if faces == 0.0 => (0.0, Certainty::Exact),
        Some(corners) => (corners, Certainty::Exact),
        None => (3.0 * faces, Certainty::Predicted),
    };
    let vertices = vertex.count as f64;
    let size = ValueSize::mesh(vertices, faces, corners);
    Some(size.with_more_bytes(vertices * attribute_bytes(vertex)).at_most(certainty))
}

/// Returns the size of the points in a PLY file.
pub(super) fn points(head: &FileHead<'_>) -> Option<ValueSize> {
    let header = header::read(head.start).ok()?;
    let vertex = header.elements.iter().find(|element| element.name == "vertex")?;
    Some(ValueSize::points(vertex.count as f64, attribute_bytes(vertex)))
}

/// Returns the size of the grid in a PLY file with a `range_grid`.
pub(crate) fn range(head: &FileHead<'_>) -> Option<ValueSize> {
    let header = header::read(head.start).ok()?;
    let grid = header.elements.iter().find(|element| element.name == "range_grid")?;
    Some(ValueSize::points(grid.count as f64, GRID_CELL))
}

/// Memory in bytes of a cell of a range image in addition to its position: a color and a flag.
const GRID_CELL: f64 = 4.0;
