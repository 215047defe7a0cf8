//! Nodes that clean scans: they make triangles uniform, reduce noise, and remove stray points.

use maquette_node::{Pack, node};

#[cfg(test)]
#[path = "../base/topology/flat_faces/insert.rs"]
mod flat_faces;
mod flying_pixels;
mod remesh;
mod remove_outliers;
#[cfg(test)]
mod shapes;
mod smooth;
mod weld;

pub use flying_pixels::{FlyingPixels, flying_pixels};
pub use remesh::{Remesh, remesh};
pub use remove_outliers::{Outliers, RemoveOutliers, outliers};
pub use smooth::{Smooth, smooth};
pub use weld::Weld;

/// The pack of nodes that clean scans.
pub static PACK: Pack = Pack {
    name: "clean",
    version: env!("CARGO_PKG_VERSION"),
    build: maquette_node::this_build!(),
    nodes: &[
        node::<Remesh>(),
        node::<Smooth>(),
        node::<Weld>(),
        node::<RemoveOutliers>(),
        node::<FlyingPixels>(),
    ],
    ..Pack::EMPTY
};
