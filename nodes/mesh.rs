//! Nodes on meshes.

use maquette::{Pack, node};

mod read_mesh;
mod texture;
mod transform;

pub use read_mesh::{ReadMesh, ReadMeshError, read_mesh};
pub use texture::{Mapping, Texture, TextureError, Window, texture};
pub use transform::{Motion, Movable, Transform, TransformError, transform};

/// Nodes on meshes.
pub const PACK: Pack = Pack {
    name: "mesh",
    nodes: &[node::<ReadMesh>(), node::<Texture>(), node::<Transform>()],
    values: &[],
    formats: &[],
};
