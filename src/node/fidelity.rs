//! Fidelity: which data of meshes and points a file format preserves, as its writer and its reader declare.

/// A kind of data that a file of meshes or points may contain.
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
    /// The unit in which the file measures lengths.
    Units,
    /// The axis that points up.
    UpAxis,
}

impl DataKind {
    /// All kinds of data, in the order of the manual.
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

/// The degree to which data that is written to a file, or read from one, is preserved.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fidelity {
    /// The data is preserved, with the precision that the file format has.
    Kept,
    /// The data is converted; the text describes how.
    Changed(&'static str),
}

/// The kinds of data that a writer or reader preserves or converts. Kinds that are not listed are lost. If the list is empty, nothing is
/// declared.
pub type Fidelities = &'static [(DataKind, Fidelity)];
