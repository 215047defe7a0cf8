//! What hangs together: sets that are joined, and what lies at what.

pub(crate) mod lists;
pub(crate) mod union_find;
