//! Batches: one graph over many scans and many values, as tasks that leave records.
//!
//! A `Sweep(..)` says what differs from task to task ([`mod@file`], [`axis`], [`pattern`]) and what each is called ([`names`]). Each task is run by
//! one session, which computes once what tasks have in common, and leaves a record ([`record`], [`run`]); a contact sheet is made of records
//! alone ([`sheet`]), whoever wrote them: this program or a farm's, which starts it a task at a time ([`emit`]), from a list of tasks that must
//! still be that of the sweep ([`task_list`]).

mod all;
mod axis;
mod emit;
mod file;
mod files;
mod names;
mod pattern;
mod record;
mod run;
mod sheet;
mod short;
mod task_list;

pub(crate) use all::{Ended, Hearer, Running, at_a_time};
pub(crate) use emit::{Engine, Handover};
#[cfg(test)]
pub(crate) use file::words;
pub(crate) use file::{ENDING, Picture, Sweep, Task, read_text, read_untried, schema};
pub(crate) use record::{Output, State};
pub(crate) use run::{Batch, Standing, default_folder};
pub(crate) use short::text_of;
pub(crate) use task_list::{DIGITS, never_handed_over_in_words};
