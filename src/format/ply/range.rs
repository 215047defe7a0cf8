//! Reads range grids from PLY files in the form of the Stanford 3D Scanning Repository: vertices, and an element `range_grid`. Each cell of
//! the grid has the index of one vertex or of none.

use maquette_syntax::bail;
use maquette_syntax::error::Error;
use maquette_value::RangeImage;
use nalgebra::Point3;

use super::body::Body;
use super::faces::corner;
use super::header::{self, Element, Header, Property};
use super::table::Table;
use super::{no_vertices, skip};
use crate::losses;
use crate::range_file::{Axes, RangeFile, Rows};

/// Reads the range grid in a PLY file. The lines `obj_info num_cols` and `obj_info num_rows` state its size.
///
/// The file does not state which row is the top one; this is determined from the points. A file with the line
/// `obj_info is_cyberware_data 1` comes from a Cyberware scanner: its unit is the meter, with y up and z towards the sensor.
///
/// Returns an error if the bytes are not a PLY file with a grid, the file is truncated, or a cell refers to a missing vertex.
pub fn read_range(bytes: &[u8]) -> Result<RangeFile, Error> {
    let header = header::read(bytes)?;
    let mut body = Body::new(&header, bytes);
    let (mut vertices, mut cells) = (None, None);
    let mut notes = Vec::new();
    for element in &header.elements {
        body.check_room(element)?;
        match &*element.name {
            "vertex" if vertices.is_none() => vertices = Some(Table::read(element, &mut body)?),
            "range_grid" if cells.is_none() => {
                cells = Some(read_cells(&header, element, &mut body)?);
            }
            _ => {
                if element.count > 0 {
                    notes.push(format!(
                        "the element `{}` is left out: range images do not have it",
                        element.name
                    ));
                }
                skip(element, &mut body)?;
            }
        }
    }
    let (size, cells) = cells.ok_or_else(no_grid)?;
    let vertices = vertices.ok_or_else(no_vertices)?;
    let range = gather(size, &cells, vertices, &mut notes)?;
    let cyberware = header.info("is_cyberware_data") == Some(1.0);
    Ok(RangeFile {
        range,
        unit: cyberware.then_some(1000.0),
        axes: cyberware.then_some(Axes::YUp),
        rows: Rows::ByHeight,
        notes,
    })
}

fn no_grid() -> Error {
    Error::new("the file has no element `range_grid`: its points are not a range image")
}

/// Marks a cell without a point.
const NONE: u32 = u32::MAX;

/// Reads the size of the grid, and for each cell the index of its vertex.
fn read_cells(
    header: &Header,
    element: &Element,
    body: &mut Body<'_>,
) -> Result<([usize; 2], Vec<u32>), Error> {
    fn size(key: &str, header: &Header) -> Result<f64, Error> {
        let Some(size) = header.info(key) else {
            bail!("the header has no line `obj_info {key}`");
        };
        Ok(size)
    }
    // A NaN is cast to 0, which is never the number of cells.
    let [columns, rows] = [size("num_cols", header)? as usize, size("num_rows", header)? as usize];
    let found = element.count;
    if columns.checked_mul(rows) != Some(found) || found == 0 {
        let line = element.line;
        bail!("line {line}: the grid has {found} cells, but it is {columns} x {rows}");
    }
    if !element.properties.iter().any(|property| property.length.is_some()) {
        return Err(no_grid());
    }
    let mut cells = Vec::with_capacity(found);
    for _ in 0..found {
        let mut cell = NONE;
        for Property { name, length, scalar } in &element.properties {
            match (length, &**name) {
                (Some(length), "vertex_indices" | "vertex_index") => match body.length(*length)? {
                    0 => {}
                    1 => {
                        let index = body.number(*scalar)?;
                        cell = corner(index, body)?;
                    }
                    count => {
                        let at = body.position();
                        bail!("{at}: a cell of a grid has one point or none, not {count}")
                    }
                },
                (Some(length), _) => body.skip_list(*length, *scalar)?,
                (None, _) => drop(body.number(*scalar)?),
            }
        }
        body.end_row(element)?;
        cells.push(cell);
    }
    Ok(([columns, rows], cells))
}

