//! Checked graphs for Python.

use std::collections::HashMap;
use std::path::PathBuf;

use maquette::Options;
use pyo3::exceptions::PyKeyError;
use pyo3::prelude::*;
use pyo3::types::PyList;

use crate::workers::on_threads;
use crate::{CATALOG, plain};

/// A checked graph and its path.
#[pyclass(frozen)]
pub(crate) struct Graph {
    pub(crate) graph: maquette::Graph,
    #[pyo3(get)]
    path: PathBuf,
}

/// The result of a check: the graph if it can be run, the diagnostics, and the files of the graphs that it uses.
type LoadResult<'py> = (Option<Graph>, Bound<'py, PyList>, Vec<PathBuf>);

#[pymethods]
impl Graph {
    /// Reads and checks a graph. `texts` replaces the contents of files, by path.
    #[staticmethod]
    #[expect(clippy::too_many_arguments, reason = "the package calls it, with names")]
    fn load<'py>(
        py: Python<'py>,
        path: PathBuf,
        roots: Vec<PathBuf>,
        set: Vec<(String, String)>,
        texts: HashMap<PathBuf, String>,
        draft: bool,
        pins: bool,
        locked: bool,
    ) -> PyResult<LoadResult<'py>> {
        let texts = texts.into_iter().collect();
        let options = Options { roots, set, texts, draft, pins, locked, ..Options::default() };
        let checked = on_threads(py, || {
            maquette::Graph::load(&path, &CATALOG, &options).without_unknown_nodes()
        })?;
        let problems = plain::problems(py, &checked.diagnostics)?;
        let graph = checked.graph.map(|graph| Self { graph, path });
        Ok((graph, problems, checked.subgraphs))
    }

    /// The description that the graph's author wrote.
    #[getter]
    fn doc(&self) -> &str {
        self.graph.doc()
    }

    /// The source text of the graph file.
    #[getter]
    fn text(&self) -> &str {
        self.graph.source_text()
    }

    /// The names of all nodes; dependencies come first.
    #[getter]
    fn nodes(&self) -> Vec<&str> {
        self.graph.node_names().collect()
    }

    /// The inputs and parameters as a JSON schema.
    fn schema<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        plain::from_json(py, self.graph.schema())
    }

    /// The name, type and description of each input.
    fn inputs(&self) -> Vec<(&str, &'static str, &str)> {
        let inputs = self.graph.inputs().iter();
        inputs.map(|input| (&input.name[..], input.kind.name, &input.doc[..])).collect()
    }

    /// The name and type of each output.
    fn results(&self) -> Vec<(&str, Option<&'static str>)> {
        self.graph.results().map(|(name, kind)| (name, kind.map(|kind| kind.name))).collect()
    }

    /// Warnings about unused nodes.
    fn unused<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        plain::problems(py, self.graph.unused_warnings())
    }

    /// Formats a value for a parameter as RON.
    fn as_ron(&self, parameter: &str, value: &Bound<'_, PyAny>) -> PyResult<String> {
        let text = self.graph.as_ron(parameter, &plain::to_json(value)?);
        text.ok_or_else(|| PyKeyError::new_err(parameter.to_owned()))
    }

    /// The diagram of the graph as SVG.
    fn svg(&self) -> String {
        maquette::diagram::to_svg(&self.graph, &CATALOG)
    }

    /// Sets values in the graph's text. Returns the new text, or the errors that the values would cause.
    fn edited<'py>(
        &self,
        py: Python<'py>,
        values: Vec<(String, String)>,
        roots: Vec<PathBuf>,
        texts: HashMap<PathBuf, String>,
    ) -> PyResult<(Option<String>, Bound<'py, PyList>)> {
        let texts = texts.into_iter().collect();
        let options = Options { roots, texts, ..Options::default() };
        let edited = on_threads(py, || {
            let text = self.graph.source_text();
            maquette::edit::set_values(&self.path, text, &values, &CATALOG, &options)
        })?;
        match edited {
            Ok(edited) => Ok((Some(edited.text), PyList::empty(py))),
            Err(problems) => Ok((None, plain::problems(py, &problems)?)),
        }
    }
}
