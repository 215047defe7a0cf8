//! The results of runs for Python.

use std::path::PathBuf;
use std::sync::Arc;

use maquette::{CancelToken, OutputFile, OutputFolder};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyList;
use serde_json::Value as Json;

use crate::plain;
use crate::session::Host;
use crate::value::Value;
use crate::workers::on_a_thread;

/// The result of a run and the session that made it.
#[pyclass(frozen)]
pub(crate) struct Finished {
    found: Arc<maquette::RunResult>,
    host: Arc<Host>,
}

impl Finished {
    pub(crate) fn new(found: maquette::RunResult, host: Arc<Host>) -> Self {
        Self { found: Arc::new(found), host }
    }
}

#[pymethods]
impl Finished {
    /// Returns the value of an output, of a node, or of a node's output.
    fn value(&self, name: &str) -> Option<Value> {
        self.found.value(name).cloned().map(Value::new)
    }

    /// Returns the trace: the state of each node.
    fn trace<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let nodes = self.found.trace().0.into_iter().map(|node| node.to_json());
        let mut nodes = Json::Array(nodes.collect());
        plain::say_in_python(&mut nodes);
        plain::from_json(py, &nodes)
    }

    /// Returns errors, warnings of nodes, and failed expectations.
    fn problems<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        plain::problems(py, &self.found.diagnostics())
    }

    /// Writes the outputs in `only`, or all outputs if `only` is empty. If no folder is given, `draft` selects the graph's folder for draft
    /// results or that for final results. If `signs` is true, files record their provenance. Files in `kept` are not replaced. Returns the
    /// written files and the errors.
    #[expect(clippy::too_many_arguments, reason = "the package calls it, with names")]
    fn write<'py>(
        &self,
        py: Python<'py>,
        folder: Option<PathBuf>,
        graph: PathBuf,
        draft: bool,
        only: Vec<String>,
        signs: bool,
        kept: Vec<PathBuf>,
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
        let folder = folder.keeping(kept.iter().map(|path| &**path));
        let folder = if signs { folder } else { folder.without_provenance() };
        let cancel = CancelToken::default();
        let (host, found, token) = (self.host.clone(), self.found.clone(), cancel.clone());
        let done = on_a_thread(py, move || {
            host.with_session(|session| session.write(&found, &only, &folder, &token))
        });
        let (written, problems) = done.inspect_err(|_| cancel.cancel())?;
        let described = Json::Array(written.iter().map(OutputFile::to_json).collect());
        let described = plain::from_json(py, &described)?;
        for (file, description) in written.iter().zip(described.try_iter()?) {
            // The JSON description cannot contain a path that is not valid UTF-8.
            description?.set_item("path", file.path.as_os_str())?;
        }
        Ok((described, plain::problems(py, &problems)?))
    }
}
