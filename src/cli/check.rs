//! `maquette check`: every problem of graphs, tests and files of handles, at once.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use clap::Args;
use maquette_engine::writing::{Turn, replace};
use maquette_golden::suite::{FileKind, of_file, shared};
use maquette_graph::catalog::Catalog;
use maquette_syntax::error::{Place, Problem, Severity, code};
use serde_json::json;

use super::files::given;
use super::fmt::read;
use super::{Exit, GraphOptions, counted, eprint, print, print_json, put_problems, report};
use crate::Shown;

#[derive(Args)]
pub(crate) struct Check {
    /// The graph files, folders whose `.ron` files are all taken, or `-` for stdin. Test files are checked with the graphs that
    /// they are about, files of handles as what they are.
    #[arg(required = true, value_name = "GRAPH")]
    graphs: Vec<PathBuf>,
    #[command(flatten)]
    options: GraphOptions,
    /// Print one JSON document.
    #[arg(long)]
    json: bool,
    /// Put right in the files of graphs what has one answer: a misspelled name, a comma, an old name. The rest is told.
    #[arg(long)]
    fix: bool,
}

impl Check {
    pub(super) fn run(&self, catalog: &Catalog) -> Exit {
        let (files, unread) = given(&self.graphs);
        let unread = unread.iter().map(|(path, error)| unreadable(path, error));
        let mut problems = Vec::from_iter(unread);
        let mut counts = [0; 4];
        let mut tests = Vec::new();
        for path in &files {
            match read(path) {
                Ok(mut text) => {
                    let what = FileKind::of(path, &text);
                    if self.fix && what == FileKind::Graph {
                        match self.mend(path, text, catalog) {
                            Ok(mended) => text = mended,
                            Err(why) => return Exit::Usage(why),
                        }
                    }
                    counts[what as usize] += 1;
                    let (found, test) = what.problems(path, text, catalog, &self.options.all());
                    problems.extend(found);
                    tests.extend(test);
                }
                Err(error) => problems.push(unreadable(path, &error)),
            }
        }
        problems.extend(shared(&tests).0);
        // Files that use one another, or are tested by several, show the same problems.
        let mut seen = HashSet::new();
        problems.retain(|problem| {
            let place = (problem.source.name.clone(), problem.span);
            seen.insert((place, problem.code, problem.message.clone()))
        });
        fn count(wanted: Severity, problems: &[Problem]) -> usize {
            problems.iter().filter(|found| found.severity == wanted).count()
        }
        let (errors, warnings) =
            (count(Severity::Error, &problems), count(Severity::Warning, &problems));
        if self.json {
            let mut document = json!({});
            put_problems(&mut document, &problems);
            print_json(&document);
        } else {
            report(&problems);
            let names = ["graph", "test", "file of handles", "sweep"].into_iter().zip(counts);
            let checked = names.filter(|(name, count)| *count > 0 || *name == "graph");
            let checked = checked.map(|(name, count)| match (name, count) {
                ("file of handles", 2..) => format!("{count} files of handles"),
                _ => counted(count, name),
            });
            let checked = Vec::from_iter(checked).join(", ");
            let warnings = match warnings {
                0 => String::new(),
                count => format!(", {}", counted(count, "warning")),
            };
            print(&format!("checked {checked}: {}{warnings}\n", counted(errors, "error")));
        }
        if errors == 0 { Exit::Done } else { Exit::Failed }
    }

    /// Puts right in a file what has one answer. The text that it has then.
    fn mend(&self, path: &Path, text: String, catalog: &Catalog) -> Result<String, String> {
        if path == Path::new("-") {
            return Err("--fix writes files: there is none to write behind `-`".into());
        }
        let failed = |error| format!("cannot write {}: {error}", path.shown());
        let (mended, problems) = maquette_edit::fixed(path, &text, catalog, &self.options.all());
        if problems.is_empty() {
            return Ok(text);
        }
        let _turn = Turn::beside(path).map_err(failed)?;
        replace(path, &text, &mended).map_err(failed)?;
        for problem in &problems {
            let Place { line, column } = Place::of(&problem.source.text, problem.span.start);
            eprint(&format!("fixed {}:{line}:{column}: {}\n", path.shown(), problem.message));
        }
        Ok(mended)
    }
}

fn unreadable(path: &Path, error: &std::io::Error) -> Problem {
    of_file(code::MISSING_FILE, path, String::new(), format!("cannot read the file: {error}"))
}
