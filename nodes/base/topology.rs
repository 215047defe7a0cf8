//! Connectivity: disjoint sets, and lists of neighbors in one piece of memory.

pub mod lists;
pub mod union_find;
