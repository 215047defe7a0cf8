//! The `.ron` files of a project one by one: what each is, and every problem of it. The command line and editors are told the same.

use std::path::Path;
use std::sync::Arc;

use maquette_format::handles;
use maquette_graph::catalog::Catalog;
use maquette_graph::{Graph, InputValues, Options};
use maquette_syntax::error::{Problem, Severity, Source, Span, code};
use maquette_syntax::first_word;
use maquette_value::HandleSpace;

use crate::case;
use crate::case::TestFile;

/// What the `.ron` files of a project are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileKind {
    Graph,
    Test,
    Handles,
    Sweep,
}

impl FileKind {
    pub fn of(path: &Path, text: &str) -> Self {
        match first_word(text) {
            "Test" => Self::Test,
            "Sweep" => Self::Sweep,
            _ if path.to_string_lossy().ends_with(case::ENDING) => Self::Test,
            "Handles" | "[" => Self::Handles,
            _ => Self::Graph,
        }
    }

    /// The problems of a file with this text, and the test if it is one that can be read.
    pub fn problems(
        self,
        path: &Path,
        text: String,
        catalog: &Catalog,
        options: &Options,
    ) -> (Vec<Problem>, Option<TestFile>) {
        match self {
            Self::Graph => {
                let checked = Graph::load_text(path, text, catalog, options);
                let unused = checked.graph.as_ref().map(Graph::unused).unwrap_or_default();
                (checked.problems.iter().chain(unused).cloned().collect(), None)
            }
            Self::Test => match case::read_text(path, text, catalog) {
                (Some(test), mut problems) => {
                    let is_whole = problems.is_empty();
                    let found = of_test(&test, catalog, options).into_iter();
                    problems.extend(found.filter(|it| !test.doubts.cover_problem(it)));
                    (problems, is_whole.then_some(test))
                }
                (None, problems) => (problems, None),
            },
            Self::Sweep => (crate::sweep::read_text(path, &text, catalog, options).1, None),
            Self::Handles => {
                let read = handles::read_ron(text.as_bytes(), HandleSpace::default());
                (
                    read.err()
                        .map(|error: handles::HandlesFileError| {
                            of_file(code::WRONG_VALUE, path, text.clone(), error.to_string())
                        })
                        .into_iter()
                        .collect(),
                    None,
                )
            }
        }
    }
}

/// The problems of the graphs that a test is about, with what each of its cases sets, and what of the test does not fit them.
fn of_test(test: &TestFile, catalog: &Catalog, own: &Options) -> Vec<Problem> {
    let mut problems = Vec::new();
    for (case, graph) in
        (0..test.cases.len()).flat_map(|case| test.graphs.iter().map(move |graph| (case, graph)))
    {
        let load = |set: &[(String, String)]| {
            let set = own.set.iter().chain(set).cloned().collect();
            // Tests are judged without pins.
            Graph::load(graph, catalog, &Options { set, pins: false, ..own.clone() })
        };
        let checked = test.loaded(case, load);
        problems.extend(checked.problems);
        let Some(graph) = checked.graph.or_else(|| test.loaded_with_what_fits(case, load)) else {
            continue;
        };
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

/// A problem of a whole file; if it is about a place in it, its message says where.
pub fn of_file(code: &'static str, path: &Path, text: String, message: String) -> Problem {
    let source = Arc::new(Source { name: path.to_owned(), text });
    Problem::new(Severity::Error, code, (source, Span::default()), message)
}
