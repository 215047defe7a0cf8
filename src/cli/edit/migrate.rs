//! `maquette edit GRAPH migrate`: replaces former names of nodes and fields in graph files by the present ones.

use std::path::{Path, PathBuf};

use clap::Args;
use maquette_engine::writing::{FolderLock, replace};
use maquette_golden::case;
use maquette_graph::Graph;
use maquette_graph::catalog::Catalog;
use maquette_syntax::{first_word, parse, syntax_diagnostics};

use super::graph_file::{GraphFile, changed_lines};
use crate::files::find_files;
use crate::fmt::read;
use crate::{DisplayPath, Exit, eprint, format_count, print, print_document, report};

/// Packs define former names; graphs that contain them still run. All other bytes of the files stay.
#[derive(Args)]
pub(crate) struct Migrate {
    /// More graph files, and folders whose `.ron` files are all migrated.
    #[arg(value_name = "GRAPH")]
    graphs: Vec<PathBuf>,
    /// Write the files. Without this option the lines that would change are printed.
    #[arg(long)]
    write: bool,
    /// Print the names of the files that would change, and fail if there is one.
    #[arg(long, conflicts_with = "write")]
    check: bool,
}

impl Migrate {
    pub(super) fn run(&self, file: &GraphFile<'_>, catalog: &Catalog) -> Exit {
        if self.write && file.dry_run {
            return Exit::Usage("--write cannot be used with --dry-run".into());
        }
        let graphs: Vec<_> =
            [file.graph.to_owned()].into_iter().chain(self.graphs.clone()).collect();
        let (files, unread) = find_files(&graphs);
        let (mut failed, mut count) = (!unread.is_empty(), 0);
        for (path, error) in unread {
            eprint(&format!("error: cannot read {}: {error}\n", path.for_display()));
        }
        for path in &files {
            match self.migrate(path, catalog) {
                Ok(changed) => count += usize::from(changed),
                Err(()) => failed = true,
            }
        }
        if !self.check {
            let done = if self.write { "migrated" } else { "to be migrated" };
            print(&format!("{} {done}\n", format_count(count, "file")));
        }
        if failed || self.check && count > 0 { Exit::Failed } else { Exit::Done }
    }

    /// Migrates a file. Returns true if the file contains former names. If the result is an error, it has already been printed.
    fn migrate(&self, path: &Path, catalog: &Catalog) -> Result<bool, ()> {
        fn print_error(what: &str, error: &std::io::Error, path: &Path) {
            eprint(&format!("error: cannot {what} {}: {error}\n", path.for_display()));
        }
        let text = read(path).map_err(|error| print_error("read", &error, path))?;
        let migrated = match first_word(&text) {
            "Graph" | "Patch" => Graph::migrate(path, &text, catalog),
            "Test" => {
                let graphs = case::skim(path).map(|test| test.graphs).unwrap_or_default();
                Ok(Graph::migrate_test(&text, &graphs, catalog))
            }
            _ => {
                let (tree, errors) = parse(&text);
                // Report only the syntax errors. The file may be an unresolved merge, or not a graph at all.
                if tree.is_broken() && !text.trim().is_empty() {
                    report(&syntax_diagnostics(path, &text, errors));
                    return Err(());
                }
                return Ok(false);
            }
        };
        let migrated = migrated.map_err(|diagnostics| report(&diagnostics))?;
        if migrated == text {
            return Ok(false);
        }
        match (self.write, self.check) {
            (true, _) => {
                let turn = FolderLock::acquire(path);
                let written = turn.and_then(|_turn| replace(path, &text, &migrated));
                written.map_err(|error| print_error("write", &error, path))?;
                print(&format!("{}\n", path.for_display()));
            }
            (false, true) => print(&format!("{}\n", path.for_display())),
            (false, false) => {
                print(&format!("{}\n", path.for_display()));
                print_document(&changed_lines(&text, &migrated));
            }
        }
        Ok(true)
    }
}
