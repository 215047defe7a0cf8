//! `maquette merge`: two people's edits of one graph, as git's merge driver.

use std::path::PathBuf;

use clap::Args;
use maquette_edit::Merge as Merged;
use maquette_engine::writing::rewrite;
use maquette_graph::catalog::Catalog;
use maquette_syntax::error::Source;
use maquette_value::plain;

use super::{Exit, eprint, print_document, report};
use crate::Shown;

/// For git, in the project's `.gitattributes`: `*.ron merge=maquette`; and once for each user:
/// `git config --global merge.maquette.driver "maquette merge %O %A %B --path %P"`.
#[derive(Args)]
pub(crate) struct Merge {
    /// The graph that both have changed.
    base: PathBuf,
    /// Ours, into which the result is written.
    ours: PathBuf,
    /// Theirs.
    theirs: PathBuf,
    /// Where the graph belongs, if the three files lie elsewhere: the graphs that it uses are looked for from there.
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
            let text = match plain::read_text(file) {
                Ok(text) => text,
                Err(error) => {
                    return Exit::Usage(format!("cannot read {}: {error}", file.shown()));
                }
            };
            // git gives files of a moment, whose names say nothing.
            let name = match &self.path {
                Some(path) => format!("{} ({side})", path.shown()).into(),
                None => file.clone(),
            };
            texts.push(Source { name, text });
        }
        let merged = maquette_edit::merge(path, [&texts[0], &texts[1], &texts[2]], catalog);
        let Merged { text, conflicts, problems, by_lines } = merged;
        if self.print {
            print_document(&text);
        } else if let Err(error) = rewrite(&self.ours, &text) {
            return Exit::Usage(format!("cannot write {}: {error}", self.ours.shown()));
        }
        let path = path.shown();
        if by_lines {
            eprint(&format!("{path}: merged line by line, not by what it says\n"));
        }
        for place in &conflicts {
            let place = if place.is_empty() { "it" } else { place };
            eprint(&format!("{path}: both changed {place}, differently\n"));
        }
        report(&problems);
        if conflicts.is_empty() && problems.is_empty() { Exit::Done } else { Exit::Failed }
    }
}
