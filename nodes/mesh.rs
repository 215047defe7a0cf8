//! Nodes on meshes.

use maquette::{Pack, node};

mod merge;
mod read_mesh;
mod texture;
mod transform;

pub use merge::{Merge, MergeError, Poses, merge};
pub use read_mesh::{ReadMesh, ReadMeshError, read_mesh};
pub use texture::{Mapping, Texture, TextureError, Window, texture};
pub use transform::{Motion, Movable, Transform, TransformError, transform};

/// Nodes on meshes.
pub const PACK: Pack = Pack {
    name: "mesh",
    nodes: &[node::<ReadMesh>(), node::<Texture>(), node::<Transform>(), node::<Merge>()],
    values: &[],
    formats: &[],
};
