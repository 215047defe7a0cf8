//! Nodes that fill the holes of surfaces.

use maquette_node::{Pack, node};

mod attributes;
mod bending;
mod border;
mod creases;
mod exemplar;
mod fill_holes;
mod intersections;
mod method;
mod plain;
#[cfg(test)]
mod shapes;
#[cfg(test)]
mod tests;
mod triangles;
mod warnings;

pub use border::holes::HoleChoice;
pub use border::regions::HoleRegion;
pub use exemplar::{ExemplarOptions, Falloff, Start, TextureSource, Update};
pub use fill_holes::{FillHoles, FilledMesh, fill_holes};
pub use method::FillMethod;

/// The pack of nodes that fill the holes of surfaces.
pub static PACK: Pack = Pack {
    name: "fill",
    version: env!("CARGO_PKG_VERSION"),
    build: maquette_node::this_build!(),
    nodes: &[node::<FillHoles>()],
    ..Pack::EMPTY
};
