//! Files: what reads bytes into values, and what writes values to bytes.
//!
//! Readers are functions from bytes to a value or a typed error. They never panic, and never reserve more memory than a small
//! multiple of the bytes that are there, whatever a header promises. Writers are [`FileFormat`](maquette_node::FileFormat)s, readers
//! by ending [`FileReader`](maquette_node::FileReader)s; [`PACK`] lists them, one line for each type of values and kind of files.
//!
//! Begin reading in `lists.rs`, then `obj.rs` for a format of text and `ply.rs` for one of bytes. A new format is a file and its line
//! in [`FORMATS`] or [`READERS`].
//!
//! This crate knows no graph and no node, and draws no pictures.

pub mod abs;
pub mod camera;
pub mod decoder;
pub mod depth;
pub mod e57;
pub mod exif;
pub mod exr;
pub mod glb;
pub mod handles;
pub mod jpeg;
pub mod las;
pub mod obj;
pub mod pcd;
pub mod picture_file;
pub mod ply;
pub mod png;
pub mod ptx;
pub mod range_file;
pub mod stl;
pub mod tiff;
pub mod xyz;

#[cfg(test)]
mod chosen;
mod colors;
mod common;
mod corners;
mod fidelity;
mod finite;
#[cfg(test)]
mod hostile;
mod json;
mod left_out;
mod lists;
#[cfg(test)]
mod material_tests;
#[cfg(test)]
mod others;
mod picture_kind;
mod rows;
mod step;
mod surface;
mod three_mf;
mod upright;
mod zip;

pub use common::{At, TooFar};
pub(crate) use common::{
    BLOCK, MOST_NAMESPACES, check_mesh, check_single, coarse, coarse_mesh, excerpt,
    has_many_namespaces, most_memory, open, parse, real, words,
};
pub use lists::{FORMATS, PACK, READERS, read};
