//! `maquette migrate`: new names of nodes and fields put into graph files.

use std::path::{Path, PathBuf};

use clap::Args;
use maquette_engine::writing::{Turn, replace};
use maquette_golden::case;
use maquette_graph::Graph;
use maquette_graph::catalog::Catalog;
use maquette_syntax::{first_word, parse, syntax_problems};

use super::edit::changed_lines;
use super::files::given;
use super::fmt::read;
use super::{Exit, counted, eprint, print, print_document, report};
use crate::Shown;

/// Graphs with old names go on to work; what the new ones are is said by the packs. Every other byte of the files stays.
#[derive(Args)]
pub(crate) struct Migrate {
    /// The graph files, and folders whose `.ron` files are all taken.
    #[arg(required = true, value_name = "GRAPH")]
    graphs: Vec<PathBuf>,
    /// Write the files; without it, the lines that would change are printed.
    #[arg(long)]
    write: bool,
    /// Print the names of the files that would change, and fail if there are any.
    #[arg(long, conflicts_with = "write")]
    check: bool,
}

impl Migrate {
    pub(super) fn run(&self, catalog: &Catalog) -> Exit {
        let (files, unread) = given(&self.graphs);
        let (mut failed, mut count) = (!unread.is_empty(), 0);
        for (path, error) in unread {
            eprint(&format!("error: cannot read {}: {error}\n", path.shown()));
        }
        for file in &files {
            match self.file(file, catalog) {
                Ok(changed) => count += usize::from(changed),
                Err(()) => failed = true,
            }
        }
        if !self.check {
            let done = if self.write { "migrated" } else { "to be migrated" };
            print(&format!("{} {done}\n", counted(count, "file")));
        }
        if failed || self.check && count > 0 { Exit::Failed } else { Exit::Done }
    }

    /// Whether a file has something old in it; an error that has been printed.
    fn file(&self, path: &Path, catalog: &Catalog) -> Result<bool, ()> {
        fn failed(what: &str, error: &std::io::Error, path: &Path) {
            eprint(&format!("error: cannot {what} {}: {error}\n", path.shown()));
        }
        let text = read(path).map_err(|error| failed("read", &error, path))?;
        let migrated = match first_word(&text) {
            "Graph" | "Patch" => Graph::migrated(path, &text, catalog),
            "Test" => {
                let graphs = case::skim(path).map(|test| test.graphs).unwrap_or_default();
                Ok(Graph::migrated_test(&text, &graphs, catalog))
            }
            _ => {
                let (tree, mistakes) = parse(&text);
                // Not even its first word is known, as in the middle of a merge.
                if tree.is_broken() && !text.trim().is_empty() {
                    report(&syntax_problems(path, &text, mistakes));
                    return Err(());
                }
                return Ok(false);
            }
        };
        let migrated = migrated.map_err(|problems| report(&problems))?;
        if migrated == text {
            return Ok(false);
        }
        match (self.write, self.check) {
            (true, _) => {
                let turn = Turn::beside(path);
                let written = turn.and_then(|_turn| replace(path, &text, &migrated));
                written.map_err(|error| failed("write", &error, path))?;
                print(&format!("{}\n", path.shown()));
            }
            (false, true) => print(&format!("{}\n", path.shown())),
            (false, false) => {
                print(&format!("{}\n", path.shown()));
                print_document(&changed_lines(&text, &migrated));
            }
        }
        Ok(true)
    }
}
