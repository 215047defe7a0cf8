//! Segmentation: selection of pixels, and their connected components.

pub(super) mod components;
pub(super) mod mark_pixels;
pub(super) mod otsu;
pub(super) mod select;
