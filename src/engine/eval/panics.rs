//! Panics of code of packs.

use std::panic::{AssertUnwindSafe, catch_unwind};

use maquette_syntax::error::{Error, panic_message};

/// The error that code of a node or file format panicked. Such a panic is a bug in this program or in a pack.
#[derive(Clone, Debug, thiserror::Error)]
#[error("panicked: {0}")]
pub(super) struct Panic(String);

/// Runs code of a node or file format, and turns a panic of that code into an error.
pub(crate) fn catch_panic<T>(does: impl FnOnce() -> Result<T, Error>) -> Result<T, Error> {
    let done = catch_unwind(AssertUnwindSafe(does));
    done.unwrap_or_else(|panic| Err(Panic(panic_message(&*panic)).into()))
}
