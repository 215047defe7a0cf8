//! Tests of graphs: compares the outputs of graphs with accepted outputs, the goldens.
//!
//! [`parts`] turns a value into columns of numbers, which [`mod@compare`] compares and [`store`] writes and reads. [`case`] reads test
//! files. [`suite`] runs the tests of many graphs, each in a session. [`sweep`] reads the files of batches, which run one graph for many
//! scans and values. [`conformance`] checks the laws that every pack must obey.
//!
//! Read `suite.rs` first, then `case.rs`, `store.rs` and `compare.rs`. A golden contains the value of an output, not the output's file.
//!
//! This crate contains no command and prints nothing.

#![allow(
    missing_docs,
    reason = "public items are documented where the crate `maquette` re-exports them"
)]

pub mod case;
pub mod compare;
pub mod conformance;
pub mod parts;
mod recover;
mod sketch;
pub mod store;
pub mod suite;
pub mod sweep;

pub use case::{test_schema, words};
pub use compare::{Comparison, Keep, Measure, Tolerance, Verdict, compare};
