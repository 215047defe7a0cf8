//! The record of a task: a file that contains its values, its results, and the hashes of its inputs.
//!
//! A record is up to date as long as its `key` and the hashes of its `files` have not changed. It does not depend on the cache, so the
//! machines of a farm need not share one. A changed comment in the graph does not change the `key`, so it causes no task to run again.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use maquette_engine::session::VerifiedStamp;
use maquette_engine::writing::{Destination, WriteError};
use maquette_graph::files::KnownFile;
use maquette_value::Hash;
use maquette_value::fs;
use serde::{Deserialize, Serialize};
use serde_json::Value as Json;

use crate::DisplayPath;

/// The subfolder for records in the folder of a batch.
pub(super) const FOLDER: &str = "tasks";

/// Returns the message that a file of a batch cannot be written.
pub(super) fn write_error(path: &Path, why: &dyn std::fmt::Display) -> String {
    let help = "make the folder writable, or choose another one with --out";
    format!("cannot write {}: {why}\n  = help: {help}", path.for_display())
}

/// The result of a task.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum State {
    Done,
    Failed,
}

impl State {
    pub(crate) fn word(self) -> &'static str {
        match self {
            Self::Done => "done",
            Self::Failed => "failed",
        }
    }
}

/// The record of a task. It is written after all other files of the task, so if it exists, the task is complete.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub(crate) struct Record {
    /// The version of the file format, which is 1.
    pub(crate) format: u32,
    pub(crate) name: String,
    pub(crate) state: State,
    /// The swept values, as written in the sweep, by name.
    pub(crate) values: Vec<(String, String)>,
    pub(crate) seconds: f64,
    /// True if the task failed because time, memory or disk space was short, or because a file could not be read or written. Then the next
    /// run of the batch tries the task again.
    #[serde(rename = "may_pass", default, skip_serializing_if = "std::ops::Not::not")]
    pub(crate) may_succeed_later: bool,
    /// The number of nodes by state.
    pub(crate) nodes: BTreeMap<String, usize>,
    pub(crate) outputs: Vec<Output>,
    /// The picture of the task for the contact sheet. It is stored next to the record.
    pub(crate) picture: Option<Output>,
    /// The diagnostics of the task, in the form that the option `--json` prints.
    pub(crate) problems: Vec<Json>,
    /// A hash of the graph with the values of the task, of the options for the picture, and of the program. `None` if the graph could not
    /// be read.
    pub(crate) key: Option<Hash>,
    /// The hash of each input file, by its path in the project. `None` for a missing file.
    pub(crate) files: BTreeMap<String, Option<Hash>>,
    /// The metadata that each input file had when it was read.
    pub(crate) as_read: Vec<KnownFile>,
}

/// An output file or the picture of a task.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub(crate) struct Output {
    /// The name of the output.
    pub(crate) name: String,
    /// The path of the file, relative to the folder of the batch.
    pub(crate) path: String,
    pub(crate) bytes: usize,
    pub(crate) hash: Hash,
    /// The metadata of the file after it was written. If it has not changed, the file is unchanged.
    #[serde(rename = "left")]
    pub(super) stamp: Option<VerifiedStamp>,
}

impl Record {
    /// Reads the record of a task. Returns `None` if there is none, or if it is invalid.
    pub(crate) fn read(out: &Path, task: &str) -> Option<Self> {
        let bytes = fs::read_no_follow(&record_path(out, task)).ok()?;
        serde_json::from_slice(&bytes).ok().filter(|it: &Self| it.format == 1 && it.name == task)
    }

    pub(super) fn write(
        &self,
        out: &Path,
        destination: &Destination<'_>,
    ) -> Result<(), WriteError> {
        let mut bytes = serde_json::to_vec_pretty(self).map_err(std::io::Error::from)?;
        bytes.push(b'\n');
        destination.write(&record_path(out, &self.name), &bytes).map(drop)
    }
}

/// Returns the path of the record of a task.
pub(super) fn record_path(out: &Path, task: &str) -> PathBuf {
    out.join(FOLDER).join(format!("{task}.json"))
}

/// Returns the text field `name` of a diagnostic that is given as JSON. Returns an empty text if the field is missing.
pub(crate) fn text_field<'p>(problem: &'p Json, name: &str) -> &'p str {
    problem[name].as_str().unwrap_or_default()
}

/// Returns the path of the picture of a task.
pub(super) fn picture_path(out: &Path, task: &str) -> PathBuf {
    out.join(FOLDER).join(format!("{task}.jpg"))
}
