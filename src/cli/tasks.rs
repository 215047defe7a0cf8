//! Batches: the tasks of a sweep, run one by one or handed to engines, and the records that they leave.
//!
//! Each task is run by one session, which computes once what tasks have in common, and leaves a record ([`record`], [`run`]); a contact
//! sheet is made of records alone ([`sheet`]), whoever wrote them: this program or a farm's, which starts it a task at a time ([`emit`]),
//! from a list of tasks that must still be that of the sweep ([`task_list`]). Such a task has a log ([`log`]).

mod all;
mod emit;
mod job_parameters;
mod log;
mod record;
mod run;
mod sheet;
mod short;
mod task_list;
mod time_limit;

pub(crate) use all::{Ended, Hearer, Running, at_a_time};
pub(crate) use emit::{Engine, Handover, Resources};
pub(crate) use job_parameters::JobParameter;
pub(crate) use record::{Output, Record, State};
pub(crate) use run::{Batch, Standing, default_folder};
pub(crate) use short::text_of;
pub(crate) use task_list::{DIGITS, never_handed_over_in_words};
pub(crate) use time_limit::{in_words, time};
