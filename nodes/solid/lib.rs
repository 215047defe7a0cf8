//! Nodes that make solids: what a printer can make.

use maquette::Pack;

mod boolean;
mod boxes;
mod combine;
mod crossings;
mod hollow;
mod lend;
mod operation;
mod polygons;
mod solid;
mod volume;

pub use boolean::Boolean;
pub use combine::{BooleanError, boolean};
pub use hollow::{Hollow, HollowError, Outlet, hollow};
pub use operation::Operation;
pub use solid::{Base, Holes, Solid, SolidError, solid};

maquette::nodes_of_this_build!();

/// Nodes that make solids: what a printer can make.
pub static PACK: Pack = Pack {
    name: "solid",
    nodes: &[node::<Solid>(), node::<Hollow>(), node::<Boolean>()],
    values: &[],
    formats: &[],
    readers: &[],
    migrations: &[],
    recipes: &[],
};
