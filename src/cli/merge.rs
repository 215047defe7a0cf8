//! `maquette merge`: merges two edited versions of a graph, as git's merge driver.

use std::path::PathBuf;

use clap::Args;
use maquette_edit::Merge as Merged;
use maquette_engine::writing::rewrite;
use maquette_graph::catalog::Catalog;
use maquette_syntax::error::Source;
use maquette_value::fs;

use super::{Exit, eprint, print_document, report};
use crate::DisplayPath;

/// For git, in the project's `.gitattributes`: `*.ron merge=maquette`; and once for each user:
/// `git config --global merge.maquette.driver "maquette merge %O %A %B --path %P"`.
#[derive(Args)]
pub(crate) struct Merge {
    /// The common ancestor of both versions.
    base: PathBuf,
    /// Our version, which is replaced by the result.
    ours: PathBuf,
    /// Their version.
    theirs: PathBuf,
    /// The path of the graph in the project, if the three files are elsewhere. Used graphs are searched from this path.
    #[arg(long, value_name = "GRAPH")]
    path: Option<PathBuf>,
    /// Print the result; write nothing.
    #[arg(short, long)]
    print: bool,
}

impl Merge {
    pub(super) fn run(&self, catalog: &Catalog) -> Exit {
        let path = self.path.as_ref().unwrap_or(&self.ours);
        let mut texts = Vec::new();
        for (file, side) in [(&self.base, "base"), (&self.ours, "ours"), (&self.theirs, "theirs")] {
            let text = match fs::read_text(file) {
                Ok(text) => text,
                Err(error) => {
                    return Exit::Usage(format!("cannot read {}: {error}", file.for_display()));
                }
            };
            // In messages, name the version instead of the file, because git passes temporary files with meaningless
            // names.
            let name = match &self.path {
                Some(path) => format!("{} ({side})", path.for_display()).into(),
                None => file.clone(),
            };
            texts.push(Source { name, text });
        }
        let merged = maquette_edit::merge(path, [&texts[0], &texts[1], &texts[2]], catalog);
        let Merged { text, conflicts, diagnostics, by_lines } = merged;
        if self.print {
            print_document(&text);
        } else if let Err(error) = rewrite(&self.ours, &text) {
            return Exit::Usage(format!("cannot write {}: {error}", self.ours.for_display()));
        }
        let path = path.for_display();
        if by_lines {
            eprint(&format!("{path}: merged line by line, not by content\n"));
        }
        for place in &conflicts {
            let place = if place.is_empty() { "it" } else { place };
            eprint(&format!("{path}: conflict: both sides changed {place}\n"));
        }
        report(&diagnostics);
        if conflicts.is_empty() && diagnostics.is_empty() { Exit::Done } else { Exit::Failed }
    }
}
