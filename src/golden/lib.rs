//! Tests of graphs: whether their outputs are still those that somebody has accepted.
//!
//! [`parts`] takes the columns that a value tells of, which [`mod@compare`] measures and [`store`] keeps; [`case`] reads tests. [`suite`] runs
//! the tests of many graphs, each by a session, and [`sweep`] reads what a batch runs: one graph over many scans and values.
//! [`conformance`] has the laws that every pack keeps, as a function.
//!
//! Begin reading in `suite.rs`, then `case.rs`, `store.rs` and `compare.rs`. Goldens are of values, not of files.
//!
//! This crate knows no command, and prints nothing.

#![allow(missing_docs, reason = "what others may use is documented where `maquette` hands it on")]

pub mod case;
pub mod compare;
pub mod conformance;
pub mod parts;
mod sketch;
mod sound;
pub mod store;
pub mod suite;
pub mod sweep;

pub use case::{test_schema, words};
pub use compare::{Comparison, Keep, Measure, Tolerance, Verdict, compare};
