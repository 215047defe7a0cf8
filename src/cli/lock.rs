//! `maquette lock` and `maquette update`: what the graphs are that a graph uses, and whether what has become of them is taken.

use std::collections::BTreeSet;
use std::io::{BufRead as _, IsTerminal};
use std::path::{Path, PathBuf};

use clap::Args;
use maquette_engine::writing::{Turn, keep_beside};
use maquette_graph::catalog::Catalog;
use maquette_graph::{Files, Lock as LockFile, Locked, Options, UsedNow, differences, lock_beside};
use maquette_syntax::error::Problem;
use maquette_syntax::unknown;

use super::{Exit, counted, eprint, print, report};
use crate::Shown;

#[derive(Args)]
pub(crate) struct Lock {
    /// The graph file.
    graph: PathBuf,
    /// Let the graph use files of this folder, too.
    #[arg(long = "root", value_name = "DIR")]
    roots: Vec<PathBuf>,
}

#[derive(Args)]
pub(crate) struct Update {
    /// The graph file.
    graph: PathBuf,
    /// Only this graph, by the name or the path that it is used by, and those that it uses.
    #[arg(value_name = "NAME")]
    name: Option<String>,
    /// Take what changed without asking.
    #[arg(long, short)]
    yes: bool,
    /// Let the graph use files of this folder, too.
    #[arg(long = "root", value_name = "DIR")]
    roots: Vec<PathBuf>,
}

impl Lock {
    pub(super) fn run(&self, catalog: &Catalog) -> Exit {
        let _turn = match turn(&self.graph) {
            Ok(turn) => turn,
            Err(why) => return Exit::Usage(why),
        };
        let now = match used_now(&self.graph, &self.graph, &self.roots, catalog) {
            Ok(now) => now.lock,
            Err(problems) => {
                report(&problems);
                return Exit::Failed;
            }
        };
        if now.0.is_empty() {
            print(&format!("{} uses no other graph\n", self.graph.shown()));
            return Exit::Done;
        }
        match keep(&self.graph, &now) {
            Ok(()) => {
                let file = lock_beside(&self.graph);
                print(&format!("{}: {}\n", file.shown(), counted(now.0.len(), "graph")));
                Exit::Done
            }
            Err(why) => Exit::Usage(why),
        }
    }
}

impl Update {
    pub(super) fn run(&self, catalog: &Catalog) -> Exit {
        let path = lock_beside(&self.graph);
        let before = match LockFile::of(&self.graph) {
            Ok(Some(lock)) => lock,
            Ok(None) => {
                let graph = self.graph.shown();
                let file = path.shown();
                return Exit::Usage(format!(
                    "there is no {file}: `maquette lock {graph}` writes it"
                ));
            }
            Err(problem) => {
                report(&[*problem]);
                return Exit::Failed;
            }
        };
        let now = used_now(&self.graph, &self.graph, &self.roots, catalog);
        let wanted = now.and_then(|now| Ok((self.wanted(&before, &now, catalog)?, now)));
        let (wanted, now) = match wanted {
            Ok((Ok(wanted), now)) => (wanted, now.lock),
            Ok((Err(why), _)) => return Exit::Usage(why),
            Err(problems) => {
                report(&problems);
                return Exit::Failed;
            }
        };
        let mut is_new = false;
        for key in &wanted {
            let told = self.told(key, before.0.get(key), now.0.get(key), catalog);
            let Some(told) = told else { continue };
            print(&told);
            is_new = true;
        }
        if !is_new {
            print(&format!("{} is up to date\n", path.shown()));
            return Exit::Done;
        }
        if !self.yes && !is_taken() {
            eprint("nothing was taken: --yes takes it\n");
            return Exit::Failed;
        }
        match self.take(&wanted, &now) {
            Ok(()) => Exit::Done,
            Err(why) => Exit::Usage(why),
        }
    }

    /// Writes what is taken into the lock as it is by now: nobody waits for an answer, so others may have taken something meanwhile.
    fn take(&self, wanted: &BTreeSet<String>, now: &LockFile) -> Result<(), String> {
        let _turn = turn(&self.graph)?;
        let lock = LockFile::of(&self.graph).map_err(|problem| problem.message)?;
        let mut lock = lock.unwrap_or_default();
        for key in wanted {
            match now.0.get(key) {
                Some(locked) => drop(lock.0.insert(key.clone(), locked.clone())),
                None => drop(lock.0.remove(key)),
            }
        }
        keep(&self.graph, &lock)
    }

