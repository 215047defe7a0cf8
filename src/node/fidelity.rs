//! What a file keeps of a mesh or of points: what its writer and its reader say of themselves.

/// A kind of data of meshes and points, of which a file may hold some.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum DataKind {
    /// Where vertices and points are.
    Positions,
    /// Which vertices a face joins.
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
    /// The sharpness of edges, the one attribute that edges have.
    Creases,
    /// Colors of materials.
    Materials,
    /// The picture on the surface.
    Pictures,
    /// The unit of lengths.
    Units,
    /// The axis that points upwards.
    UpAxis,
}

impl DataKind {
    /// All kinds, in the order of the manual.
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

    /// Its name in the manual.
    #[doc(hidden)]
    pub fn in_words(self) -> &'static str {
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

/// What becomes of data that is written to a file, or read from one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fidelity {
    /// It is there, with the precision of the file.
    Kept,
    /// It is there in another form: which one, in a few words.
    Changed(&'static str),
}

/// What a writer or a reader keeps and changes; kinds that are not listed are lost. An empty list says nothing.
pub type Fidelities = &'static [(DataKind, Fidelity)];
