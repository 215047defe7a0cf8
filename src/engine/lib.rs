//! Evaluates graphs and writes their outputs. A node is computed at most once for equal inputs. Later evaluations take the result from a
//! cache.
//!
//! Host programs and commands run graphs through [`Session`](session::Session). [`eval`] plans an evaluation, runs the nodes and keeps
//! results in memory and on disk. [`expect`] checks the expectations of graphs. [`writing`] is the only module that writes, replaces and
//! deletes files.
//!
//! Read `session.rs` first, then `eval.rs`, `eval/plan.rs` and `eval/run.rs`.
//!
//! This crate contains no file format, test runner or command. Callers provide the formats; tests and commands depend on this crate.

#![allow(
    missing_docs,
    reason = "public items are documented where the crate `maquette` re-exports them"
)]

mod defects;
pub mod digits;
pub mod distances;
pub mod eval;
pub mod expect;
mod printable;
pub mod session;
pub mod writing;

pub use digits::six_digits;
pub use maquette_remote::RequestCounts;
