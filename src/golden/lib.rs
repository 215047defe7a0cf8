//! Tests of graphs. The outputs of a graph are compared with goldens: outputs that were accepted earlier.
//!
//! [`parts`] turns a value into columns of numbers. [`mod@compare`] compares these columns, and [`store`] writes and reads them. [`case`]
//! reads test files. [`suite`] runs the tests of many graphs, each in its own session. [`sweep`] reads the files of batches, which run one
//! graph for many scans and values. [`conformance`] checks the laws that every pack (plug-in) must obey.
//!
//! Read `suite.rs` first, then `case.rs`, `store.rs` and `compare.rs`. A golden contains the value of an output, not a copy of the output's
//! file.
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
