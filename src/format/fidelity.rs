//! The kinds of data that each format of meshes and points keeps or changes; all other kinds are lost. `maquette help formats` prints these
//! lists, and tests compare the lists with the results of the writers and readers.

use maquette_node::DataKind::*;
use maquette_node::Fidelities;
use maquette_node::Fidelity::{Changed, Kept};

const TRIANGLES: &str = "cut into triangles";

/// Data written to PLY files.
pub(crate) const PLY: Fidelities = &[
    (Positions, Kept),
    (Faces, Kept),
    (Normals, Kept),
    (VertexColors, Kept),
    (FaceColors, Kept),
    (VertexUv, Kept),
    (CornerUv, Kept),
    (VertexAttributes, Kept),
    (FaceAttributes, Kept),
    (Pictures, Changed("their colors at the vertices")),
];

pub(crate) const PLY_READ: Fidelities = &[
    (Positions, Kept),
    (Faces, Kept),
    (Normals, Kept),
    (VertexColors, Kept),
    (FaceColors, Kept),
    (VertexUv, Kept),
    (CornerUv, Kept),
    (VertexAttributes, Kept),
    (FaceAttributes, Kept),
    (Pictures, Changed("the first one that the file names")),
];

pub(crate) const OBJ: Fidelities = &[
    (Positions, Kept),
    (Faces, Kept),
    (Normals, Kept),
    (VertexColors, Kept),
    (VertexUv, Kept),
    (CornerUv, Kept),
    (Materials, Kept),
    (Pictures, Kept),
];

pub(crate) const OBJ_READ: Fidelities = &[
    (Positions, Kept),
    (Faces, Kept),
    (Normals, Kept),
    (VertexColors, Kept),
    (VertexUv, Kept),
    (CornerUv, Kept),
    (Materials, Kept),
    (Pictures, Kept),
];

pub(crate) const GLB: Fidelities = &[
    (Positions, Kept),
    (Faces, Changed(TRIANGLES)),
    (Normals, Kept),
    (VertexColors, Kept),
    (CornerColors, Kept),
    (VertexUv, Kept),
    (CornerUv, Kept),
    (VertexAttributes, Kept),
    (CornerAttributes, Kept),
    (Materials, Kept),
    (Pictures, Kept),
    (Units, Changed("meters")),
    (UpAxis, Kept),
];

pub(crate) const GLB_READ: Fidelities = &[
    (Positions, Kept),
    (Faces, Kept),
    (Normals, Kept),
    (VertexColors, Kept),
    (CornerColors, Kept),
    (VertexUv, Kept),
    (CornerUv, Kept),
    (VertexAttributes, Kept),
    (CornerAttributes, Kept),
    (Materials, Kept),
    (Pictures, Kept),
    (Units, Changed("mm")),
    (UpAxis, Kept),
];

pub(crate) const STL: Fidelities =
    &[(Positions, Kept), (Faces, Changed(TRIANGLES)), (Normals, Changed("those of the faces"))];

pub(crate) const STL_READ: Fidelities = &[(Positions, Kept), (Faces, Kept)];

pub(crate) const THREE_MF: Fidelities = &[
    (Positions, Changed("moved onto the plate")),
    (Faces, Changed(TRIANGLES)),
    (VertexColors, Kept),
    (CornerColors, Kept),
    (VertexUv, Changed("only beside a picture")),
    (CornerUv, Changed("only beside a picture")),
    (Materials, Changed("their colors")),
    (Pictures, Kept),
    (Units, Kept),
    (UpAxis, Changed("z")),
];

pub(crate) const THREE_MF_READ: Fidelities = &[
    (Positions, Kept),
    (Faces, Kept),
    (VertexColors, Kept),
    (CornerColors, Kept),
    (VertexUv, Kept),
    (CornerUv, Kept),
    (Materials, Changed("colors of vertices")),
    (Pictures, Changed("the first one")),
    (Units, Changed("mm")),
    (UpAxis, Changed("y")),
];

pub(crate) const POINTS_PLY: Fidelities = &[
    (Positions, Kept),
    (Normals, Kept),
    (VertexColors, Kept),
    (VertexUv, Kept),
    (VertexAttributes, Kept),
];

pub(crate) const POINTS_XYZ: Fidelities =
    &[(Positions, Kept), (Normals, Changed("unless there are colors")), (VertexColors, Kept)];

pub(crate) const POINTS_READ: Fidelities =
    &[(Positions, Kept), (Normals, Kept), (VertexColors, Kept), (VertexAttributes, Kept)];

#[cfg(test)]
mod tests;
