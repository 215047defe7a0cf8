//! `maquette cache`: shows, checks and cleans the results that are stored on disk.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};
use maquette_engine::eval::{CacheFault, Diagnosis, Disk, DiskError, NodeSize, Sizes, Usage};
use maquette_engine::session::{CacheServer, default_folder, disk_size, size};
use maquette_graph::catalog::Catalog;
use serde_json::{Value as Json, json};

use super::{Exit, column_width, eprint, format_count, in_bytes, print, print_json};
use crate::DisplayPath;

#[derive(Args)]
pub(crate) struct Cache {
    #[command(subcommand)]
    action: Action,
    /// The cache folder [default: $MAQUETTE_CACHE, or `maquette` in the system's folder for caches].
    #[arg(long = "cache", value_name = "DIR", global = true)]
    folder: Option<PathBuf>,
}

#[derive(Subcommand)]
enum Action {
    /// Print the folder, the contents and the size of the cache, and check that the cache server answers.
    Ls {
        /// The URL of the cache server [default: $MAQUETTE_CACHE_REMOTE].
        #[arg(long, value_name = "URL")]
        cache_remote: Option<String>,
        /// Print one JSON document.
        #[arg(long)]
        json: bool,
    },
    /// List the results by node and graph, the largest first.
    Du {
        /// Print one JSON document.
        #[arg(long)]
        json: bool,
    },
    /// Remove the least recently used results until the cache is smaller than a limit.
    Gc {
        /// The limit, as 500MB or 2GB [default: $MAQUETTE_CACHE_SIZE, or 4GB].
        #[arg(long, value_name = "SIZE", value_parser = size)]
        limit: Option<u64>,
    },
    /// Remove all results.
    Clear,
    /// Check every file of all builds, and remove those that are damaged, incomplete or useless. Fails if a fault could not be repaired.
    /// Foreign files are listed and stay.
    Doctor {
        /// List the faults; remove nothing.
        #[arg(long)]
        dry_run: bool,
        /// Print one JSON document.
        #[arg(long)]
        json: bool,
    },
}

impl Cache {
    pub(super) fn run(&self, _: &Catalog) -> Exit {
        let Some(folder) = self.folder.clone().or_else(default_folder) else {
            return Exit::Usage(
                "this system has no folder for caches; choose one with --cache".into(),
            );
        };
        self.action(&folder).unwrap_or_else(Exit::Usage)
    }

    fn action(&self, folder: &Path) -> Result<Exit, String> {
        fn disk_error(error: DiskError) -> String {
            error.to_string()
        }
        match &self.action {
            Action::Ls { cache_remote, json } => {
                let usage = Disk::usage(folder).map_err(disk_error)?;
                print_usage(folder, &usage, reach_server(cache_remote)?.as_ref(), *json);
            }
            Action::Du { json } => {
                print_sizes(folder, &Disk::sizes(folder).map_err(disk_error)?, *json);
            }
            Action::Gc { limit } => {
                let limit = limit.map_or_else(disk_size, Ok)?;
                return drop_down_to(folder, limit);
            }
            Action::Clear => return drop_down_to(folder, 0),
            Action::Doctor { dry_run, json } => {
                let diagnosis = Disk::doctor(folder, *dry_run).map_err(disk_error)?;
                print_diagnosis(folder, &diagnosis, *dry_run, *json);
                let is_well = diagnosis.faults.iter().all(|fault| fault.is_repaired);
                return Ok(if is_well { Exit::Done } else { Exit::Failed });
            }
        }
        Ok(Exit::Done)
    }
}

/// Removes the least recently used results until at most `limit` bytes are left.
fn drop_down_to(folder: &Path, limit: u64) -> Result<Exit, String> {
    match Disk::gc(folder, limit) {
        Ok(dropped) => {
            print(&format!("dropped {}\n", bytes(dropped)));
            Ok(Exit::Done)
        }
        Err(error @ DiskError::NotRemoved { .. }) => {
            let help = "make the folder writable, or choose another one with --cache";
            eprint(&format!("error: {error}\n  = help: {help}\n"));
            Ok(Exit::Failed)
        }
        Err(error) => Err(error.to_string()),
    }
}

/// The address of a cache server, and the result of a test connection.
type Server = (String, Result<(), String>);

/// Connects to the cache server that the option or the environment variable names. Returns `None` if there is none.
fn reach_server(named: &Option<String>) -> Result<Option<Server>, String> {
    let server = named.clone().map_or(CacheServer::Default, CacheServer::At);
    server
        .address()
        .map(|(named, address): (&str, String)| {
            Disk::check_server(&address).map_err(|why| format!("{named}: {why}"))
        })
        .transpose()
}

