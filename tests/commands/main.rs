//! The program as its users see it: the results, output and files of its commands.

mod all_mistakes;
mod at_once;
mod batch;
mod batch_reports;
mod blessing;
mod builds;
mod cache_folder;
mod command_line;
mod command_names;
mod compare;
mod doctor;
mod faults;
mod forecasts;
mod handover;
mod kept_failures;
mod language;
mod lsp;
mod missing_files;
mod moves;
mod new;
mod nothing_is_lost;
mod pictures;
mod program;
mod read_only;
mod readme;
mod real_scans;
mod remote;
mod replaying;
mod reuse;
mod sequences;
mod serve;
mod shards;
mod shared_graphs;
mod sheet;
mod stdout;
mod telling;
mod text_commands;
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
