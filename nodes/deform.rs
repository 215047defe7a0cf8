//! Nodes that deform by handles.

use maquette::{Pack, node};

mod cells;
mod deformation;
mod drag;
mod ffd;
mod ffd_error;
mod field;
mod free_form;
mod gaussian_surface;
mod gaussians;
mod handles;
mod lattice;
mod layout;
mod lu;
mod mode;
mod object;
mod read_handles;
mod report;
mod system;
mod tube;

#[cfg(test)]
mod tests;

pub use drag::Drag;
pub use ffd::{Ffd, Target};
pub use ffd_error::FfdError;
pub use free_form::{Deforming, ffd};
pub use gaussian_surface::{GaussianSurface, GaussianSurfaceError, SurfacePoint, gaussian_surface};
pub use handles::{Handles, On, PlaceHandlesError, Within, place_handles};
pub use lattice::{Lattice, LatticeError, lattice};
pub use layout::Bounds;
pub use mode::Mode;
pub use read_handles::{ReadHandles, ReadHandlesError, read_handles};
pub use report::Report;
pub use tube::{Tube, TubeError, tube};

/// Nodes that deform by handles.
pub const PACK: Pack = Pack {
    name: "deform",
    nodes: &[
        node::<ReadHandles>(),
        node::<Handles>(),
        node::<Ffd>(),
        node::<GaussianSurface>(),
        node::<Lattice>(),
        node::<Tube>(),
    ],
    values: &[],
    formats: &[],
    readers: &[],
};
