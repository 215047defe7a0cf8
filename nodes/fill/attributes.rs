//! Attributes and colors for the vertices and faces that fill a hole.

pub(super) mod carry;
pub(super) mod colors;
