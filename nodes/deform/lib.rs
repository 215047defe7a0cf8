//! Nodes that deform objects by handles.

use maquette_node::{Pack, node};

mod ffd;
mod free_form;
mod gaussian;
mod gaussian_surface;
mod handles;
mod lattice;
mod mode;
mod read_handles;
mod tube;

#[cfg(test)]
mod tests;

pub use ffd::{Ffd, Target};
pub use free_form::drag::Drag;
pub use free_form::pull::{DeformOptions, ffd};
pub use free_form::report::Report;
pub use gaussian::layout::Bounds;
pub use gaussian_surface::{GaussianSurface, SurfacePoint, gaussian_surface};
pub use handles::{HandleRegion, Handles, Placement, place_handles};
pub use lattice::{Lattice, lattice};
pub use mode::Mode;
pub use read_handles::{ReadHandles, read_handles};
pub use tube::{Tube, tube};

/// The pack of nodes that deform objects by handles.
pub static PACK: Pack = Pack {
    name: "deform",
    version: env!("CARGO_PKG_VERSION"),
    build: maquette_node::this_build!(),
    nodes: &[
        node::<ReadHandles>(),
        node::<Handles>(),
        node::<Ffd>(),
        node::<GaussianSurface>(),
        node::<Lattice>(),
        node::<Tube>(),
    ],
    ..Pack::EMPTY
};
