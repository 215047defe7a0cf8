//! Nodes that close the holes of surfaces.

use maquette::{Pack, node};

mod border;
mod boxes;
mod calm;
mod carry;
mod chart;
mod charts;
mod clashes;
mod colors;
mod creases;
mod density;
mod exemplar;
mod facets;
mod fairing;
mod fill_error;
mod fill_holes;
mod filling;
mod holes;
mod intersections;
mod large_hole;
mod least_bent;
mod mend;
mod method;
mod patch;
mod plain;
mod plug;
mod regions;
mod remesh;
mod rim;
mod settle;
#[cfg(test)]
mod shapes;
mod sizes;
#[cfg(test)]
mod tests;
mod triangulation;
mod wanted;

pub use exemplar::{ExemplarOptions, Falloff, Shown, Start, Update};
pub use fill_error::FillError;
pub use fill_holes::{FillHoles, FillOptions, Filled, fill_holes};
pub use holes::HoleChoice;
pub use method::FillMethod;
pub use regions::{HoleRegion, NoMarks};

/// Nodes that close the holes of surfaces.
pub const PACK: Pack =
    Pack { name: "fill", nodes: &[node::<FillHoles>()], values: &[], formats: &[], readers: &[] };
