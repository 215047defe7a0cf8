//! The commands of `maquette`. A program can be built with any set of node packs.
//!
//! [`main`] runs the program. Each command has its own file. `tasks` runs the tasks of a batch and stores their records. `listen` watches
//! files for `maquette watch`. `serve` implements the protocol for host programs in other languages (`docs/serve.md`).
//!
//! Read `program.rs` first, then `run.rs`. To add a command, add a file and a line in `commands!`. This crate contains arguments, options,
//! progress and printing. The work of the commands is done by other crates.

mod batch;
mod cache;
mod cache_options;
mod check;
#[cfg(target_os = "linux")]
mod closed_stdout;
mod compare;
mod completions;
mod condition;
mod diff;
mod draw;
mod edit;
mod events;
mod files;
mod fmt;
mod help;
mod inputs;
mod inspect;
mod interrupt;
mod listen;
mod lock;
mod lsp;
mod merge;
mod new;
mod nodes;
mod openjd;
mod options;
mod output;
mod parent;
mod pin;
mod preflight;
mod profile;
mod program;
mod progress;
mod renamed_commands;
mod render;
mod replay;
mod run;
mod serve;
mod tasks;
mod terminal;
mod test;
mod viewpoint;
mod watch;
mod why;

pub(crate) use condition::Condition;
pub(crate) use options::{EvaluationOptions, GraphOptions, parse_assignment};
pub(crate) use output::{
    DisplayPath, Exit, all_outputs, column_width, count_severity, eprint, format_count, has_errors,
    in_bytes, print, print_as_it_is, print_document, print_json, print_usage, program,
    put_problems, report, shows_color, stdout_is_closed,
};
pub(crate) use program::Cli;
pub use program::{main, run};
