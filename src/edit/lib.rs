//! From text to text: graphs that are changed as their author would change them.
//!
//! [`edit`](edit()) makes single [`Edit`]s: values, nodes, names, links, outputs; [`formatted`] and [`minimal`](minimal()) bring a text into its form;
//! [`extract`](extract()) and [`inline`](inline()) make a graph of some nodes and bring them back, both on `moved`; [`merge`](merge()) joins the edits of two people;
//! [`fixed`] does what has one answer. What an edit does not speak of keeps every byte, and an edited text is checked again.
//!
//! Begin reading in `edit.rs`, then `structure.rs`.
//!
//! This crate evaluates nothing and draws nothing.

#![allow(missing_docs, reason = "what others may use is documented where `maquette` hands it on")]

mod edit;
mod extract;
mod fix;
mod format;
mod inline;
mod left_out;
mod merge;
mod minimal;
mod moved;
mod names;
mod part;
mod references;
mod structure;

pub use edit::{Edit, Edited, Put, edit, edited};
pub(crate) use edit::{Judge, renamed_in};
pub use extract::{Extracted, Extraction, extract};
pub use fix::fixed;
pub use format::formatted;
pub use inline::inline;
/// The text as its syntax tree prints it: the same bytes, however broken the text is.
pub use maquette_syntax::printed;
pub use merge::{Merge, merge};
pub use minimal::minimal;
pub use names::{
    Named, NamesOf, Symbol, SymbolSort, names_in, names_in_sweep, names_in_test, real,
};
pub use references::{Names, Reference, References};
pub(crate) use structure::may_name;
