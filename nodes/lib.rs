//! The built-in node packs of maquette, each a crate of its own that is written with maquette's public API alone.

use maquette_node::Pack;
pub use {
    maquette_align as align, maquette_clean as clean, maquette_color as color,
    maquette_deform as deform, maquette_fill as fill, maquette_image as image,
    maquette_mesh as mesh, maquette_nurbs as nurbs, maquette_range as range, maquette_scan as scan,
    maquette_solid as solid, maquette_subdivision as subdivision,
};

/// All built-in packs, those of files first, then those of nodes in pipeline order.
pub static PACKS: &[&Pack] = &[
    &maquette_format::PACK,
    &maquette_render::PACK,
    &image::PACK,
    &range::PACK,
    &nurbs::PACK,
    &subdivision::PACK,
    &deform::PACK,
    &fill::PACK,
    &mesh::PACK,
    &scan::PACK,
    &align::PACK,
    &solid::PACK,
    &clean::PACK,
    &color::PACK,
];
