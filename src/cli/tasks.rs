//! Batches: runs the tasks of a sweep on this machine or on a render farm, and stores a record of each task.
//!
//! A session runs the tasks, computes shared parts once, and writes a record of each task ([`record`], [`run`]). The contact sheet is
//! generated only from records ([`sheet`]). On a farm, each task is one call of this program ([`emit`]). The call receives the hash of the
//! list of tasks, which must match the sweep ([`task_list`]), and writes a log ([`log`]).

mod emit;
mod executor;
mod generated_sweep;
mod job_parameters;
mod log;
mod record;
mod run;
mod sheet;
mod task_list;
mod time_limit;

pub(crate) use emit::{Engine, Handover, Resources};
pub(crate) use executor::{ExecutionOptions, FinishedTask, TaskObserver, job_count};
pub(crate) use generated_sweep::generate_sweep;
pub(crate) use job_parameters::JobParameter;
pub(crate) use record::{Record, State, text_field};
pub(crate) use run::{Batch, TaskStatus, default_folder};
pub(crate) use task_list::{HASH_DIGITS, never_handed_over_message};
pub(crate) use time_limit::{format_time, parse_time};
