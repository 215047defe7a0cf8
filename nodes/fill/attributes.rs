//! The attributes and colors of filled vertices and faces.

pub(super) mod carry;
pub(super) mod colors;
