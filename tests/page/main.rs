//! The live page: its server as other programs see it, and its user interface in a real browser.
//!
//! These tests are not part of `cargo test`, because the browser draws without a graphics card, which is slow. `.ci/run` tests the server
//! and a few interactions, and `just nightly page` tests everything.
//!
//! The tests in the browser would take half of the time of the tests of commands. A run of all tests takes 573 s without them and with only
//! a part of the random cases (`TESTS=all` runs all cases), instead of 973 s.

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
mod visible_page;
