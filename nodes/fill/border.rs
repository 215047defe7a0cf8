//! Where a mesh ends: its rims, which of them are holes, and what lies around these.

pub(super) mod clashes;
pub(super) mod holes;
pub(super) mod regions;
pub(super) mod rim;
pub(super) mod rims;
