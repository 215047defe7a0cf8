//! Checks single `.ron` files of a project, for the command line and for editors.

use std::path::Path;
use std::sync::Arc;

use maquette_format::handles;
use maquette_graph::catalog::Catalog;
use maquette_graph::{Graph, InputValues, Options};
use maquette_syntax::error::{Diagnostic, Severity, Source, Span, code};
use maquette_syntax::first_word;
use maquette_value::HandleSpace;

use crate::case;
use crate::case::TestFile;

/// The kind of a `.ron` file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileKind {
    Graph,
    Test,
    Handles,
    Sweep,
}

impl FileKind {
    pub fn detect(path: &Path, text: &str) -> Self {
        match first_word(text) {
            "Test" => Self::Test,
            "Sweep" => Self::Sweep,
            _ if path.to_string_lossy().ends_with(case::EXTENSION) => Self::Test,
            "Handles" | "[" => Self::Handles,
            _ => Self::Graph,
        }
    }

    /// Returns the errors and warnings of a file with this text. For a valid test file, also returns the test.
    pub fn diagnostics(
        self,
        path: &Path,
        text: String,
        catalog: &Catalog,
        options: &Options,
    ) -> (Vec<Diagnostic>, Option<TestFile>) {
        match self {
            Self::Graph => {
                let checked = Graph::load_text(path, text, catalog, options);
                let unused = checked.graph.as_ref().map(Graph::unused_warnings).unwrap_or_default();
                (checked.diagnostics.iter().chain(unused).cloned().collect(), None)
            }
            Self::Test => match case::read_text(path, text, catalog) {
                (Some(test), mut diagnostics) => {
                    let is_whole = diagnostics.is_empty();
                    let found = check_test(&test, catalog, options).into_iter();
                    diagnostics
                        .extend(found.filter(|it| !test.uncertain_parts.covers_diagnostic(it)));
                    (diagnostics, is_whole.then_some(test))
                }
                (None, diagnostics) => (diagnostics, None),
            },
            Self::Sweep => (crate::sweep::read_text(path, &text, catalog, options).1, None),
            Self::Handles => {
                let read = handles::read_ron(text.as_bytes(), HandleSpace::default());
                (
                    read.err()
                        .map(|error| {
                            file_diagnostic(
                                code::WRONG_VALUE,
                                path,
                                text.clone(),
                                error.to_string(),
                            )
                        })
                        .into_iter()
                        .collect(),
                    None,
                )
            }
        }
    }
}

/// Returns the errors of a test's graphs, each loaded with the settings of each case. Also returns an error for each part of the test that
/// does not fit its graph.
fn check_test(test: &TestFile, catalog: &Catalog, own: &Options) -> Vec<Diagnostic> {
    let mut diagnostics = Vec::new();
    for (case, graph) in
        (0..test.cases.len()).flat_map(|case| test.graphs.iter().map(move |graph| (case, graph)))
    {
        let load = |set: &[(String, String)]| {
            let set = own.set.iter().chain(set).cloned().collect();
            // Ignore pins, so that the nodes themselves are tested.
            Graph::load(graph, catalog, &Options { set, pins: false, ..own.clone() })
        };
        let checked = test.load_case(case, load);
        diagnostics.extend(checked.diagnostics);
        let Some(graph) = checked.graph.or_else(|| test.load_valid_settings(case, load)) else {
            continue;
        };
        diagnostics.extend(test.wrong_inputs(case, &graph));
        // A graph with inputs writes its outputs as files only after the inputs have values, so bind them.
        let fed = match graph.inputs().is_empty() {
            true => Ok(graph),
            false => graph.with_inputs(&InputValues::default(), catalog),
        };
        diagnostics.extend(fed.map(|graph| test.validate(&graph)).unwrap_or_default());
    }
    diagnostics
}

/// Creates an error about a whole file. A position, if the error has one, becomes a part of the message.
pub fn file_diagnostic(
    code: &'static str,
    path: &Path,
    text: String,
    message: String,
) -> Diagnostic {
    let source = Arc::new(Source { name: path.to_owned(), text });
    Diagnostic::new(Severity::Error, code, (source, Span::default()), message)
}
