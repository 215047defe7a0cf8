//! What several packs stand on: sparse systems of equations, the topology of meshes, and limits.

pub mod limits;
pub mod linear;
pub mod solid_angle;
pub mod topology;
