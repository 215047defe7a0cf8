//! The program as its users see it: what its commands do, say and write.

mod at_once;
mod batch;
mod blessing;
mod builds;
mod canvas;
mod command_line;
mod doctor;
mod faults;
mod handover;
mod hands;
mod language;
mod lsp;
mod moves;
mod new;
mod nothing_is_lost;
mod page;
mod pictures;
mod preview;
mod real_scans;
mod remote;
mod reuse;
mod sequences;
mod serve;
mod shared_graphs;
mod sheet;
mod telling;
mod text_commands;
mod watch;

#[path = "../common/beside.rs"]
mod beside;
mod browser;
mod editors;
mod project;
mod seen;
