//! Renders values as pictures in software, for test references (goldens), `inspect`, `render` and documents.
//!
//! A value is shown in one of two ways: as a flat picture, possibly on top of another picture (`flat`); or in 3D space, where a camera sees
//! its faces, lines, points and arrows together.
//!
//! Two properties are guaranteed. The bytes of a picture are the same on every machine and for any number of threads. There are no cracks
//! between faces that share an edge. The picture is made in independent bands of rows. In each band every face is first drawn into a buffer
//! that stores the nearest face of each *sample*; a pixel has 3 x 3 samples. Then each pixel is shaded once for every face that is visible
//! in it.
//!
//! Polygons are drawn as the triangles that [`Mesh::face_triangles`](maquette_value::Mesh::face_triangles) returns.
//!
//! Begin reading in `view.rs`, then `scene.rs` and `raster.rs`. `shapes.rs` prepares the same scene for a graphics card. This crate depends
//! on values and picture formats, but not on graphs.

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
pub use flat::{Backdrop, OwnedBackdrop, fit_picture, picture_layer};
pub use light::BackFaces;
pub use picture::PACK;
pub(crate) use sampling::{BAND, SAMPLES, array3, array4, pad};
pub use shapes::{Field, Normalization, Shape, Shapes};
pub use solid::render_layers;
pub use view::{Aim, Look, Projection, Representation, View};
