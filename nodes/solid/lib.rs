//! Nodes that make solids: what a printer can make.

use maquette_node::{Pack, node};

mod base;
mod boolean;
mod combine;
mod contour;
mod grown;
mod hollow;
mod lend;
mod operation;
mod polygons;
mod round;
mod shell;
mod solid;
mod thicken;
mod volume;

pub use base::BaseError;
pub use boolean::Boolean;
pub use combine::{BooleanError, boolean};
pub use hollow::{Hollow, HollowError, Outlet, hollow};
pub use operation::Operation;
pub use round::RoundError;
pub use shell::{Shell, ShellError, Side, shell};
pub use solid::{Base, Holes, Solid, SolidError, SolidMesh, solid};
pub use thicken::ThickenError;

/// Nodes that make solids: what a printer can make.
pub static PACK: Pack = Pack {
    name: "solid",
    version: env!("CARGO_PKG_VERSION"),
    build: maquette_node::this_build!(),
    nodes: &[node::<Solid>(), node::<Shell>(), node::<Hollow>(), node::<Boolean>()],
    ..Pack::EMPTY
};
