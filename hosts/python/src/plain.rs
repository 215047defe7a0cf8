//! Converts JSON values and diagnostics to plain Python objects.

use maquette::Diagnostic;
use pyo3::IntoPyObjectExt;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList, PyString};
use serde_json::Value as Json;

/// Converts JSON to dicts, lists, strings, numbers, bools and None.
pub(crate) fn from_json<'py>(py: Python<'py>, json: &Json) -> PyResult<Bound<'py, PyAny>> {
    match json {
        Json::Null => Ok(py.None().into_bound(py)),
        Json::Bool(truth) => truth.into_bound_py_any(py),
        Json::Number(number) => match (number.as_i64(), number.as_u64()) {
            (Some(whole), _) => whole.into_bound_py_any(py),
            (_, Some(whole)) => whole.into_bound_py_any(py),
            _ => number.as_f64().into_bound_py_any(py),
        },
        Json::String(text) => text.into_bound_py_any(py),
        Json::Array(items) => {
            let items = items.iter().map(|item| from_json(py, item));
            Ok(PyList::new(py, items.collect::<PyResult<Vec<_>>>()?)?.into_any())
        }
        Json::Object(entries) => {
            let dict = PyDict::new(py);
            for (name, entry) in entries {
                dict.set_item(name, from_json(py, entry)?)?;
            }
            Ok(dict.into_any())
        }
    }
}

/// Maximum nesting of lists in the value of a parameter. A limit is needed, because a list may contain itself.
const MAX_DEPTH: usize = 32;

/// Converts the value of a parameter to JSON.
///
/// # Errors
/// If a string is not valid Unicode, lists are nested too deeply, or the value is neither a number, a string nor a list.
pub(crate) fn to_json(value: &Bound<'_, PyAny>) -> PyResult<Json> {
    to_json_at(value, 0)
}

fn to_json_at(value: &Bound<'_, PyAny>, depth: usize) -> PyResult<Json> {
    if value.is_none() {
        return Ok(Json::Null);
    }
    if let Ok(truth) = value.extract::<bool>() {
        return Ok(truth.into());
    }
    if let Ok(whole) = value.extract::<i64>() {
        return Ok(whole.into());
    }
    if let Ok(number) = value.extract::<f64>() {
        return Ok(number.into());
    }
    // A string is also a sequence of strings. If its text cannot be read, this is an error; it must not be treated as a list.
    if let Ok(text) = value.cast::<PyString>() {
        return Ok(text.to_cow()?.into());
    }
    if depth == MAX_DEPTH {
        return Err(PyValueError::new_err("lists are nested too deeply"));
    }
    let items = value.try_iter()?.map(|item| to_json_at(&item?, depth + 1));
    Ok(Json::Array(items.collect::<PyResult<_>>()?))
}

/// Replacements of command line options in messages of runs by the arguments of the Python functions.
const WORDS: [(&str, &str); 7] = [
    ("--out chooses another folder", "`write(folder)` chooses another folder"),
    ("--cache chooses another folder", "`load(cache=..)` chooses another folder"),
    ("--cache-remote", "`cache_remote`"),
    ("ask for less at a time (--only)", "ask for less at a time, by `run(outputs)`"),
    ("or allow more (--max-memory)", "or allow more by `load(max_memory=..)`"),
    ("; --set changes parameters", "; `run(name=value)` changes parameters"),
    ("--set ", ""),
];

/// Replacements in messages of the check. Only the field `text` is replaced, so the other fields equal those of `maquette check --json`.
const WORDS_OF_CHECK: [(&str, &str); 3] = [
    ("--out chooses the folder", "`write(folder)` chooses the folder"),
    ("or allow its folder with --root", "or allow its folder by `load(roots=..)`"),
    ("`maquette run --input ", "`run(inputs=..)`, or `maquette run --input "),
];

/// Replaces command line options in a text.
fn replace_words(text: &str, words: &[(&str, &str)]) -> String {
    words.iter().fold(text.to_owned(), |text, (from, to)| text.replace(from, to))
}

/// Replaces command line options in a warning about the cache.
pub(crate) fn trouble(text: &str) -> String {
    replace_words(text, &WORDS)
}

/// Replaces command line options in all strings of a JSON value.
pub(crate) fn say_in_python(json: &mut Json) {
    match json {
        Json::String(text) if text.contains("--") => *text = replace_words(text, &WORDS),
        Json::Array(items) => items.iter_mut().for_each(say_in_python),
        Json::Object(entries) => entries.values_mut().for_each(say_in_python),
        _ => {}
    }
}

/// Converts diagnostics to dicts. They have the fields of `--json` and the field `text`, the message as on a terminal.
pub(crate) fn problems<'py>(
    py: Python<'py>,
    problems: &[Diagnostic],
) -> PyResult<Bound<'py, PyList>> {
    PyList::new(
        py,
        problems
            .iter()
            .map(|problem| {
                let mut json = problem.to_json();
                json["text"] = replace_words(&problem.to_text(false), &WORDS_OF_CHECK).into();
                say_in_python(&mut json);
                from_json(py, &json)
            })
            .collect::<PyResult<Vec<_>>>()?,
    )
}
