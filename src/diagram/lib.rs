//! Graphs as pictures: boxes for nodes and output files, links with the types that they carry.
//!
//! A [`Drawing`] is what is drawn, without places; `layout` gives it places, and [`to_svg`], DOT and JSON print it. An [`Outline`] is
//! what an editor lists of a text, however broken it is.
//!
//! Begin reading in `drawing.rs`, then `layout.rs`. This crate evaluates nothing.

#![allow(missing_docs, reason = "what others may use is documented where `maquette` hands it on")]

mod dot;
mod drawing;
mod json;
mod layout;
mod outline;
mod rows;
mod svg;

pub use drawing::{Block, BoxContent, Drawing, NodeBlock, Pack, Port, Wire, to_svg};
pub use outline::{Node as OutlineNode, Outline, Target, outline};
pub use rows::Places;
