//! The built-in node packs of maquette, written with its public API alone.

use maquette::Pack;

pub mod deform;
pub mod fill;
pub mod image;
pub mod mesh;
pub mod nurbs;
pub mod range;
pub mod subdivision;

mod limits;
mod linear;
mod topology;

/// All built-in packs, in pipeline order.
pub static PACKS: &[Pack] = &[
    image::PACK,
    range::PACK,
    nurbs::PACK,
    subdivision::PACK,
    deform::PACK,
    fill::PACK,
    mesh::PACK,
];
