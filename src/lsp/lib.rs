//! The language server, and the language documented.
//!
//! `place` translates between an editor's columns and URIs and places in a text; `scope` and `slot` say what a text declares and what may stand at a place of it, by schemas and the
//! language's words; `project` finds names through all files; `checker` is the thread that publishes problems. [`language`] has one text a
//! topic, for `maquette help` and `docs/language.md`.
//!
//! `transport` reads and writes messages; `process` and `watcher` look at the editor's process and at files.
//!
//! Begin reading in `server.rs`, then `answers.rs`. Only this crate knows the protocol of editors; what it changes, `maquette-edit` does.

#![allow(missing_docs, reason = "what others may use is documented where `maquette` hands it on")]

pub mod language;

mod actions;
mod answers;
mod capabilities;
mod checker;
mod commands;
mod completion;
mod hover;
mod last;
mod library;
mod missing;
mod outline;
mod params;
mod place;
mod process;
mod project;
mod refactor;
mod scope;
mod selection;
mod server;
mod signature;
mod slot;
mod symbols;
mod transport;
mod watcher;

pub use commands::PARENT;
use params::Refused;
#[cfg(unix)]
pub use process::has_ended;
pub use server::{
    Choices, Client, Document, FRESH, Server, Subject, is_in_project, is_new, is_ours,
};
pub use server::{Setup, serve};
pub use transport::{Threads, stdio};
