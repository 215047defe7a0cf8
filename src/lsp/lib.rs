//! The language server, and the manual of the graph language.
//!
//! `position` converts the columns and URIs of the editor to byte offsets and paths, and back. `scope` finds the names that a text
//! declares. `expected_syntax` determines what may be written at a position. `project` finds names in all files of a project. `checker` is
//! the thread that publishes diagnostics. [`manual`] has one text per topic, for `maquette help` and `docs/language.md`.
//!
//! `transport` reads and writes messages. `process` notices when the editor ends, and `watcher` when files change on which documents
//! depend.
//!
//! Read `server.rs` first, then `answers.rs`. The Language Server Protocol is used only in this crate; edits are computed by
//! `maquette-edit`.

#![allow(missing_docs, reason = "what others may use is documented where `maquette` hands it on")]

pub mod manual;

mod actions;
mod answers;
mod capabilities;
mod checker;
mod commands;
mod completion;
mod expected_syntax;
mod hover;
mod last_run;
mod library;
mod missing;
mod outline;
mod params;
mod position;
mod process;
mod project;
mod refactor;
mod scope;
mod selection;
mod server;
mod signature;
mod symbols;
mod transport;
mod watcher;

pub use commands::PARENT;
use params::RequestError;
#[cfg(unix)]
pub use process::has_ended;
pub use server::{
    ClientCapabilities, Document, LOOKUP_INTERVAL, Server, Settings, Subject, is_in_project,
    is_new, is_ours,
};
pub use server::{Setup, serve};
pub use transport::{Threads, stdio};
