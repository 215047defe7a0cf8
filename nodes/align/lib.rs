//! Nodes that register several scans of one object.

use maquette_node::{Pack, Recipe, node};
use maquette_value::value_type;

mod align;
mod align_all;
mod alignment;
mod cloud;
mod features;
mod fit;
mod local_origin;
mod motion;
mod move_aligned;
mod pairs;
mod refine;
mod registration;
#[cfg(test)]
mod tests;

pub use align::{Align, AlignMethod, align};
pub use align_all::{AlignAll, Search, Turntable, align_all};
pub use alignment::{Alignment, PairFit};
pub use move_aligned::MoveAligned;

/// The nodes that register several scans of one object.
pub static PACK: Pack = Pack {
    name: "align",
    version: env!("CARGO_PKG_VERSION"),
    build: maquette_node::this_build!(),
    nodes: &[node::<Align>(), node::<AlignAll>(), node::<MoveAligned>()],
    values: &[value_type::<Alignment>()],
    recipes: &[Recipe { name: "captures", text: include_str!("recipes/captures.ron") }],
    ..Pack::EMPTY
};
