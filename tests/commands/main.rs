//! The program as its users see it: the results, output and files of its commands.

mod at_once;
mod batch;
mod builds;
mod cache_folder;
mod command_names;
mod doctor;
mod faults;
mod graph_runs;
mod handover;
mod language;
mod lsp;
mod missing_files;
mod nothing_is_lost;
mod pictures;
mod preflight;
mod read_only;
mod readme;
mod real_scans;
mod remote;
mod reuse;
mod scenarios;
mod sequences;
mod serve;
mod shards;
mod stdout;
mod telling;
mod watch;
mod watch_changes;

#[path = "../common/beside.rs"]
mod beside;
mod editors;
#[path = "../common/output.rs"]
mod output;
#[path = "../common/project.rs"]
#[allow(dead_code, reason = "some of it is for the tests of the live page")]
mod project;
#[path = "../common/thorough.rs"]
mod thorough;
