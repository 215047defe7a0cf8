//! `maquette diff`: lists the differences between two graphs.

use std::path::{Path, PathBuf};

use clap::Args;
use maquette_graph::Graph;
use maquette_graph::catalog::Catalog;
use maquette_syntax::error::Source;
use maquette_value::fs;
use serde_json::json;

use super::{Exit, print, print_json, report};
use crate::DisplayPath;

/// Used graphs are compared, too, if each of the two graphs has its own copy, as in two checkouts of a project.
///
/// For git: `git difftool -y -x 'maquette diff'`, or `GIT_EXTERNAL_DIFF='maquette diff' git diff`.
#[derive(Args)]
pub(crate) struct Diff {
    /// The old and the new graph, or the seven arguments that git passes to GIT_EXTERNAL_DIFF.
    #[arg(required = true, num_args = 2..=9, value_name = "GRAPH")]
    graphs: Vec<PathBuf>,
    /// Print one JSON document.
    #[arg(long)]
    json: bool,
}

impl Diff {
    pub(super) fn run(&self, catalog: &Catalog) -> Exit {
        // git passes seven arguments: path, old file, hash, mode, new file, hash, mode. For a renamed file it passes two more.
        let (old, new, title) = match &self.graphs[..] {
            [old, new] => (old, new, None),
            [path, old, _, _, new, _, _] | [path, old, _, _, new, _, _, _, _] => {
                (old, new, Some(path))
            }
            _ => return Exit::Usage("expected two graphs: the old one and the new one".into()),
        };
        let (old, new) = match (read_source(old), read_source(new)) {
            (Ok(old), Ok(new)) => (old, new),
            (Err(why), _) | (_, Err(why)) => return Exit::Usage(why),
        };
        let differences = match Graph::differences_with_uses(&old, &new, catalog) {
            Ok(differences) => differences,
            Err(diagnostics) => {
                report(&diagnostics);
                return Exit::Usage("the graphs cannot be compared".into());
            }
        };
        if self.json {
            let list: Vec<_> = differences.iter().map(|found| found.to_json()).collect();
            print_json(&json!({
                "old": old.name.display().to_string(),
                "new": new.name.display().to_string(),
                "equal": differences.is_empty(),
                "differences": list,
            }));
        } else {
            if let Some(path) = title {
                print(&format!("{}\n", path.for_display()));
            }
            let indent = if title.is_some() { "    " } else { "" };
            differences.iter().for_each(|found| print(&format!("{indent}{found}\n")));
        }
        // Return success to git even if there are differences: it treats a failing GIT_EXTERNAL_DIFF as a crash.
        if differences.is_empty() || title.is_some() { Exit::Done } else { Exit::Failed }
    }
}

/// Reads a graph file. The path `/dev/null`, which git passes for a missing file, stands for an empty graph.
fn read_source(path: &Path) -> Result<Source, String> {
    let text = match path == Path::new("/dev/null") {
        true => Ok("Graph(format: 1)".to_owned()),
        false => fs::read_text(path),
    };
    let text = text.map_err(|error| format!("cannot read {}: {error}", path.for_display()))?;
    Ok(Source { name: path.to_owned(), text })
}
