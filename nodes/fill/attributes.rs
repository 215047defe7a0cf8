//! What attributes and colors become over holes.

pub(super) mod carry;
pub(super) mod colors;
