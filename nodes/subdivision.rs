//! Nodes on subdivision surfaces.

use maquette::{Pack, node};

mod carry;
mod connectivity;
mod loop_masks;
mod plan;
mod sharpness;
mod subdivide;

pub use subdivide::{Boundary, Scheme, Subdivide, SubdivideError, Subdivision, subdivide};

/// Nodes on subdivision surfaces.
pub const PACK: Pack =
    Pack { name: "subdivision", nodes: &[node::<Subdivide>()], values: &[], formats: &[] };
