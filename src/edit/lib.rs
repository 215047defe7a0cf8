//! Edits of graph texts that keep the author's formatting.
//!
//! [`edit`](edit()) applies single [`Edit`]s of values, nodes, names, links and outputs. [`format_text`] and [`minimal`](minimal()) rewrite
//! a text in the canonical form. [`extract`](extract()) moves nodes to a new graph file, and [`inline`](inline()) moves them back; both are
//! based on `relocate`. [`merge`](merge()) merges the edits of two people. [`apply_fixes`] applies suggested fixes. Parts of a text that an
//! edit does not mention are kept byte by byte. Every edited text is checked again.
//!
//! Start reading in `edit.rs`, then `structure.rs`.
//!
//! This crate does not evaluate graphs and does not draw diagrams.

#![allow(missing_docs, reason = "what others may use is documented where `maquette` hands it on")]

mod default_value;
mod edit;
mod extract;
mod fix;
mod format;
mod inline;
mod merge;
mod minimal;
mod names;
mod patch_values;
mod references;
mod relocate;
mod structure;

pub use edit::{Edit, EditedText, ValueChange, edit, set_values};
pub(crate) use edit::{Editor, rename_in};
pub use extract::{ExtractedGraph, Extraction, extract};
pub use fix::apply_fixes;
pub use format::format_text;
pub use inline::inline;
/// Parses a text and prints its syntax tree. The result has the same bytes, even if the text has syntax errors.
pub use maquette_syntax::reprint;
pub use merge::{Merge, merge};
pub use minimal::minimal;
pub use names::{
    FileNames, NameOccurrence, Symbol, SymbolSort, names_in, names_in_sweep, names_in_test,
    resolve_path,
};
pub use references::{Reference, ReferenceKind, References};
pub(crate) use structure::check_name;
