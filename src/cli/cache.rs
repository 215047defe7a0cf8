//! `maquette cache`: what is kept on disk, and how to be rid of it.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};
use maquette_engine::eval::{Diagnosis, Disk, DiskError, Fault, NodeSize, Sizes, Usage};
use maquette_engine::session::{CacheServer, default_folder, disk_size, size};
use maquette_graph::catalog::Catalog;
use serde_json::json;

use super::{Exit, column_width, counted, eprint, in_bytes, print, print_json};
use crate::Shown;

#[derive(Args)]
pub(crate) struct Cache {
    #[command(subcommand)]
    action: Action,
    /// The folder [default: $MAQUETTE_CACHE, or `maquette` in the system's folder for caches].
    #[arg(long = "cache", value_name = "DIR", global = true)]
    folder: Option<PathBuf>,
}

#[derive(Subcommand)]
enum Action {
    /// Print where the cache is and what it holds, and whether the server of results answers.
    Ls {
        /// The server through which machines share results [default: $MAQUETTE_CACHE_REMOTE].
        #[arg(long, value_name = "URL")]
        cache_remote: Option<String>,
        /// Print one JSON document.
        #[arg(long)]
        json: bool,
    },
    /// Print which nodes of which graphs the results are of, the largest first.
    Du {
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
    /// Look at every file, of all builds, and drop those that are damaged, incomplete or of no use. Fails if something is wrong that
    /// could not be mended. What is not ours is named and stays.
    Doctor {
        /// Only tell what is wrong.
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
                "this system has no folder for caches: name one with --cache".into(),
            );
        };
        self.action(&folder).unwrap_or_else(Exit::Usage)
    }

    fn action(&self, folder: &Path) -> Result<Exit, String> {
        fn wrong(error: DiskError) -> String {
            error.to_string()
        }
        match &self.action {
            Action::Ls { cache_remote, json } => {
                let usage = Disk::usage(folder).map_err(wrong)?;
                print_usage(folder, &usage, server(cache_remote)?.as_ref(), *json);
            }
            Action::Du { json } => {
                print_sizes(folder, &Disk::sizes(folder).map_err(wrong)?, *json);
            }
            Action::Gc { limit } => {
                let limit = limit.map_or_else(disk_size, Ok)?;
                return drop_down_to(folder, limit);
            }
            Action::Clear => return drop_down_to(folder, 0),
            Action::Doctor { dry_run, json } => {
                let diagnosis = Disk::doctor(folder, *dry_run).map_err(wrong)?;
                print_diagnosis(folder, &diagnosis, *dry_run, *json);
                let is_well = diagnosis.faults.iter().all(|fault| fault.mended);
                return Ok(if is_well { Exit::Done } else { Exit::Failed });
            }
        }
        Ok(Exit::Done)
    }
}

/// Drops results until at most `limit` bytes are left.
fn drop_down_to(folder: &Path, limit: u64) -> Result<Exit, String> {
    match Disk::gc(folder, limit) {
        Ok(dropped) => {
            print(&format!("dropped {}\n", bytes(dropped)));
            Ok(Exit::Done)
        }
        Err(error @ DiskError::Kept { .. }) => {
            let help = "make the folder writable, or name another one with --cache";
            eprint(&format!("error: {error}\n  = help: {help}\n"));
            Ok(Exit::Failed)
        }
        Err(error) => Err(error.to_string()),
    }
}

/// The address of a server, and whether it answers; else why not.
type Server = (String, Result<(), String>);

/// The server that is named, if one is.
fn server(named: &Option<String>) -> Result<Option<Server>, String> {
    let server = named.clone().map_or(CacheServer::Default, CacheServer::At);
    server
        .address()
        .map(|(named, address): (&str, String)| {
            Disk::reach(&address).map_err(|why| format!("{named}: {why}"))
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
        folder.shown(),
        counted(usage.entries, "result"),
        counted(usage.programs, "build"),
        counted(usage.columns, "large column"),
        counted(usage.graphs, "graph"),
        bytes(usage.bytes)
    ));
    if let Some((address, answer)) = server {
        let told = answer.as_ref().map_or_else(|why| &why[..], |()| "answers");
        print(&format!("{address}: {told}\n"));
    }
}

fn print_sizes(folder: &Path, sizes: &Sizes, json: bool) {
    let results = sizes.nodes.iter().map(|size| size.results).sum::<usize>();
    let all = sizes.other + sizes.nodes.iter().map(|size| size.bytes).sum::<u64>();
    if json {
        let node = |size: &NodeSize| {
            let graph = size.graph.as_ref().map(|graph| graph.display().to_string());
            json!({
                "graph": graph,
                "node": size.node,
                "type": size.kind,
                "results": size.results,
                "bytes": size.bytes,
            })
        };
        return print_json(&json!({
            "folder": folder.display().to_string(),
            "nodes": sizes.nodes.iter().map(node).collect::<Vec<_>>(),
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
        let _ =
            writeln!(text, "{:>9}  what is remembered of graphs and outputs", bytes(sizes.other));
    }
    let _ = writeln!(text, "{:>9}  in all, {}", bytes(all), counted(results, "result"));
    print(&text);
}

fn print_diagnosis(folder: &Path, diagnosis: &Diagnosis, dry_run: bool, json: bool) {
    let Diagnosis { files, bytes: size, faults, foreign } = diagnosis;
    if json {
        let fault = |fault: &Fault| {
            let path = fault.path.display().to_string();
            json!({ "path": path, "what": fault.what, "mended": fault.mended })
        };
        return print_json(&json!({
            "folder": folder.display().to_string(),
            "files": files,
            "bytes": size,
            "faults": faults.iter().map(fault).collect::<Vec<_>>(),
            "foreign": foreign.iter().map(|path| path.display().to_string()).collect::<Vec<_>>(),
        }));
    }
    let mut text = String::new();
    for Fault { path, what, mended } in faults {
        let word = match (mended, dry_run) {
            (true, _) => "mended",
            (false, true) => "wrong ",
            (false, false) => "stays ",
        };
        let _ = writeln!(text, "{word}  {}: {what}", path.shown());
    }
    for path in foreign {
        let _ = writeln!(text, "left    {}: it is not ours", path.shown());
    }
    let mended = faults.iter().filter(|fault| fault.mended).count();
    let wrong = counted(faults.len(), "fault");
    let (files, size) = (counted(*files, "file"), bytes(*size));
    let _ = writeln!(text, "{}: {files}, {size}: {wrong}, {mended} mended", folder.shown());
    print(&text);
}
