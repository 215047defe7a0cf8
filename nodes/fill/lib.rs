//! Nodes that close the holes of surfaces.

use maquette::Pack;

mod attributes;
mod border;
mod creases;
mod exemplar;
mod fill_error;
mod fill_holes;
mod intersections;
mod method;
mod plain;
#[cfg(test)]
mod shapes;
#[cfg(test)]
mod tests;
mod triangles;

pub use border::holes::HoleChoice;
pub use border::regions::{HoleRegion, NoMarks};
pub use exemplar::{ExemplarOptions, Falloff, Shown, Start, Update};
pub use fill_error::FillError;
pub use fill_holes::{FillHoles, Filled, fill_holes};
pub use method::FillMethod;

maquette::nodes_of_this_build!();

/// Nodes that close the holes of surfaces.
pub static PACK: Pack = Pack {
    name: "fill",
    nodes: &[node::<FillHoles>()],
    values: &[],
    formats: &[],
    readers: &[],
    migrations: &[],
    recipes: &[],
};