    /// The paths in the lock, old and new, that are asked about.
    ///
    /// # Errors
    /// What is wrong with the graph that is named; inside, in words, that there is none.
    fn wanted(
        &self,
        before: &LockFile,
        now: &UsedNow,
        catalog: &Catalog,
    ) -> Result<Result<BTreeSet<String>, String>, Vec<Problem>> {
        let all = before.0.keys().chain(now.lock.0.keys()).cloned();
        let all = BTreeSet::from_iter(all);
        let Some(name) = &self.name else { return Ok(Ok(all)) };
        let by_name = now.names.iter().find(|(known, _)| known == name).map(|(_, key)| key);
        let Some(key) = by_name.or_else(|| all.get(name)) else {
            let names = now.names.iter().map(|(name, _)| &name[..]);
            let known: Vec<_> = names.chain(all.iter().map(String::as_str)).collect();
            let message = format!("{} uses no graph `{name}`", self.graph.shown());
            return Ok(Err(unknown(message, name, "it uses", &known)));
        };
        let mut wanted = BTreeSet::from([key.clone()]);
        if now.lock.0.contains_key(key) {
            let file = folder(&self.graph).join(key);
            wanted.extend(used_now(&file, &self.graph, &self.roots, catalog)?.lock.0.into_keys());
        }
        Ok(Ok(wanted))
    }

    /// How a used graph differs; none if it does not.
    fn told(
        &self,
        key: &str,
        before: Option<&Locked>,
        now: Option<&Locked>,
        catalog: &Catalog,
    ) -> Option<String> {
        let (before, now) = match (before, now) {
            (None, None) => return None,
            (Some(before), Some(now)) if before == now => return None,
            (None, Some(now)) => return Some(format!("{key}: new, {}\n", now.version())),
            (Some(_), None) => return Some(format!("{key}: not used any more\n")),
            (Some(before), Some(now)) => (before, now),
        };
        let mut told = match before.version == now.version {
            true => format!("{key}: {}\n", now.version()),
            false => format!("{key}: {} -> {}\n", before.version(), now.version()),
        };
        let file = folder(&self.graph).join(key);
        let found = differences(&file, &before.text, &now.text, catalog);
        match found.is_empty() {
            true => told += "    comments or spaces differ\n",
            false => found.iter().for_each(|found| told += &format!("    {found}\n")),
        }
        Some(told)
    }
}

fn folder(graph: &Path) -> &Path {
    let folder = graph.parent().filter(|folder| !folder.as_os_str().is_empty());
    folder.unwrap_or(Path::new("."))
}

/// What the graph at `path` uses now, by paths from the folder of another one.
fn used_now(
    path: &Path,
    beside: &Path,
    roots: &[PathBuf],
    catalog: &Catalog,
) -> Result<UsedNow, Vec<Problem>> {
    let options = Options { roots: roots.to_vec(), files: Files::Ignored, ..Options::default() };
    LockFile::now(path, folder(beside), catalog, &options)
}

/// The right to change the lock of a graph.
fn turn(graph: &Path) -> Result<Turn, String> {
    Turn::beside(graph)
        .map_err(|error| format!("cannot write {}: {error}", lock_beside(graph).shown()))
}

/// Writes the lock of a graph.
fn keep(graph: &Path, lock: &LockFile) -> Result<(), String> {
    let (path, text) = (lock_beside(graph), lock.to_text(graph));
    keep_beside(&path, &text).map_err(|error| format!("cannot write {}: {error}", path.shown()))
}

/// Asks whether what was shown is taken, if there is somebody to ask.
fn is_taken() -> bool {
    let stdin = std::io::stdin();
    if !stdin.is_terminal() || !std::io::stdout().is_terminal() {
        return false;
    }
    print("take it? [y/N] ");
    let mut answer = String::new();
    // Who cannot answer has not said yes.
    let _ = stdin.lock().read_line(&mut answer);
    matches!(answer.trim(), "y" | "Y" | "yes")
}
