//! Code shared by several packs: sparse linear systems, mesh topology, spatial search, and limits on sizes.

pub mod light;
pub mod limits;
pub mod linear;
pub mod parameters;
pub mod scattered;
pub mod solid_angle;
pub mod topology;
pub mod tree;
pub mod unit;
pub mod weld;
