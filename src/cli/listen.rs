//! What has to be known to run a graph again when something that it depends on changes.
//!
//! [`WatchList`] says which places of the file system matter, [`Sources`] tell when something happens there, [`Contents`] whether
//! it changed what a file holds, [`Batch`] when to react, and [`Series`] when others may see what came of it. The order is always: watch, then read. So a change between the two
//! is reported once too often rather than never.

mod backend;
mod batch;
mod contents;
mod list;
mod series;
mod sources;

pub(crate) use backend::Event;
pub(crate) use batch::Batch;
pub(crate) use contents::Contents;
pub(crate) use list::{WatchList, Wish};
pub(crate) use series::Series;
pub(crate) use sources::Sources;
