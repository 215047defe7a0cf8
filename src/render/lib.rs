//! One picture of a value, in software: for goldens, `inspect`, `render` and documents.
//!
//! What a value shows is either a picture of its own, which may lie on another one (`flat`), or lies in space, where a camera sees its
//! faces, lines, points and arrows together.
//!
//! Guaranteed: the same bytes on every machine and for any number of threads; no cracks between faces that share an edge.
//! The picture is made in bands of rows that know nothing of each other. In each band every face is first drawn into a
//! buffer that remembers the nearest face of each *sample*, of which a pixel has 3 x 3; then each pixel is shaded once for
//! every face that it shows.
//!
//! Polygons are drawn as the triangles that [`Mesh::face_triangles`](maquette_value::Mesh::face_triangles) cuts them into.
//!
//! Begin reading in `view.rs`, then `scene.rs` and `raster.rs`; `shapes.rs` prepares the same for a graphics card. This crate knows
//! values and formats of pictures, but no graph.

#![allow(missing_docs, reason = "what others may use is documented where `maquette` hands it on")]

mod camera;
mod draw;
mod flat;
mod light;
mod picture;
mod raster;
mod sampling;
mod scene;
mod shapes;
mod solid;
#[cfg(test)]
mod tests;
mod view;

pub(crate) use draw::render_all;
pub use draw::{picture, render};
pub use flat::{Below, Ground, fitted, picture_of};
pub use picture::PACK;
pub(crate) use sampling::{BAND, SAMPLES, each, four, padded};
pub use shapes::{Field, Ruler, Shape, Shapes};
pub use solid::render_layers;
pub use view::{Aim, Kind, Look, Projection, View};
