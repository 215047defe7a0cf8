//! Why bytes are not a mesh, points or a range image in a PLY file.

use maquette_value::MeshError;
use thiserror::Error;

use crate::At;

/// Why bytes are not a mesh in a PLY file.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum PlyError {
    /// Something else.
    #[error("this is not a PLY file: its first line is not `ply`")]
    NotPly,
    /// A line of the header that says nothing known.
    #[error("line {line}: `{text}` is not a line of a PLY header")]
    Header {
        /// The line, from 1.
        line: usize,
        /// The line itself.
        text: String,
    },
    /// A header without end.
    #[error("the header has no line `end_header`")]
    EndlessHeader,
    /// A header that does not say how numbers are stored.
    #[error("the header has no line `format`")]
    NoFormat,
    /// No positions.
    #[error("the file has no vertices with x, y and z")]
    NoVertices,
    /// Fewer data than the header promises.
    #[error(
        "line {line}: {count} of `{name}` take at least {expected} bytes, but only {found} are left"
    )]
    CutOff {
        /// The line of the header that promises them, from 1.
        line: usize,
        /// What is promised.
        name: String,
        /// How many are promised.
        count: usize,
        /// Bytes left.
        found: usize,
        /// Bytes that are needed.
        expected: usize,
    },
    /// The file ends inside an element.
    #[error("{at}: the file ends too early")]
    Ends {
        /// Its end.
        at: At,
    },
    /// A row that ends within a line.
    #[error("{at}: more stands here than a row of `{name}` has, or less in the line before")]
    Row {
        /// Where it ends.
        at: At,
        /// The element.
        name: String,
    },
    /// A word that is no number.
    #[error("{at}: `{text}` is not a number")]
    Number {
        /// Where.
        at: At,
        /// The word.
        text: String,
    },
    /// A list whose length is not a whole number.
    #[error("{at}: a list cannot have {length} entries")]
    Length {
        /// Where.
        at: At,
        /// Its length.
        length: f64,
    },
    /// A corner of a face that is not the number of a vertex.
    #[error("{at}: there is no vertex {index}")]
    Index {
        /// Where.
        at: At,
        /// What the file says.
        index: f64,
    },
    /// No grid, where one is wanted.
    #[error("the file has no `range_grid`: its points are no range image")]
    NoGrid,
    /// A grid without its size.
    #[error("the header does not say how large the grid is: `obj_info {key}` is missing")]
    NoGridSize {
        /// `num_cols` or `num_rows`.
        key: &'static str,
    },
    /// A grid of another size than it should have.
    #[error("line {line}: the grid has {found} cells, but it is {columns} x {rows}")]
    GridSize {
        /// The line of the header that promises them, from 1.
        line: usize,
        /// Cells of the grid.
        found: usize,
        /// What `num_cols` says.
        columns: usize,
        /// What `num_rows` says.
        rows: usize,
    },
    /// A cell with several points.
    #[error("{at}: a cell of a grid has one point or none, not {count}")]
    Cell {
        /// Where.
        at: At,
        /// Its points.
        count: usize,
    },
    /// A cell that names no vertex.
    #[error("a cell names vertex {vertex}, but there are only {vertices}")]
    NoVertex {
        /// The vertex it names.
        vertex: u32,
        /// Number of vertices.
        vertices: usize,
    },
    /// Vertices and faces that make no mesh.
    #[error(transparent)]
    Mesh(#[from] MeshError),
}
