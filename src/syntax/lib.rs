//! The text of graphs: RON as a tree with the place of every value, and problems that show their lines.
//!
//! [`parse`] makes a [`Tree`] of a text; [`Walk`] checks a tree against a JSON schema and finds every problem at its place;
//! [`read_tree`] gives a node its fields by serde. [`error`] says what went wrong and where, [`telling`] prints it with the lines
//! that it is about, and [`paths`] says what a graph may read and write.
//!
//! Begin reading in `tree.rs`, then `tree_reader.rs` (from text to tree; with `file.rs` the only place that knows the parser) and
//! `schema.rs`.
//!
//! This crate knows values, but no node, no graph and no command.

#![allow(missing_docs, reason = "what others may use is documented where `maquette` hands it on")]

pub mod error;
pub mod paths;
pub mod telling;

mod brackets;
mod commas;
pub mod cursor;
mod doubts;
mod ends;
mod expected;
mod file;
mod help;
mod hyphens;
mod marks;
#[cfg(test)]
mod peer;
mod phrases;
mod problems;
mod reader;
mod recovery;
mod repair;
pub mod ron;
mod schema;
mod sheet;
pub mod shell;
pub mod spelling;
mod steps;
mod suggest;
mod tree;
mod tree_reader;
pub mod twice;
mod unit;

pub use commas::{commas_behind, with_commas_behind};
pub use cursor::{Cursor, Frame, Passed, TypedKind, cursor, each_word};
pub use doubts::{Doubts, ReadText};
pub use ends::Ends;
pub use error::{Cancelled, Error, Place, Problem, Severity, Source, Span, code};
pub use expected::Expected;
pub use file::{DEEPEST, Mistake, Token, first_word, parse, printed, tokens};
pub use help::Help;
pub use marks::{CONFLICT, conflict_line, conflict_of};
pub use phrases::{any_of, with_article};
pub use problems::syntax_problems;
pub use reader::Reader;
pub use reader::{FILE, LINK, ReadError, Slots, read_tree};
pub use ron::{quoted, ron};
pub use schema::{Finding, FoundFile, FoundLink, Walk, as_tree, check_default};
pub use sheet::{Sheet, TextPart};
pub use shell::shell;
pub use steps::{inside, inside_option, merged, resolve, variants};
pub use suggest::{LOOKS, nearest, nearest_or_all, unknown};
pub use tree::{Body, Field, Given, Kind, Name, Origin, Tree, cut};
pub use twice::{fields_twice, one_file_twice, twice};
pub use unit::{Quantity, Unit, unit_names};
