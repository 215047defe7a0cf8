//! Sweeps: one graph over many scans and many values.
//!
//! A `Sweep(..)` says what differs from task to task ([`mod@file`], [`axis`], [`pattern`]) and what each is called ([`names`]).

pub mod axis;
pub mod file;
pub mod files;
pub mod names;
pub mod pattern;
mod table;

pub use file::{ENDING, Picture, Sweep, Task, read_text, read_untried, schema, words};
