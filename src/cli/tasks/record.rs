//! What a task leaves: one file that says which values it had, what came of it and what it was made of.
//!
//! A record is valid as long as its `key` and the hashes of its `files` are unchanged, whatever is in the cache. So machines of a farm need
//! no common cache, and a changed comment runs nothing.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use maquette_engine::session::Left;
use maquette_engine::writing::{Destination, Refused};
use maquette_graph::files::KnownFile;
use maquette_value::Hash;
use maquette_value::plain;
use serde::{Deserialize, Serialize};
use serde_json::Value as Json;

use crate::Shown;

/// The folder of records in that of a batch.
pub(super) const FOLDER: &str = "tasks";

/// Says that a file of a batch cannot be written, and what to do.
pub(super) fn unwritten(path: &Path, why: &dyn std::fmt::Display) -> String {
    let help = "make the folder writable, or choose another one with --out";
    format!("cannot write {}: {why}\n  = help: {help}", path.shown())
}

/// How a task ended.
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

/// What a task leaves. It is written when all else of the task is there: who finds it finds a task that came to its end.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub(crate) struct Record {
    /// 1.
    pub(crate) format: u32,
    pub(crate) name: String,
    pub(crate) state: State,
    /// What was swept, by name, as its author writes it.
    pub(crate) values: Vec<(String, String)>,
    pub(crate) seconds: f64,
    /// Whether it failed for want of time, memory or disk space, or because a file could not be read or written: then it is tried again.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub(crate) may_pass: bool,
    /// How many nodes came to which end.
    pub(crate) nodes: BTreeMap<String, usize>,
    pub(crate) outputs: Vec<Output>,
    /// What the contact sheet shows, beside this file.
    pub(crate) picture: Option<Output>,
    /// As `--json` tells them.
    pub(crate) problems: Vec<Json>,
    /// The hash of the graph with these values, of what is shown, and of the program; none where the graph could not be read.
    pub(crate) key: Option<Hash>,
    /// The files that were read, by their paths in the project.
    pub(crate) files: BTreeMap<String, Option<Hash>>,
    /// What the system said of them.
    pub(crate) as_read: Vec<KnownFile>,
}

/// A file that a task has written, or its picture.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub(crate) struct Output {
    /// The name of the output.
    pub(crate) name: String,
    /// In the batch's folder.
    pub(crate) path: String,
    pub(crate) bytes: usize,
    pub(crate) hash: Hash,
    /// The file as it was left.
    pub(super) left: Option<Left>,
}

impl Record {
    /// The record of a task; none if there is none that can be read.
    pub(crate) fn read(out: &Path, task: &str) -> Option<Self> {
        let bytes = plain::read_own(&path(out, task)).ok()?;
        serde_json::from_slice(&bytes).ok().filter(|it: &Self| it.format == 1 && it.name == task)
    }

    pub(super) fn write(&self, out: &Path, destination: &Destination<'_>) -> Result<(), Refused> {
        let mut bytes = serde_json::to_vec_pretty(self).map_err(std::io::Error::from)?;
        bytes.push(b'\n');
        destination.write(&path(out, &self.name), &bytes).map(drop)
    }
}

/// Where the record of a task is.
pub(super) fn path(out: &Path, task: &str) -> PathBuf {
    out.join(FOLDER).join(format!("{task}.json"))
}

/// Where the picture of a task is.
pub(super) fn picture_path(out: &Path, task: &str) -> PathBuf {
    out.join(FOLDER).join(format!("{task}.jpg"))
}
