//! Readers and writers of file formats.
//!
//! Readers are functions that convert bytes to a value or an error. They never panic, and never reserve more memory than a small
//! multiple of the file size, whatever a header states. Writers implement [`FileFormat`](maquette_node::FileFormat), and readers that are
//! chosen by extension implement [`FileReader`](maquette_node::FileReader). [`PACK`] lists both, one line for each pair of value type and
//! format.
//!
//! To read the code, start with `formats.rs`, then `obj.rs` for a text format and `ply.rs` for a binary one. To add a format, add a new
//! file and a line in [`FORMATS`] or [`READERS`].
//!
//! This crate does not depend on graphs or nodes, and does not render pictures.

pub mod abs;
pub mod camera;
mod decoder;
pub mod depth;
pub mod e57;
pub mod exif;
mod exr;
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
mod block_tests;
mod colors;
mod common;
mod corners;
mod fidelity;
mod finite;
mod formats;
#[cfg(test)]
mod hostile;
mod json;
mod losses;
#[cfg(test)]
mod material_tests;
mod picture_kind;
#[cfg(test)]
mod reader_choice;
mod rows;
mod size;
mod step;
mod surface;
#[cfg(test)]
mod third_party_files;
mod three_mf;
mod upright;
mod zip;

pub use common::data_uri;
pub(crate) use common::{
    BLOCK, FilePosition, MAX_NAMESPACES, check_mesh, check_single, count_error, excerpt,
    has_many_namespaces, max_memory, mesh_precision_note, not_a_number, open_mesh_note, parse,
    parse_real, precision_note, unjoined_note, words,
};
pub use formats::{FORMATS, PACK, READERS, read};
pub(crate) use size::SizeReader;
