//! Nodes that clean scans: even faces, less noise, nothing that flies around.

use maquette::Pack;

mod remesh;
mod remesh_error;
#[cfg(test)]
mod shapes;

pub use remesh::{Remesh, remesh};
pub use remesh_error::RemeshError;

maquette::nodes_of_this_build!();

/// Nodes that clean scans.
pub static PACK: Pack = Pack {
    name: "clean",
    nodes: &[node::<Remesh>()],
    values: &[],
    formats: &[],
    readers: &[],
    migrations: &[],
    recipes: &[],
};
