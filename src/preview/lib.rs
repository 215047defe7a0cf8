//! The live page of a watch: what browsers are sent, and what they ask.
//!
//! `server` says who may ask, and serves files, sockets, pictures and columns; `shown` makes a value columns of bytes; `news` is what
//! happens, for pages that are slow, too; `pick` is what a ray through the pointer meets; `kept` keeps the link from one watch to the
//! next. The page itself is in `web/`: plain modules without anything to build.
//!
//! Begin reading in `page.rs`, then `server.rs`. This crate does not evaluate: it shows what a watch has.
//!
//! The page has the lamps and the camera of `render` once more, in WebGL, and the tests of the page compare both pixel by pixel. Flat
//! pictures are drawn on the picture that they were made from, so that every value can be enlarged, wiped and pinned. Traces are the page's
//! own plots. Without WebGL `render` makes the pictures. The lens is that of `--view YAW,PITCH,ZOOM`: moving nearer enlarges.

#![allow(missing_docs, reason = "what others may use is documented where `maquette` hands it on")]

pub mod probe;

mod kept;
mod location;
mod locks;
mod news;
mod page;
mod pick;
mod server;
mod shown;

pub use kept::Redirect;
pub use location::Location;
pub use locks::unpoisoned;
pub use page::{About, Feed, KEPT, MOST_KEPT, Question, Shared, Values, bind};
pub use page::{Page, Viewed, Views, Wish};
pub use shown::Shown;
