//! Connectivity: disjoint sets, and lists of neighbors in one piece of memory.

pub(crate) mod lists;
pub(crate) mod union_find;
