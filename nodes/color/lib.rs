//! Nodes that color surfaces: texture atlases, baking of captures and of vertex colors.

use maquette_node::{Pack, node};

mod atlas;
mod bake;
mod colors_to_texture;
mod layout;
#[cfg(test)]
mod tests;
mod texture_to_colors;
mod unwrap;

pub use atlas::Coordinates;
pub use bake::{Bake, BakedMesh, Baking, Level, bake};
pub use colors_to_texture::{ColorsToTexture, colors_to_texture};
pub use layout::{LaidOut, Layout, lay_out};
pub use texture_to_colors::{Sampling, TextureToColors, texture_to_colors};
pub use unwrap::Unwrap;

/// Nodes that color surfaces: texture atlases, baking of captures and of vertex colors.
pub static PACK: Pack = Pack {
    name: "color",
    version: env!("CARGO_PKG_VERSION"),
    build: maquette_node::this_build!(),
    nodes: &[
        node::<Unwrap>(),
        node::<Bake>(),
        node::<ColorsToTexture>(),
        node::<TextureToColors>(),
    ],
    ..Pack::EMPTY
};
