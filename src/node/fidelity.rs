//! Fidelity: the data of meshes and points that a file format preserves. Writers and readers of file formats declare it.

/// A kind of data that a file with a mesh or points may contain.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum DataKind {
    /// Positions of vertices and points.
    Positions,
    /// The faces, as the indices of their vertices.
    Faces,
    /// The attribute `normal` of vertices.
    Normals,
    /// The attribute `color` of vertices.
    VertexColors,
    /// The attribute `color` of faces.
    FaceColors,
    /// The attribute `color` of corners.
    CornerColors,
    /// The attribute `uv` of vertices.
    VertexUv,
    /// The attribute `uv` of corners.
    CornerUv,
    /// Other attributes of vertices.
    VertexAttributes,
    /// Other attributes of faces.
    FaceAttributes,
    /// Other attributes of corners.
    CornerAttributes,
    /// The sharpness of creased edges, which is the only attribute of edges.
    Creases,
    /// The colors of materials.
    Materials,
    /// The textures of materials.
    Pictures,
    /// The unit of lengths in the file.
    Units,
    /// The axis of the file's coordinate system that points up.
    UpAxis,
}

impl DataKind {
    /// All kinds of data, in the order in which the manual lists them.
    pub const ALL: [Self; 16] = [
        Self::Positions,
        Self::Faces,
        Self::Normals,
        Self::VertexColors,
        Self::FaceColors,
        Self::CornerColors,
        Self::VertexUv,
        Self::CornerUv,
        Self::VertexAttributes,
        Self::FaceAttributes,
        Self::CornerAttributes,
        Self::Creases,
        Self::Materials,
        Self::Pictures,
        Self::Units,
        Self::UpAxis,
    ];

    /// Returns the name of the kind for the manual.
    #[doc(hidden)]
    pub fn name(self) -> &'static str {
        match self {
            Self::Positions => "positions",
            Self::Faces => "faces",
            Self::Normals => "normals",
            Self::VertexColors => "colors of vertices",
            Self::FaceColors => "colors of faces",
            Self::CornerColors => "colors of corners",
            Self::VertexUv => "uv of vertices",
            Self::CornerUv => "uv of corners",
            Self::VertexAttributes => "own attributes of vertices",
            Self::FaceAttributes => "own attributes of faces",
            Self::CornerAttributes => "own attributes of corners",
            Self::Creases => "creases, attributes of edges",
            Self::Materials => "materials",
            Self::Pictures => "pictures",
            Self::Units => "units",
            Self::UpAxis => "up axis",
        }
    }
}

/// How well a kind of data is preserved when it is written to a file or read from one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fidelity {
    /// The data is preserved, with the precision of the file format.
    Kept,
    /// The data is converted; the text describes how.
    Changed(&'static str),
}

/// The kinds of data that a writer or reader preserves or converts. Kinds that are not in the list are lost. An empty list makes no
/// statement.
pub type Fidelities = &'static [(DataKind, Fidelity)];
