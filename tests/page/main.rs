//! The live page: its server as programs meet it, and what people see and do in a real browser.
//!
//! Not asked by `cargo test`, because a browser draws without a graphics card here: `.ci/run` asks the server and a few of the page,
//! `just nightly page` all.
//!
//! The browser took half of the time of all tests of commands. Without it, and with a part of the random cases (all with `TESTS=all`), a
//! run of all tests takes 573 s instead of 973 s.

mod canvas;
mod drafts;
mod hands;
mod page;
mod preview;
mod promises;

mod browser;
#[path = "../common/project.rs"]
#[allow(dead_code, reason = "some of it is for the tests of commands")]
mod project;
mod seen;
