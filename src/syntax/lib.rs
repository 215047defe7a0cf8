//! Reads the text of graph files: parses RON to a tree of values with positions, and renders diagnostics with the source lines.
//!
//! [`parse`] parses a text to a [`Tree`]. [`Walk`] checks a tree against a JSON schema and reports every error at its position.
//! [`read_tree`] deserializes a tree with serde. [`error`] defines errors and diagnostics, [`diagnostics`] renders diagnostics with source
//! lines, and [`paths`] decides which files a graph may read and write.
//!
//! Start reading in `tree.rs`, then `tree_reader.rs` (text to tree) and `schema.rs`. Only `parser.rs` and `tree_reader.rs` use the parser
//! library.
//!
//! This crate depends on the crate of values, but not on those of nodes, graphs and commands.

#![allow(missing_docs, reason = "what others may use is documented where `maquette` hands it on")]

pub mod diagnostics;
pub mod error;
pub mod paths;

mod brackets;
mod commas;
mod conflict_markers;
pub mod cursor;
pub mod duplicates;
mod expected_value;
mod help;
mod hyphens;
mod line_endings;
mod local_diagnostic;
mod parser;
mod phrases;
mod plain_data;
mod reader;
mod recovery;
mod repair;
pub mod ron;
#[cfg(test)]
mod ron_oracle;
mod schema;
mod schema_path;
pub mod shell;
mod source_map;
pub mod spelling;
mod suggest;
mod syntax_diagnostics;
mod tree;
mod tree_reader;
mod uncertain_parts;
mod unit;

pub use commas::{edit_with_trailing_commas, with_trailing_commas};
pub use conflict_markers::{CONFLICT_MESSAGE, conflict_diagnostic, conflict_line};
pub use cursor::{Cursor, Frame, TypedKind, WalkEvent, cursor, for_each_word};
pub use duplicates::{duplicate_fields, duplicate_files, duplicate_keys};
pub use error::{CancelledError, Diagnostic, Error, Position, Severity, Source, Span, code};
pub use expected_value::ExpectedValue;
pub use help::Help;
pub use line_endings::LineEnding;
pub use local_diagnostic::LocalDiagnostic;
pub use parser::{MAX_DEPTH, SyntaxError, Token, first_word, parse, reprint, tokens};
pub use phrases::{any_of, with_article};
pub use plain_data::{format_plain_data, parse_plain_data};
pub use reader::Reader;
pub use reader::{FILE, InputSlots, LINK, ReadError, read_tree};
pub use ron::{quote, to_ron};
pub use schema::{FoundFile, FoundLink, Walk, as_tree, check_default};
pub use schema_path::{merge_references, option_inner, resolve, resolve_field, variants};
pub use shell::quote_for_shell;
pub use source_map::{SourceMap, TextPart};
pub use suggest::{COMPARISONS, nearest, nearest_or_all, unknown_name_message};
pub use syntax_diagnostics::syntax_diagnostics;
pub use tree::{Body, ExternalOrigin, Field, Kind, Name, Origin, Tree, truncate};
pub use uncertain_parts::{ReadText, UncertainParts};
pub use unit::{Quantity, Unit, unit_names};
