//! Nodes that make solids, which can be printed.

use maquette_node::{Pack, node};

mod base;
mod boolean;
mod combine;
mod contour;
mod extended;
mod hollow;
mod how_to_close;
mod offset;
mod operation;
mod polygons;
#[cfg(test)]
mod random_rays;
mod repair;
mod shell;
mod solid;
mod thicken;
mod transfer_attributes;
mod volume;

pub use boolean::Boolean;
pub use combine::boolean;
pub use hollow::{Hollow, Outlet, hollow};
pub use operation::Operation;
pub use shell::{Shell, Side, shell};
pub use solid::{Base, Holes, Repair, Solid, SolidMesh, solid};
pub use thicken::ThinWalls;

/// Nodes that make solids, which can be printed.
pub static PACK: Pack = Pack {
    name: "solid",
    version: env!("CARGO_PKG_VERSION"),
    build: maquette_node::this_build!(),
    nodes: &[node::<Solid>(), node::<Shell>(), node::<Hollow>(), node::<Boolean>()],
    ..Pack::EMPTY
};