/// Puts the vertices into the cells that refer to them.
fn gather(
    [columns, rows]: [usize; 2],
    cells: &[u32],
    mut vertices: Table<'_>,
    notes: &mut Vec<String>,
) -> Result<RangeImage, Error> {
    let fields = vertices.take(["x", "y", "z"]).ok_or_else(no_vertices)?;
    let positions = vertices.rows.gather(&fields, Point3::from);
    let count = positions.len();
    let missing = cells.iter().find(|&&vertex| vertex != NONE && count <= vertex as usize);
    if let Some(&vertex) = missing {
        bail!("a cell refers to vertex {vertex}, but there are only {count} vertices");
    }
    let points = cells
        .iter()
        .map(|&vertex| match vertex {
            NONE => Point3::new(f64::NAN, f64::NAN, f64::NAN),
            vertex => positions[vertex as usize],
        })
        .collect();
    let range = RangeImage::new(columns, rows, points).expect("there is a point for each cell");
    let colors = vertices.take_colors(notes);
    let others = vertices.columns.iter().map(|column| &column.property.name[..]);
    notes.extend(losses::range_warning(others));
    let Some(colors) = colors else { return Ok(range) };
    let colors = cells
        .iter()
        .map(|&vertex| colors.get(vertex as usize).copied().unwrap_or_default())
        .collect();
    Ok(range.with_colors(colors).expect("there is a color for each cell"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hostile;

    const GRID: &[u8] = include_bytes!("../../../tests/data/formats/range_grid_ascii.ply");
    const BIG: &[u8] = include_bytes!("../../../tests/data/formats/range_grid_be.ply");

    /// The grid of a scanner with y up. It has two rows, the bottom one first.
    const CYBERWARE: &str = "ply\nformat ascii 1.0\nobj_info is_cyberware_data 1\nobj_info num_cols 2\nobj_info num_rows 2\n\
        element vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement range_grid 4\n\
        property list uchar int vertex_indices\nend_header\n0 0 0.5\n0 1 0.5\n1 1 0.5\n1 0\n0\n1 1\n1 2\n";

    #[test]
    fn a_cyberware_grid_is_rotated_upright() {
        let range = read_range(CYBERWARE.as_bytes()).unwrap().normalize(1.0, Axes::Camera).unwrap();
        let points = [
            Some(Point3::new(0.0, -1000.0, -500.0)),
            Some(Point3::new(1000.0, -1000.0, -500.0)),
            Some(Point3::new(0.0, 0.0, -500.0)),
            None,
        ];
        assert_eq!([0, 1, 2, 3].map(|cell| range.point(cell)), points);
    }

    fn error(from: &str, to: &str) -> String {
        assert!(CYBERWARE.contains(from));
        read_range(CYBERWARE.replacen(from, to, 1).as_bytes()).unwrap_err().to_string()
    }

    #[test]
    fn invalid_grids_are_rejected() {
        assert_eq!(
            error("range_grid", "face"),
            "the file has no element `range_grid`: its points are not a range image"
        );
        assert_eq!(error("num_cols 2", "num_cols x"), "the header has no line `obj_info num_cols`");
        assert_eq!(
            error("num_cols 2", "num_cols 3"),
            "line 10: the grid has 4 cells, but it is 3 x 2"
        );
        assert_eq!(
            error("1 2\n", "1 3\n"),
            "a cell refers to vertex 3, but there are only 3 vertices"
        );
        assert_eq!(
            error("1 2\n", "2 1 2\n"),
            "line 19: a cell of a grid has one point or none, not 2"
        );
        assert_eq!(error("1 2\n", "1 -1\n"), "line 19: there is no vertex -1");
    }

    #[test]
    fn hostile_files_give_errors() {
        for file in [GRID, BIG, CYBERWARE.as_bytes()] {
            hostile::check_no_panic(file, |bytes| read_range(bytes).is_ok());
        }
    }
}
