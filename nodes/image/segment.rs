//! Segmentation: which pixels belong to what is searched for, and the connected components of these.

pub(super) mod components;
pub(super) mod mark_pixels;
pub(super) mod otsu;
pub(super) mod select;
