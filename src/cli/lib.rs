//! The commands of `maquette`, for a program with any packs.
//!
//! [`main`] is the program; one file has each subcommand. `tasks` runs the tasks of a batch and keeps their records; `listen` is what a
//! watch listens to; `serve` is the protocol for hosts in other languages (`docs/serve.md`).
//!
//! Begin reading in `program.rs`, then `run.rs`; a command is a file and a line in `commands!`. What a command does, the crates below do: here
//! stand words, options, progress and what is printed.

mod batch;
mod cache;
mod caching;
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
mod extract;
mod files;
mod fmt;
mod gallery;
mod help;
mod inline;
mod inputs;
mod inspect;
mod interrupt;
mod listen;
mod lock;
mod look;
mod lsp;
mod merge;
mod migrate;
mod new;
mod nodes;
mod openjd;
mod options;
mod output;
mod parent;
mod pin;
mod profile;
mod program;
mod progress;
mod render;
mod replay;
mod run;
mod serve;
mod set;
mod sheet;
mod tasks;
mod terminal;
mod test;
mod watch;
mod why;

pub(crate) use condition::Condition;
pub(crate) use options::{GraphOptions, assignment};
pub(crate) use output::{
    Exit, Shown, all_outputs, column_width, counted, eprint, in_bytes, print, print_as_it_is,
    print_document, print_json, print_usage, program, put_problems, report, shows_color,
    stdout_is_closed,
};
pub(crate) use program::Cli;
pub use program::{main, run};
