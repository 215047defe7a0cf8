//! What several packs stand on: sparse systems of equations, the topology of meshes, points by their places, and limits.

pub mod limits;
pub mod linear;
pub mod parameters;
pub mod scattered;
pub mod solid_angle;
pub mod topology;
pub mod tree;
pub mod unit;
