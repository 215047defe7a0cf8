//! Evaluates graphs: each step once, from a cache where it can, and writes what came of it.
//!
//! [`Session`](session::Session) is the one way to run a graph, for every host and every command. Beneath it, [`eval`] plans what changed,
//! runs nodes in order and keeps results in memory and on disk; [`expect`] judges what graphs expect of values; and [`writing`] is the
//! only place that writes, replaces and deletes files.
//!
//! Begin reading in `session.rs`, then `eval.rs`, `eval/plan.rs` and `eval/run.rs`.
//!
//! This crate knows no file format, no test and no command: those are given to it, or stand above it.

#![allow(missing_docs, reason = "what others may use is documented where `maquette` hands it on")]

pub mod distances;
pub mod eval;
pub mod expect;
mod looks;
mod printable;
pub mod session;
pub mod six;
pub mod writing;

pub use maquette_remote::Exchange;
pub use six::six;
