//! Nodes that color surfaces: texture atlases, and what captures and vertices show in them.

use maquette::Pack;

mod layout;
mod unwrap;

pub use layout::{LaidOut, Layout, LayoutError, lay_out};
pub use unwrap::Unwrap;

maquette::nodes_of_this_build!();

/// Nodes that color surfaces: texture atlases, and what captures and vertices show in them.
pub static PACK: Pack = Pack {
    name: "color",
    nodes: &[node::<Unwrap>()],
    values: &[],
    formats: &[],
    readers: &[],
    migrations: &[],
    recipes: &[],
};
