//! The border of a mesh: its rims (boundary loops), which of them are holes, and the data around these.

pub(super) mod clashes;
pub(super) mod holes;
pub(super) mod regions;
pub(super) mod rim;
pub(super) mod rims;
