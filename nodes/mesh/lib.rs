//! Nodes on meshes, points and curves.

use maquette_node::{Pack, node};

mod common_frame;
mod followed;
mod merge;
mod motion;
mod movable;
mod moved_mesh;
mod orient;
mod poses;
mod primitive;
mod read_curve;
mod read_mesh;
mod read_points;
mod reconstruct;
mod texture;
mod transform;
mod turned_faces;

pub use merge::{Merge, merge};
pub use motion::Motion;
pub use movable::Movable;
pub use orient::{Orient, OrientedMesh, Outside, orient};
pub use poses::Poses;
pub use primitive::{Primitive, Shape, primitive};
pub use read_curve::{ReadCurve, curve_in_millimeters, read_curve};
pub use read_mesh::{ReadMesh, mesh_in_millimeters, read_mesh};
pub use read_points::{ReadPoints, in_millimeters};
pub use reconstruct::{FaceKind, Normals, Options, Reconstruct, SkinKind, reconstruct};
pub use texture::{Mapping, Texture, Window, texture};
pub use transform::{Transform, transform};

/// Nodes on meshes, points and curves.
pub static PACK: Pack = Pack {
    name: "mesh",
    version: env!("CARGO_PKG_VERSION"),
    build: maquette_node::this_build!(),
    nodes: &[
        node::<ReadMesh>(),
        node::<ReadPoints>(),
        node::<ReadCurve>(),
        node::<Primitive>(),
        node::<Texture>(),
        node::<Transform>(),
        node::<Orient>(),
        node::<Merge>(),
        node::<Reconstruct>(),
    ],
    ..Pack::EMPTY
};
