//! `maquette lock`: writes a lock file with the state of the graphs that a graph uses. `--update` accepts changes of these graphs.

use std::collections::BTreeSet;
use std::io::{BufRead as _, IsTerminal};
use std::path::{Path, PathBuf};

use clap::Args;
use maquette_engine::writing::{FolderLock, keep_beside};
use maquette_graph::catalog::Catalog;
use maquette_graph::{
    Files, Lock as LockFile, LockedGraph, Options, UsedGraphs, differences, lock_beside,
};
use maquette_syntax::error::Diagnostic;
use maquette_syntax::unknown_name_message;

use super::{Exit, eprint, format_count, print, report};
use crate::DisplayPath;

#[derive(Args)]
pub(crate) struct Lock {
    /// The graph file.
    graph: PathBuf,
    /// With --update: update only this used graph, given by name or path, and the graphs that it uses.
    #[arg(value_name = "NAME", requires = "update")]
    name: Option<String>,
    /// Show the changes of the used graphs since they were locked, and write them into the lock file after confirmation.
    #[arg(long)]
    update: bool,
    /// With --update: accept the changes without asking.
    #[arg(long, short, requires = "update")]
    yes: bool,
    /// Let the graph use files of this folder, too.
    #[arg(long = "root", value_name = "DIR")]
    roots: Vec<PathBuf>,
}

impl Lock {
    pub(super) fn run(&self, catalog: &Catalog) -> Exit {
        if self.update { self.update(catalog) } else { self.write(catalog) }
    }

    /// Writes a lock file that contains the present state of the used graphs.
    fn write(&self, catalog: &Catalog) -> Exit {
        let _turn = match acquire_lock(&self.graph) {
            Ok(turn) => turn,
            Err(why) => return Exit::Usage(why),
        };
        let now = match find_used_graphs(&self.graph, &self.graph, &self.roots, catalog) {
            Ok(now) => now.lock,
            Err(diagnostics) => {
                report(&diagnostics);
                return Exit::Failed;
            }
        };
        if now.0.is_empty() {
            print(&format!("{} uses no other graph\n", self.graph.for_display()));
            return Exit::Done;
        }
        match write_lock(&self.graph, &now) {
            Ok(()) => {
                let file = lock_beside(&self.graph);
                print(&format!("{}: {}\n", file.for_display(), format_count(now.0.len(), "graph")));
                Exit::Done
            }
            Err(why) => Exit::Usage(why),
        }
    }

    /// Prints how the used graphs have changed since the lock file was written. Accepts the changes if the user agrees.
    fn update(&self, catalog: &Catalog) -> Exit {
        let path = lock_beside(&self.graph);
        let before = match LockFile::read(&self.graph) {
            Ok(Some(lock)) => lock,
            Ok(None) => {
                let graph = self.graph.for_display();
                let file = path.for_display();
                return Exit::Usage(format!(
                    "cannot read {file}: no such file; run `maquette lock {graph}` to write it"
                ));
            }
            Err(diagnostic) => {
                report(&[*diagnostic]);
                return Exit::Failed;
            }
        };
        let now = find_used_graphs(&self.graph, &self.graph, &self.roots, catalog);
        let selected = now.and_then(|now| Ok((self.selected_keys(&before, &now, catalog)?, now)));
        let (selected, now) = match selected {
            Ok((Ok(selected), now)) => (selected, now.lock),
            Ok((Err(why), _)) => return Exit::Usage(why),
            Err(diagnostics) => {
                report(&diagnostics);
                return Exit::Failed;
            }
        };
        let mut is_new = false;
        for key in &selected {
            let description = self.describe_change(key, before.0.get(key), now.0.get(key), catalog);
            let Some(description) = description else { continue };
            print(&description);
            is_new = true;
        }
        if !is_new {
            print(&format!("{} is up to date\n", path.for_display()));
            return Exit::Done;
        }
        if !self.yes && !confirm() {
            eprint("no change was accepted; use --yes to accept all\n");
            return Exit::Failed;
        }
        match self.accept(&selected, &now) {
            Ok(()) => Exit::Done,
            Err(why) => Exit::Usage(why),
        }
    }

    /// Writes the accepted changes into the lock file. Reads the lock file again first, because another process may have changed it while
    /// the user was asked.
    fn accept(&self, selected: &BTreeSet<String>, now: &LockFile) -> Result<(), String> {
        let _turn = acquire_lock(&self.graph)?;
        let lock = LockFile::read(&self.graph).map_err(|diagnostic| diagnostic.message)?;
        let mut lock = lock.unwrap_or_default();
        for key in selected {
            match now.0.get(key) {
                Some(locked) => drop(lock.0.insert(key.clone(), locked.clone())),
                None => drop(lock.0.remove(key)),
            }
        }
        write_lock(&self.graph, &lock)
    }

