//! `maquette check`: reports all errors and warnings of graphs, tests, sweeps and handle files.

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Args;
use maquette_engine::writing::{FolderLock, replace};
use maquette_golden::suite::{FileKind, file_diagnostic, shared_golden_folders};
use maquette_graph::catalog::Catalog;
use maquette_syntax::error::{Diagnostic, Position, Severity, code};
use serde_json::json;

use super::cache_options::CacheOptions;
use super::files::find_files;
use super::fmt::read;
use super::preflight::{Preflight, as_json, table};
use super::{
    Exit, GraphOptions, count_severity, eprint, format_count, has_errors, print, print_json,
    put_problems, report,
};
use crate::DisplayPath;

#[derive(Args)]
pub(crate) struct Check {
    /// Graph files, folders whose `.ron` files are all checked, or `-` for stdin. Test files are checked with their graphs; handle files
    /// are checked, too.
    #[arg(required = true, value_name = "GRAPH")]
    graphs: Vec<PathBuf>,
    #[command(flatten)]
    options: GraphOptions,
    #[command(flatten)]
    cache: CacheOptions,
    /// Print what a run of each graph needs, before anything large is read: the sizes of results from the headers of files and the laws of
    /// nodes, the memory, and the time from earlier runs. A node that needs more memory than is allowed (--max-memory) is an error.
    #[arg(long)]
    preflight: bool,
    /// Print one JSON document.
    #[arg(long)]
    json: bool,
    /// Fix errors in graph files that have only one fix, such as a misspelled name, a comma or a former name. Other errors are reported.
    #[arg(long)]
    fix: bool,
}

impl Check {
    pub(super) fn run(&self, catalog: &Arc<Catalog>) -> Exit {
        let (files, unread) = find_files(&self.graphs);
        let unread = unread.iter().map(|(path, error)| unreadable_file(path, error));
        let mut diagnostics = Vec::from_iter(unread);
        let mut counts = [0; 4];
        let (mut tests, mut preflights) = (Vec::new(), Vec::new());
        for path in &files {
            match read(path) {
                Ok(mut text) => {
                    let what = FileKind::detect(path, &text);
                    if self.fix && what == FileKind::Graph {
                        match self.apply_fixes(path, text, catalog) {
                            Ok(mended) => text = mended,
                            Err(why) => return Exit::Usage(why),
                        }
                    }
                    counts[what as usize] += 1;
                    let (found, test) =
                        what.diagnostics(path, text, catalog, &self.options.to_options());
                    if self.preflight && what == FileKind::Graph && !has_errors(&found) {
                        match self.preflight(path, catalog) {
                            Ok(preflight) => preflights.extend(preflight),
                            Err(why) => return Exit::Usage(why),
                        }
                    }
                    diagnostics.extend(found);
                    tests.extend(test);
                }
                Err(error) => diagnostics.push(unreadable_file(path, &error)),
            }
        }
        diagnostics.extend(shared_golden_folders(&tests).0);
        diagnostics.extend(preflights.iter().flat_map(Preflight::diagnostics).cloned());
        // Report each diagnostic once, even if several files use or test the same graph.
        let mut seen = HashSet::new();
        diagnostics.retain(|diagnostic| {
            let place = (diagnostic.source.name.clone(), diagnostic.span);
            seen.insert((place, diagnostic.code, diagnostic.message.clone()))
        });
        let [errors, warnings] = [Severity::Error, Severity::Warning]
            .map(|severity| count_severity(&diagnostics, severity));
        if self.json {
            let mut document = json!({});
            if self.preflight {
                document["preflight"] = preflights.iter().map(as_json).collect();
            }
            put_problems(&mut document, &diagnostics);
            print_json(&document);
        } else {
            report(&diagnostics);
            preflights.iter().for_each(|preflight| print(&table(preflight)));
            let names = ["graph", "test", "handle file", "sweep"].into_iter().zip(counts);
            let checked = names.filter(|(name, count)| *count > 0 || *name == "graph");
            let checked = checked.map(|(name, count)| format_count(count, name));
            let checked = Vec::from_iter(checked).join(", ");
            let warnings = match warnings {
                0 => String::new(),
                count => format!(", {}", format_count(count, "warning")),
            };
            print(&format!("checked {checked}: {}{warnings}\n", format_count(errors, "error")));
        }
        if errors == 0 { Exit::Done } else { Exit::Failed }
    }

    /// Predicts the needs of a run of the graph at `path`. `None` if the graph has errors, which the check reports.
    fn preflight(&self, path: &Path, catalog: &Arc<Catalog>) -> Result<Option<Preflight>, String> {
        let Some(graph) = self.options.load(path, catalog).graph else { return Ok(None) };
        let mut session = self.cache.reporting_session(1, catalog)?;
        let into = self.options.output_folder(None, path);
        session.recall(&into);
        let graph = session.with_last_counts(&graph);
        let needs = session.needs(&graph, &[], &into)?;
        Ok(Some(Preflight { path: path.to_owned(), graph, needs }))
    }

    /// Applies the fixes of diagnostics to the text of a file, and returns the new text.
    fn apply_fixes(&self, path: &Path, text: String, catalog: &Catalog) -> Result<String, String> {
        if path == Path::new("-") {
            return Err("--fix cannot be used with `-`, because it writes files".into());
        }
        let failed = |error| format!("cannot write {}: {error}", path.for_display());
        let (mended, diagnostics) =
            maquette_edit::apply_fixes(path, &text, catalog, &self.options.to_options());
        if diagnostics.is_empty() {
            return Ok(text);
        }
        let _turn = FolderLock::acquire(path).map_err(failed)?;
        replace(path, &text, &mended).map_err(failed)?;
        for diagnostic in &diagnostics {
            let Position { line, column } =
                Position::from_offset(&diagnostic.source.text, diagnostic.span.start);
            eprint(&format!(
                "fixed {}:{line}:{column}: {}\n",
                path.for_display(),
                diagnostic.message
            ));
        }
        Ok(mended)
    }
}

fn unreadable_file(path: &Path, error: &std::io::Error) -> Diagnostic {
    file_diagnostic(
        code::MISSING_FILE,
        path,
        String::new(),
        format!("cannot read the file: {error}"),
    )
}
