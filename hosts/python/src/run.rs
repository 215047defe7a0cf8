//! What a run gave.

use std::path::PathBuf;
use std::sync::Arc;

use maquette::{OutputFolder, Written};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyList;
use serde_json::Value as Json;

use crate::plain;
use crate::session::Host;
use crate::value::Value;

/// What a run gave.
#[pyclass(frozen)]
pub(crate) struct Finished {
    found: maquette::Finished,
    host: Arc<Host>,
}

impl Finished {
    pub(crate) fn new(found: maquette::Finished, host: Arc<Host>) -> Self {
        Self { found, host }
    }
}

#[pymethods]
impl Finished {
    /// The value of an output, a node or an output of a node.
    fn value(&self, name: &str) -> Option<Value> {
        self.found.value(name).cloned().map(Value::new)
    }

    /// What happened to each node.
    fn trace<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let nodes = self.found.trace().0.into_iter().map(|node| node.to_json());
        plain::from_json(py, &Json::Array(nodes.collect()))
    }

    /// What failed, what nodes warn of, and what does not hold.
    fn problems<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        plain::problems(py, &self.found.problems())
    }

    /// Writes the outputs to a folder, by default that of the graph's drafts or final results. Returns the files, and what could not be
    /// written.
    fn write<'py>(
        &self,
        py: Python<'py>,
        folder: Option<PathBuf>,
        graph: PathBuf,
        draft: bool,
    ) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyList>)> {
        let folder = if draft { OutputFolder::of_draft } else { OutputFolder::new }(
            folder.as_deref(),
            &graph,
        );
        if std::process::id() != self.host.process() {
            return Err(PyValueError::new_err(
                "a run of the parent process cannot be written by a child",
            ));
        }
        let write = || self.host.with(|session| session.write(&self.found, &folder));
        let (written, problems) = py.detach(write);
        let written = Json::Array(written.iter().map(Written::to_json).collect());
        Ok((plain::from_json(py, &written)?, plain::problems(py, &problems)?))
    }
}