    /// Returns the paths of the used graphs to be updated, among those in the old and the new lock file.
    ///
    /// # Errors
    /// The outer error contains the diagnostics of the named graph if it cannot be loaded. The inner error is a message that no used graph
    /// has this name.
    fn selected_keys(
        &self,
        before: &LockFile,
        now: &UsedGraphs,
        catalog: &Catalog,
    ) -> Result<Result<BTreeSet<String>, String>, Vec<Diagnostic>> {
        let all = before.0.keys().chain(now.lock.0.keys()).cloned();
        let all = BTreeSet::from_iter(all);
        let Some(name) = &self.name else { return Ok(Ok(all)) };
        let by_name = now.names.iter().find(|(known, _)| known == name).map(|(_, key)| key);
        let Some(key) = by_name.or_else(|| all.get(name)) else {
            let names = now.names.iter().map(|(name, _)| &name[..]);
            let known: Vec<_> = names.chain(all.iter().map(String::as_str)).collect();
            let message = format!("{} uses no graph `{name}`", self.graph.for_display());
            return Ok(Err(unknown_name_message(message, name, "it uses", &known)));
        };
        let mut selected = BTreeSet::from([key.clone()]);
        if now.lock.0.contains_key(key) {
            let file = folder_of(&self.graph).join(key);
            selected.extend(
                find_used_graphs(&file, &self.graph, &self.roots, catalog)?.lock.0.into_keys(),
            );
        }
        Ok(Ok(selected))
    }

    /// Describes how a used graph has changed. Returns `None` if it has not.
    fn describe_change(
        &self,
        key: &str,
        before: Option<&LockedGraph>,
        now: Option<&LockedGraph>,
        catalog: &Catalog,
    ) -> Option<String> {
        let (before, now) = match (before, now) {
            (None, None) => return None,
            (Some(before), Some(now)) if before == now => return None,
            (None, Some(now)) => return Some(format!("{key}: new, {}\n", now.version())),
            (Some(_), None) => return Some(format!("{key}: no longer used\n")),
            (Some(before), Some(now)) => (before, now),
        };
        let mut description = match before.version == now.version {
            true => format!("{key}: {}\n", now.version()),
            false => format!("{key}: {} -> {}\n", before.version(), now.version()),
        };
        let file = folder_of(&self.graph).join(key);
        let found = differences(&file, &before.text, &now.text, catalog);
        match found.is_empty() {
            true => description += "    comments or spaces differ\n",
            false => found.iter().for_each(|found| description += &format!("    {found}\n")),
        }
        Some(description)
    }
}

fn folder_of(graph: &Path) -> &Path {
    let folder = graph.parent().filter(|folder| !folder.as_os_str().is_empty());
    folder.unwrap_or(Path::new("."))
}

/// Returns the graphs that the graph at `path` uses. Their paths are relative to the folder that contains `beside`.
fn find_used_graphs(
    path: &Path,
    beside: &Path,
    roots: &[PathBuf],
    catalog: &Catalog,
) -> Result<UsedGraphs, Vec<Diagnostic>> {
    let options = Options { roots: roots.to_vec(), files: Files::Ignored, ..Options::default() };
    LockFile::current(path, folder_of(beside), catalog, &options)
}

/// Takes the lock for writing a graph's lock file. Other processes cannot write that file until the returned guard is dropped.
fn acquire_lock(graph: &Path) -> Result<FolderLock, String> {
    FolderLock::acquire(graph)
        .map_err(|error| format!("cannot write {}: {error}", lock_beside(graph).for_display()))
}

/// Writes the lock file of a graph.
fn write_lock(graph: &Path, lock: &LockFile) -> Result<(), String> {
    let (path, text) = (lock_beside(graph), lock.to_text(graph));
    keep_beside(&path, &text)
        .map_err(|error| format!("cannot write {}: {error}", path.for_display()))
}

/// Asks the user to accept the changes. Returns false without asking if the input or output is not a terminal.
fn confirm() -> bool {
    let stdin = std::io::stdin();
    if !stdin.is_terminal() || !std::io::stdout().is_terminal() {
        return false;
    }
    print("accept the changes? [y/N] ");
    let mut answer = String::new();
    // Ignore an error: the answer then stays empty, which counts as "no".
    let _ = stdin.lock().read_line(&mut answer);
    matches!(answer.trim(), "y" | "Y" | "yes")
}
