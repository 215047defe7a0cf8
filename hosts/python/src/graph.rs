//! Graphs that have been checked.

use std::collections::HashMap;
use std::path::PathBuf;

use maquette::Options;
use pyo3::exceptions::PyKeyError;
use pyo3::prelude::*;
use pyo3::types::PyList;

use crate::workers::on_threads;
use crate::{CATALOG, plain};

/// A graph, checked, and how it was read.
#[pyclass(frozen)]
pub(crate) struct Graph {
    pub(crate) graph: maquette::Graph,
    #[pyo3(get)]
    path: PathBuf,
}

/// What a check found: the graph if it can be run, problems, and the files of graphs that it uses.
type Loaded<'py> = (Option<Graph>, Bound<'py, PyList>, Vec<PathBuf>);

#[pymethods]
impl Graph {
    /// Reads and checks a graph. `texts` stand in place of files, by path.
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
    ) -> PyResult<Loaded<'py>> {
        let texts = texts.into_iter().collect();
        let options = Options { roots, set, texts, draft, pins, locked, ..Options::default() };
        let checked =
            on_threads(py, || maquette::Graph::load(&path, &CATALOG, &options).as_far_as_known())?;
        let problems = plain::problems(py, &checked.problems)?;
        let graph = checked.graph.map(|graph| Self { graph, path });
        Ok((graph, problems, checked.subgraphs))
    }

    /// What it is for, in its author's words.
    #[getter]
    fn doc(&self) -> &str {
        self.graph.doc()
    }

    /// Its text.
    #[getter]
    fn text(&self) -> &str {
        self.graph.source_text()
    }

    /// The names of its nodes, each after those that it hangs on.
    #[getter]
    fn nodes(&self) -> Vec<&str> {
        self.graph.node_names().collect()
    }

    /// Its inputs and parameters as a JSON schema.
    fn schema<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        plain::from_json(py, self.graph.schema())
    }

    /// The names, types and words of its inputs.
    fn inputs(&self) -> Vec<(&str, &'static str, &str)> {
        let inputs = self.graph.inputs().iter();
        inputs.map(|input| (&input.name[..], input.kind.name, &input.doc[..])).collect()
    }

    /// The names and types of what it gives.
    fn results(&self) -> Vec<(&str, Option<&'static str>)> {
        self.graph.results().map(|(name, kind)| (name, kind.map(|kind| kind.name))).collect()
    }

    /// Warnings of nodes that nothing needs.
    fn unused<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        plain::problems(py, self.graph.unused())
    }

    /// A value for a parameter as RON.
    fn as_ron(&self, parameter: &str, value: &Bound<'_, PyAny>) -> PyResult<String> {
        let unknown = || PyKeyError::new_err(parameter.to_owned());
        self.graph.as_ron(parameter, &plain::to_json(value)?).ok_or_else(unknown)
    }

    /// The picture of the graph.
    fn svg(&self) -> String {
        maquette::diagram::to_svg(&self.graph, &CATALOG)
    }

    /// Its text with values put into it, or the problems that these would make.
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
            maquette::edit::edited(&self.path, text, &values, &CATALOG, &options)
        })?;
        match edited {
            Ok(edited) => Ok((Some(edited.text), PyList::empty(py))),
            Err(problems) => Ok((None, plain::problems(py, &problems)?)),
        }
    }
}
