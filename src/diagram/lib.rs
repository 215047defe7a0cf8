//! Diagrams of graphs: boxes for nodes and output files, and links with their types.
//!
//! A [`Drawing`] is the content of a diagram without positions. `layout` computes the positions; [`to_svg`], DOT and JSON export the
//! drawing. An [`Outline`] lists the parts of a graph's text for editors, even if the text is invalid.
//!
//! Start reading in `drawing.rs`, then `layout.rs`. This crate does not evaluate graphs.

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
pub use rows::RowPositions;