fn bytes(bytes: u64) -> String {
    in_bytes(usize::try_from(bytes).unwrap_or(usize::MAX))
}

fn print_usage(folder: &Path, usage: &Usage, server: Option<&Server>, json: bool) {
    if json {
        let server = server.map(|(address, answer)| {
            json!({ "address": address, "answers": answer.is_ok(), "why": answer.as_ref().err() })
        });
        return print_json(&json!({
            "folder": folder.display().to_string(),
            "programs": usage.programs,
            "results": usage.entries,
            "columns": usage.columns,
            "graphs": usage.graphs,
            "bytes": usage.bytes,
            "server": server,
        }));
    }
    print(&format!(
        "{}\n{} of {}, {}, {}: {}\n",
        folder.for_display(),
        format_count(usage.entries, "result"),
        format_count(usage.programs, "build"),
        format_count(usage.columns, "large column"),
        format_count(usage.graphs, "graph"),
        bytes(usage.bytes)
    ));
    if let Some((address, answer)) = server {
        let state = answer.as_ref().map_or_else(|why| &why[..], |()| "answers");
        print(&format!("{address}: {state}\n"));
    }
}

fn node_size_json(size: &NodeSize) -> Json {
    let graph = size.graph.as_ref().map(|graph| graph.display().to_string());
    json!({
        "graph": graph,
        "node": size.node,
        "type": size.kind,
        "results": size.results,
        "bytes": size.bytes,
    })
}

fn fault_json(fault: &CacheFault) -> Json {
    let path = fault.path.display().to_string();
    json!({ "path": path, "what": fault.description, "mended": fault.is_repaired })
}

fn print_sizes(folder: &Path, sizes: &Sizes, json: bool) {
    let results = sizes.nodes.iter().map(|size| size.results).sum::<usize>();
    let all = sizes.other + sizes.nodes.iter().map(|size| size.bytes).sum::<u64>();
    if json {
        return print_json(&json!({
            "folder": folder.display().to_string(),
            "nodes": sizes.nodes.iter().map(node_size_json).collect::<Vec<_>>(),
            "results": results,
            "other": sizes.other,
            "bytes": all,
        }));
    }
    let here = std::env::current_dir().unwrap_or_default();
    let rows = sizes.nodes.iter().map(|size| {
        let graph = size.graph.as_ref().map_or_else(
            || "-".to_owned(),
            |graph| graph.strip_prefix(&here).unwrap_or(graph).display().to_string(),
        );
        let kind = if size.kind.is_empty() { "-" } else { &size.kind };
        (bytes(size.bytes), graph, size.node.as_deref().unwrap_or("-"), kind)
    });
    let rows = Vec::from_iter(rows);
    let graphs = column_width(rows.iter().map(|(_, graph, ..)| graph.len()));
    let nodes = column_width(rows.iter().map(|(_, _, node, _)| node.len()));
    let mut text = String::new();
    for (bytes, graph, node, kind) in rows {
        let _ = writeln!(text, "{bytes:>9}  {graph:<graphs$}  {node:<nodes$}  {kind}");
    }
    if sizes.other > 0 {
        let _ = writeln!(text, "{:>9}  notes about graphs and outputs", bytes(sizes.other));
    }
    let _ = writeln!(text, "{:>9}  total, {}", bytes(all), format_count(results, "result"));
    print(&text);
}

fn print_diagnosis(folder: &Path, diagnosis: &Diagnosis, dry_run: bool, json: bool) {
    let Diagnosis { files, bytes: size, faults, foreign } = diagnosis;
    if json {
        return print_json(&json!({
            "folder": folder.display().to_string(),
            "files": files,
            "bytes": size,
            "faults": faults.iter().map(fault_json).collect::<Vec<_>>(),
            "foreign": foreign.iter().map(|path| path.display().to_string()).collect::<Vec<_>>(),
        }));
    }
    let mut text = String::new();
    for CacheFault { path, description: what, is_repaired: mended } in faults {
        let word = match (mended, dry_run) {
            (true, _) => "mended",
            (false, true) => "wrong ",
            (false, false) => "stays ",
        };
        let _ = writeln!(text, "{word}  {}: {what}", path.for_display());
    }
    for path in foreign {
        let _ = writeln!(text, "left    {}: foreign file", path.for_display());
    }
    let mended = faults.iter().filter(|fault| fault.is_repaired).count();
    let wrong = format_count(faults.len(), "fault");
    let (files, size) = (format_count(*files, "file"), bytes(*size));
    let _ = writeln!(text, "{}: {files}, {size}: {wrong}, {mended} mended", folder.for_display());
    print(&text);
}
