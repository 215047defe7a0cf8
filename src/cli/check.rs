//! `maquette check`: every problem of graphs, tests and files of handles, at once.

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Args;
use serde_json::json;

use super::fmt::{collect, read};
use super::{Exit, GraphOptions, counted, eprint, print, print_json, put_problems, report};
use crate::catalog::Catalog;
use crate::error::{Place, Problem, Severity, Source, Span, code};
use crate::format::handles;
use crate::golden::case;
use crate::graph::{Graph, InputValues, Options};
use crate::suite::shared;
use crate::text::first_word;
use crate::value::HandleSpace;
use crate::writing::{Turn, replace};

#[derive(Args)]
pub(super) struct Check {
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

/// What the `.ron` files of a project are.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum What {
    Graph,
    Test,
    Handles,
}

impl What {
    pub(super) fn of(path: &Path, text: &str) -> Self {
        match first_word(text) {
            "Test" => Self::Test,
            _ if path.to_string_lossy().ends_with(case::ENDING) => Self::Test,
            "Handles" | "[" => Self::Handles,
            _ => Self::Graph,
        }
    }
}

impl Check {
    pub(super) fn run(&self, catalog: &Catalog) -> Exit {
        let mut files = Vec::new();
        let mut problems = Vec::new();
        for path in &self.graphs {
            let unread = collect(path, &mut files).err();
            problems.extend(unread.map(|(path, error)| unreadable(&path, &error)));
        }
        let mut counts = [0; 3];
        let mut tests = Vec::new();
        for path in &files {
            match read(path) {
                Ok(mut text) => {
                    let what = What::of(path, &text);
                    if self.fix && what == What::Graph {
                        match self.mend(path, text, catalog) {
                            Ok(mended) => text = mended,
                            Err(why) => return Exit::Usage(why),
                        }
                    }
                    counts[what as usize] += 1;
                    problems.extend(self.file(what, path, text, catalog, &mut tests));
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
        let count = |wanted| problems.iter().filter(|found| found.severity == wanted).count();
        let (errors, warnings) = (count(Severity::Error), count(Severity::Warning));
        if self.json {
            let mut document = json!({});
            put_problems(&mut document, &problems);
            print_json(&document);
        } else {
            report(&problems);
            let names = ["graph", "test", "file of handles"].into_iter().zip(counts);
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
        let failed = |error| format!("cannot write {}: {error}", path.display());
        let (mended, problems) = Graph::fixed(path, &text, catalog, &self.options.all());
        if problems.is_empty() {
            return Ok(text);
        }
        let _turn = Turn::beside(path).map_err(failed)?;
        replace(path, &text, &mended).map_err(failed)?;
        for problem in &problems {
            let Place { line, column } = Place::of(&problem.source.text, problem.span.start);
            eprint(&format!("fixed {}:{line}:{column}: {}\n", path.display(), problem.message));
        }
        Ok(mended)
    }

    /// The problems of a file; a test file that can be read is put to the `tests`.
    fn file(
        &self,
        what: What,
        path: &Path,
        text: String,
        catalog: &Catalog,
        tests: &mut Vec<case::TestFile>,
    ) -> Vec<Problem> {
        match what {
            What::Graph => {
                let checked = Graph::load_text(path, text, catalog, &self.options.all());
                let unused = checked.graph.as_ref().map(Graph::unused).unwrap_or_default();
                Vec::from_iter(checked.problems.iter().chain(unused).cloned())
            }
            What::Test => match case::read(path, catalog) {
                Ok(test) => {
                    let problems = self.test(&test, catalog);
                    tests.push(test);
                    problems
                }
                Err(problems) => problems,
            },
            What::Handles => {
                let read = handles::read_ron(text.as_bytes(), HandleSpace::default());
                let wrong = |error: handles::HandlesFileError| {
                    problem(code::WRONG_VALUE, path, text.clone(), error.to_string())
                };
                read.err().map(wrong).into_iter().collect()
            }
        }
    }

    /// The problems of the graphs that a test is about, with what each of its cases sets, and what of the test does not fit them.
    fn test(&self, test: &case::TestFile, catalog: &Catalog) -> Vec<Problem> {
        let own = self.options.all();
        let mut problems = Vec::new();
        for (case, graph) in (0..test.cases.len())
            .flat_map(|case| test.graphs.iter().map(move |graph| (case, graph)))
        {
            let checked = test.loaded(case, |set| {
                let set = own.set.iter().chain(set).cloned().collect();
                // Tests are judged without pins.
                Graph::load(graph, catalog, &Options { set, pins: false, ..own.clone() })
            });
            problems.extend(checked.problems);
            let Some(graph) = checked.graph else { continue };
            problems.extend(test.wrong_inputs(case, &graph));
            // Then its outputs are files.
            let fed = match graph.inputs().is_empty() {
                true => Ok(graph),
                false => graph.with_inputs(&InputValues::default(), catalog),
            };
            problems.extend(fed.map(|graph| test.misfits(&graph)).unwrap_or_default());
        }
        problems
    }
}

fn unreadable(path: &Path, error: &std::io::Error) -> Problem {
    problem(code::MISSING_FILE, path, String::new(), format!("cannot read the file: {error}"))
}

/// A problem of a whole file; if it is about a place in it, its message says where.
fn problem(code: &'static str, path: &Path, text: String, message: String) -> Problem {
    let source = Arc::new(Source { name: path.to_owned(), text });
    Problem::new(Severity::Error, code, (source, Span::default()), message)
}
