//! `maquette cache`: what is kept on disk, and how to be rid of it.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use serde_json::json;

use super::caching::{default_folder, disk_size, size};
use super::{Exit, counted, in_bytes, print, print_json};
use crate::eval::Disk;

#[derive(Args)]
pub(super) struct Cache {
    #[command(subcommand)]
    action: Action,
    /// The folder [default: $MAQUETTE_CACHE, or `maquette` in the system's folder for caches].
    #[arg(long = "cache", value_name = "DIR", global = true)]
    folder: Option<PathBuf>,
}

#[derive(Subcommand)]
enum Action {
    /// Print where the cache is and what it holds.
    Ls {
        /// Print one JSON document.
        #[arg(long)]
        json: bool,
    },
    /// Drop what was not used for longest, until no more than a limit is left.
    Gc {
        /// The limit, as 500MB or 2GB [default: $MAQUETTE_CACHE_SIZE, or 4GB].
        #[arg(long, value_name = "SIZE", value_parser = size)]
        limit: Option<u64>,
    },
    /// Drop everything.
    Clear,
}

impl Cache {
    pub(super) fn run(&self) -> Exit {
        let Some(folder) = self.folder.clone().or_else(default_folder) else {
            return Exit::Usage(
                "this system has no folder for caches: name one with --cache".into(),
            );
        };
        let bytes = |bytes: u64| in_bytes(usize::try_from(bytes).unwrap_or(usize::MAX));
        match &self.action {
            Action::Ls { json } => {
                let usage = Disk::usage(&folder);
                if *json {
                    print_json(&json!({
                        "folder": folder.display().to_string(),
                        "programs": usage.programs,
                        "results": usage.entries,
                        "columns": usage.columns,
                        "graphs": usage.graphs,
                        "bytes": usage.bytes,
                    }));
                    return Exit::Done;
                }
                print(&format!(
                    "{}\n{} of {}, {}, {}: {}\n",
                    folder.display(),
                    counted(usage.entries, "result"),
                    counted(usage.programs, "build"),
                    counted(usage.columns, "large column"),
                    counted(usage.graphs, "graph"),
                    bytes(usage.bytes)
                ));
                Exit::Done
            }
            Action::Gc { limit } => {
                let limit = match limit.map_or_else(disk_size, Ok) {
                    Ok(limit) => limit,
                    Err(why) => return Exit::Usage(why),
                };
                print(&format!("dropped {}\n", bytes(Disk::gc(&folder, limit))));
                Exit::Done
            }
            Action::Clear => match Disk::clear(&folder) {
                Ok(dropped) => {
                    print(&format!("dropped {}\n", bytes(dropped)));
                    Exit::Done
                }
                Err(error) => Exit::Usage(error.to_string()),
            },
        }
    }
}
