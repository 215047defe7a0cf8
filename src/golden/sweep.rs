//! Sweeps: files that describe many runs of one graph, with different scans and values.
//!
//! A `Sweep(..)` lists the values that differ between its runs, the tasks ([`mod@file`], [`axis`], [`pattern`]). It also determines the
//! names of the tasks ([`names`]).

pub mod axis;
pub mod file;
pub mod files;
pub mod names;
pub mod pattern;
mod table;

pub use file::{EXTENSION, Picture, Sweep, Task, read_text, read_without_trying, schema, words};
