//! Tests of graphs: whether their outputs are still those that somebody has accepted.

pub(crate) mod case;
pub(crate) mod compare;
mod expect;
mod looks;
pub(crate) mod parts;
mod printable;
mod sketch;
mod sound;
pub(crate) mod store;

#[cfg(feature = "cli")]
pub(crate) use case::test_schema;
#[cfg(any(test, feature = "cli"))]
pub(crate) use case::words;
pub(crate) use compare::six;
pub use compare::{Comparison, Keep, Measure, Tolerance, Verdict, compare};
pub(crate) use expect::{Violation, nodes_of, violations};
