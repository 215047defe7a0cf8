//! Connectivity: disjoint sets, lists of neighbors in contiguous memory, and faces without area.

pub mod flat_faces;
pub mod lists;
pub mod union_find;
