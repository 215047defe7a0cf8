//! The native module of maquette for Python: graphs, runs and values, which the package `maquette` wraps.
//!
//! Users do not call this module: names, defaults, documentation and convenience functions are in `python/maquette/`.

mod column;
mod graph;
mod plain;
mod run;
mod session;
mod value;
mod workers;

use std::ffi::OsString;
use std::path::PathBuf;
use std::sync::{Arc, LazyLock};

use maquette::Catalog;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::value::Value;

/// The catalog of the built-in packs.
static CATALOG: LazyLock<Arc<Catalog>> =
    LazyLock::new(|| Arc::new(Catalog::new(maquette_nodes::PACKS)));

/// Describes all nodes and value types, in the format of `maquette nodes --json`.
#[pyfunction]
fn catalog(py: Python<'_>) -> PyResult<Bound<'_, PyAny>> {
    plain::from_json(py, &CATALOG.to_json())
}

/// Reads a value from a file, of type `kind` if it is given. Returns the value and the warnings of the reader.
#[pyfunction]
fn read(py: Python<'_>, path: PathBuf, kind: Option<&str>) -> PyResult<(Value, Vec<String>)> {
    let kind = kind.map(value::kind_of).transpose()?;
    let read = workers::until_signal(py, move || CATALOG.read(&path, kind))?;
    read.map(|(value, doubts)| (Value::new(value), doubts)).map_err(PyValueError::new_err)
}

/// Runs the command line with these arguments, of which the first is the program's name. Returns the exit code.
#[pyfunction]
fn command_line(py: Python<'_>, words: Vec<OsString>) -> u8 {
    py.detach(|| maquette_cli::run(maquette_nodes::PACKS, words))
}

/// The Python module `_maquette`.
#[pymodule]
mod _maquette {
    #[pymodule_export]
    use super::column::Column;
    #[pymodule_export]
    use super::graph::Graph;
    #[pymodule_export]
    use super::run::Finished;
    #[pymodule_export]
    use super::session::{Cancel, Session, finish_all};
    #[pymodule_export]
    use super::value::{Value, make};
    #[pymodule_export]
    use super::{catalog, command_line, read};

    /// The version of the engine.
    #[pymodule_export]
    const VERSION: &str = env!("CARGO_PKG_VERSION");
}
