//! Watches the files on which a graph depends, and decides when to evaluate the graph again.
//!
//! [`WatchList`] lists the watched paths. [`Sources`] report events. [`Contents`] finds out which files have new contents. [`Batch`]
//! decides when to evaluate, and [`Series`] when to write outputs. The watch on a file always begins before the file is read. So a change
//! in between is reported twice rather than never.

mod backend;
mod batch;
mod contents;
mod list;
mod series;
mod sources;

pub(crate) use backend::Event;
pub(crate) use batch::Batch;
pub(crate) use contents::Contents;
pub(crate) use list::{WatchList, WatchRequest};
pub(crate) use series::Series;
pub(crate) use sources::Sources;
