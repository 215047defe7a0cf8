//! `maquette fmt`: formats graphs.

use std::io::Read;
use std::path::{Path, PathBuf};

use clap::Args;
use maquette_engine::writing::{FolderLock, replace};
use maquette_graph::Options;
use maquette_graph::catalog::Catalog;
use maquette_value::fs;

use super::files::find_files;
use super::{Exit, eprint, print, print_document, report};
use crate::DisplayPath;

#[derive(Args)]
pub(crate) struct Fmt {
    /// Graph files, folders whose `.ron` files are all formatted, or `-` to format stdin to stdout.
    #[arg(required = true, value_name = "GRAPH")]
    graphs: Vec<PathBuf>,
    /// Write nothing; list the files that would change, and fail if there is one.
    #[arg(long)]
    check: bool,
    /// Remove values that equal their defaults. Comments stay.
    #[arg(long)]
    minimal: bool,
}

impl Fmt {
    pub(super) fn run(&self, catalog: &Catalog) -> Exit {
        let (files, unread) = find_files(&self.graphs);
        let mut failed = !unread.is_empty();
        for (path, error) in unread {
            eprint(&format!("error: cannot read {}: {error}\n", path.for_display()));
        }
        for file in &files {
            failed |= !self.file(file, catalog);
        }
        if failed { Exit::Failed } else { Exit::Done }
    }

    /// Formats a file. Returns false if an error occurs, or if `--check` is given and the file is not formatted.
    fn file(&self, path: &Path, catalog: &Catalog) -> bool {
        let is_stdin = path == Path::new("-");
        let text = match read(path) {
            Ok(text) => text,
            Err(error) => {
                eprint(&format!("error: cannot read {}: {error}\n", path.for_display()));
                return false;
            }
        };
        let form = match self.minimal {
            true => maquette_edit::minimal(path, &text, catalog, &Options::default()),
            false => maquette_edit::format_text(path, &text),
        };
        let form = match form {
            Ok(form) => form,
            Err(diagnostics) => {
                report(&diagnostics);
                return false;
            }
        };
        match (self.check, is_stdin) {
            (true, _) if form == text => true,
            (true, _) => {
                print(&format!("{}\n", path.for_display()));
                false
            }
            (false, true) => {
                print_document(&form);
                true
            }
            (false, false) if form == text => true,
            (false, false) => {
                match FolderLock::acquire(path).and_then(|_turn| replace(path, &text, &form)) {
                    Ok(()) => true,
                    Err(error) => {
                        eprint(&format!("error: cannot write {}: {error}\n", path.for_display()));
                        false
                    }
                }
            }
        }
    }
}

/// Reads a file. The path `-` stands for stdin.
pub(super) fn read(path: &Path) -> std::io::Result<String> {
    if path != Path::new("-") {
        return fs::read_text(path);
    }
    let mut bytes = Vec::new();
    std::io::stdin().lock().read_to_end(&mut bytes)?;
    fs::decode_utf8(bytes)
}
