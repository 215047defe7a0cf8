//! The live page that a watch (`maquette watch`) shows in the browser: its server, and the page itself.
//!
//! `server` checks access and serves files, sockets, pictures and columns. `gpu_columns` converts a value to columns of bytes. `event_log`
//! keeps messages for pages until they have read them. `pick` finds the element under the pointer. `saved_address` keeps the URL from one
//! watch to the next. The page itself is in `web/`: JavaScript modules without a build step.
//!
//! Read `page.rs` first, then `server.rs`. This crate does not evaluate graphs: it shows the results that a watch has computed.
//!
//! The page implements the lights and the camera of `maquette render` in WebGL; tests compare the two pixel by pixel. A flat value, such as
//! a mask, is drawn on the picture from which it was computed. In the page, users can enlarge any value, compare it with another one by
//! wiping, and pin it. The page draws plots itself. Without WebGL, the server renders the pictures. The camera is that of the option
//! `--view YAW,PITCH,ZOOM`.

#![allow(missing_docs, reason = "what others may use is documented where `maquette` hands it on")]

pub mod pixel_probe;

mod event_log;
mod gpu_columns;
mod location;
mod locks;
mod page;
mod pick;
mod saved_address;
mod server;

pub use gpu_columns::ViewedValue;
pub use location::Location;
pub use locks::lock_ignoring_poison;
pub use page::{Feed, MAX_KEPT, MAX_KEPT_BYTES, PageState, Question, QuestionKind, Values, bind};
pub use page::{Page, PageRequest, ViewedOutput, Views};
pub use saved_address::Redirect;
