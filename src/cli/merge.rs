//! `maquette merge`: two people's edits of one graph, as git's merge driver.

use std::path::PathBuf;

use clap::Args;

use super::{Exit, eprint, print_document, report};
use crate::catalog::Catalog;
use crate::graph::{Graph, Merge as Merged};
use crate::plain;
use crate::writing::rewrite;

/// For git, in the project's `.gitattributes`: `*.ron merge=maquette`; and once for each user:
/// `git config --global merge.maquette.driver "maquette merge %O %A %B --path %P"`.
#[derive(Args)]
pub(super) struct Merge {
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
        for file in [&self.base, &self.ours, &self.theirs] {
            match plain::read_text(file) {
                Ok(text) => texts.push(text),
                Err(error) => {
                    return Exit::Usage(format!("cannot read {}: {error}", file.display()));
                }
            }
        }
        let merged = Graph::merge(path, [&texts[0], &texts[1], &texts[2]], catalog);
        let Merged { text, conflicts, problems } = match merged {
            Ok(merged) => merged,
            Err(problems) => {
                report(&problems);
                return Exit::Usage("what is no graph cannot be merged by what it says".into());
            }
        };
        if self.print {
            print_document(&text);
        } else if let Err(error) = rewrite(&self.ours, &text) {
            return Exit::Usage(format!("cannot write {}: {error}", self.ours.display()));
        }
        for place in &conflicts {
            eprint(&format!("{}: both changed {place}, differently\n", path.display()));
        }
        report(&problems);
        if conflicts.is_empty() && problems.is_empty() { Exit::Done } else { Exit::Failed }
    }
}
