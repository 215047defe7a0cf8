//! `maquette fmt`: graphs in their canonical form.

use std::io::Read;
use std::path::{Path, PathBuf};

use clap::Args;

use super::{Exit, eprint, print, print_document, report};
use crate::catalog::Catalog;
use crate::graph::{Graph, LOCK_ENDING, Options, PINS_ENDING};
use crate::plain;
use crate::writing::{Turn, replace};

#[derive(Args)]
pub(super) struct Fmt {
    /// The graph files, folders whose `.ron` files are all taken, or `-` for stdin to stdout.
    #[arg(required = true, value_name = "GRAPH")]
    graphs: Vec<PathBuf>,
    /// Write nothing; list the files that would change and fail if there is one.
    #[arg(long)]
    check: bool,
    /// Leave out what is said by default: values that are as they would be without being written. Comments stay.
    #[arg(long)]
    minimal: bool,
}

impl Fmt {
    pub(super) fn run(&self, catalog: &Catalog) -> Exit {
        let mut files = Vec::new();
        let mut failed = false;
        for graph in &self.graphs {
            if let Err((path, error)) = collect(graph, &mut files) {
                eprint(&format!("error: cannot read {}: {error}\n", path.display()));
                failed = true;
            }
        }
        for file in &files {
            failed |= !self.file(file, catalog);
        }
        if failed { Exit::Failed } else { Exit::Done }
    }

    /// Whether all went well; with `--check`, whether the file is in its canonical form.
    fn file(&self, path: &Path, catalog: &Catalog) -> bool {
        let is_stdin = path == Path::new("-");
        let text = match read(path) {
            Ok(text) => text,
            Err(error) => {
                eprint(&format!("error: cannot read {}: {error}\n", path.display()));
                return false;
            }
        };
        let form = match self.minimal {
            true => Graph::minimal(path, &text, catalog, &Options::default()),
            false => Graph::formatted(path, &text),
        };
        let form = match form {
            Ok(form) => form,
            Err(problems) => {
                report(&problems);
                return false;
            }
        };
        match (self.check, is_stdin) {
            (true, _) if form == text => true,
            (true, _) => {
                print(&format!("{}\n", path.display()));
                false
            }
            (false, true) => {
                print_document(&form);
                true
            }
            (false, false) if form == text => true,
            (false, false) => {
                match Turn::beside(path).and_then(|_turn| replace(path, &text, &form)) {
                    Ok(()) => true,
                    Err(error) => {
                        eprint(&format!("error: cannot write {}: {error}\n", path.display()));
                        false
                    }
                }
            }
        }
    }
}

/// The text of a file; of stdin for `-`.
pub(super) fn read(path: &Path) -> std::io::Result<String> {
    if path != Path::new("-") {
        return plain::read_text(path);
    }
    let mut text = String::new();
    std::io::stdin().lock().read_to_string(&mut text)?;
    Ok(text)
}

/// Whether a file is one that people write: a graph, a test or handles, but neither a lock file nor pins.
pub(super) fn is_for_people(path: &Path) -> bool {
    let ends_with = |ending| path.to_string_lossy().ends_with(&format!(".{ending}"));
    let is_beside = [LOCK_ENDING, PINS_ENDING].into_iter().any(ends_with);
    path.extension().is_some_and(|ending| ending == "ron") && !is_beside
}

/// Adds a file, or the graph files in a folder and the folders in it, hidden ones, lock files and pins left out, in the order of
/// their names.
pub(super) fn collect(
    path: &Path,
    files: &mut Vec<PathBuf>,
) -> Result<(), (PathBuf, std::io::Error)> {
    if !path.is_dir() {
        files.push(path.to_owned());
        return Ok(());
    }
    let unread = |error| (path.to_owned(), error);
    let entries = std::fs::read_dir(path).map_err(unread)?;
    let mut entries = entries.collect::<Result<Vec<_>, _>>().map_err(unread)?;
    entries.sort_by_key(std::fs::DirEntry::file_name);
    for entry in entries {
        let kind = entry.file_type().map_err(unread)?;
        let is_hidden = entry.file_name().to_string_lossy().starts_with('.');
        let path = entry.path();
        // Links are not followed: they may lead in a circle, or to files of somebody else.
        if (kind.is_dir() && !is_hidden) || (kind.is_file() && is_for_people(&path)) {
            collect(&path, files)?;
        }
    }
    Ok(())
}
