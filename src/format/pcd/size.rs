//! The sizes of points and grids that the header of a PCD file states.

use maquette_node::{FileHead, ValueSize};

use super::header;

/// Returns the size of the points in a PCD file.
pub(super) fn points(head: &FileHead<'_>) -> Option<ValueSize> {
    let header = header::read(head.start).ok()?;
    let normal = if header.normal.is_some() { 24 } else { 0 };
    let color = if header.color.is_some() || header.channels.is_some() { 3 } else { 0 };
    let attributes = normal + color + 8 * header.others.len();
    Some(ValueSize::points(header.width as f64 * header.height as f64, attributes as f64))
}

/// Returns the size of the grid in a PCD file.
pub(crate) fn range(head: &FileHead<'_>) -> Option<ValueSize> {
    let header = header::read(head.start).ok()?;
    let color = if header.color.is_some() { 3.0 } else { 0.0 };
    Some(ValueSize::points(header.width as f64 * header.height as f64, color))
}
