//! The error of reading PLY files.

use maquette_value::MeshError;
use thiserror::Error;

use crate::FilePosition;

/// Error of reading a mesh, points or a range image from a PLY file.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum PlyError {
    /// The file is not PLY.
    #[error("expected `ply` in the first line: this is not a PLY file")]
    NotPly,
    /// A header line is invalid.
    #[error("line {line}: `{text}` is not a line of a PLY header")]
    Header {
        /// The number of the line, from 1.
        line: usize,
        /// The text of the line.
        text: String,
    },
    /// The header has no line `end_header`.
    #[error("the header has no line `end_header`")]
    EndlessHeader,
    /// The header has no line `format`.
    #[error("the header has no line `format`")]
    NoFormat,
    /// The file has no positions.
    #[error("the file has no vertices with x, y and z")]
    NoVertices,
    /// The file has fewer data than the header states.
    #[error(
        "line {line}: {count} rows of `{name}` need at least {expected} bytes, but only {found} are left"
    )]
    CutOff {
        /// The number of the line that declares the element in the header, from 1.
        line: usize,
        /// The name of the element.
        name: String,
        /// The number of rows that the element should have.
        count: usize,
        /// The number of bytes that are left in the file.
        found: usize,
        /// The number of bytes that the rows need at least.
        expected: usize,
    },
    /// The file ends inside an element.
    #[error("{at}: the file ends too early")]
    Ends {
        /// The position of the end of the file.
        at: FilePosition,
    },
    /// In a text, a row and its line do not end at the same position.
    #[error(
        "{at}: expected one row of `{name}` per line: this line has too many numbers, or the previous one too few"
    )]
    Row {
        /// The position of the end of the row.
        at: FilePosition,
        /// The name of the element.
        name: String,
    },
    /// A word is not a number.
    #[error("{at}: `{text}` is not a number")]
    Number {
        /// The position of the error.
        at: FilePosition,
        /// The word that is not a number.
        text: String,
    },
    /// The length of a list is not a nonnegative integer.
    #[error("{at}: a list cannot have {length} entries")]
    Length {
        /// The position of the error.
        at: FilePosition,
        /// The length in the file.
        length: f64,
    },
    /// A corner of a face is not a valid index of a vertex.
    #[error("{at}: there is no vertex {index}")]
    Index {
        /// The position of the error.
        at: FilePosition,
        /// The number in the file.
        index: f64,
    },
    /// The file has no grid.
    #[error("the file has no element `range_grid`: its points are not a range image")]
    NoGrid,
    /// The header lacks the size of the grid.
    #[error("the header has no line `obj_info {key}`")]
    NoGridSize {
        /// The missing key: `num_cols` or `num_rows`.
        key: &'static str,
    },
    /// The number of cells differs from columns x rows.
    #[error("line {line}: the grid has {found} cells, but it is {columns} x {rows}")]
    GridSize {
        /// The number of the line that declares the element in the header, from 1.
        line: usize,
        /// The number of cells.
        found: usize,
        /// The value of `num_cols`.
        columns: usize,
        /// The value of `num_rows`.
        rows: usize,
    },
    /// A cell has several points.
    #[error("{at}: a cell of a grid has one point or none, not {count}")]
    Cell {
        /// The position of the cell.
        at: FilePosition,
        /// The number of points in the cell.
        count: usize,
    },
    /// A cell refers to a vertex that does not exist.
    #[error("a cell refers to vertex {vertex}, but there are only {vertices} vertices")]
    NoVertex {
        /// The index of the vertex.
        vertex: u32,
        /// The number of vertices in the file.
        vertices: usize,
    },
    /// The vertices and faces are not a valid mesh.
    #[error(transparent)]
    Mesh(#[from] MeshError),
}
