//! Connectivity: disjoint sets, and lists of neighbors in contiguous memory.

pub mod lists;
pub mod union_find;
