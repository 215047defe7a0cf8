//! `maquette fmt`: graphs in their canonical form.

use std::io::Read;
use std::path::{Path, PathBuf};

use clap::Args;
use maquette_engine::writing::{Turn, replace};
use maquette_graph::Options;
use maquette_graph::catalog::Catalog;
use maquette_value::plain;

use super::files::given;
use super::{Exit, eprint, print, print_document, report};
use crate::Shown;

#[derive(Args)]
pub(crate) struct Fmt {
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
        let (files, unread) = given(&self.graphs);
        let mut failed = !unread.is_empty();
        for (path, error) in unread {
            eprint(&format!("error: cannot read {}: {error}\n", path.shown()));
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
                eprint(&format!("error: cannot read {}: {error}\n", path.shown()));
                return false;
            }
        };
        let form = match self.minimal {
            true => maquette_edit::minimal(path, &text, catalog, &Options::default()),
            false => maquette_edit::formatted(path, &text),
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
                print(&format!("{}\n", path.shown()));
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
                        eprint(&format!("error: cannot write {}: {error}\n", path.shown()));
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
    let mut bytes = Vec::new();
    std::io::stdin().lock().read_to_end(&mut bytes)?;
    plain::text_of(bytes)
}
