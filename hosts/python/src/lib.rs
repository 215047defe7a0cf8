//! The engine for Python: graphs, runs and values as the package `maquette` wraps them.
//!
//! Nothing here is for users: names, defaults, documentation and what is convenient are in `python/maquette/`.

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

/// What the built-in packs offer.
static CATALOG: LazyLock<Arc<Catalog>> =
    LazyLock::new(|| Arc::new(Catalog::new(maquette_nodes::PACKS)));

/// All nodes and types of values, as `maquette nodes --json` prints them.
#[pyfunction]
fn catalog(py: Python<'_>) -> PyResult<Bound<'_, PyAny>> {
    plain::from_json(py, &CATALOG.to_json())
}

/// The value in a file, of this type if there is one, and the doubts of its reader.
#[pyfunction]
fn read(py: Python<'_>, path: PathBuf, kind: Option<&str>) -> PyResult<(Value, Vec<String>)> {
    let kind = kind.map(value::kind_of).transpose()?;
    let read = workers::until_signal(py, move || CATALOG.read(&path, kind))?;
    read.map(|(value, doubts)| (Value::new(value), doubts)).map_err(PyValueError::new_err)
}

/// The whole command line with these words, the first of which is the program's name; gives its exit code.
#[pyfunction]
fn command_line(py: Python<'_>, words: Vec<OsString>) -> u8 {
    py.detach(|| maquette_cli::run(maquette_nodes::PACKS, words))
}

/// The engine.
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
