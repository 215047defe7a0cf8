//! What people made: no result may replace it.

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use crate::graph::{Checked, Graph};
use crate::paths::MARKER;

const TEXT: &str = "the graph is made of this file";
const READ: &str = "the graph reads this file";

/// The files that graphs are made of and that they read, and which of both it is.
#[derive(Clone, Debug, Default)]
pub(crate) struct Sources(BTreeMap<PathBuf, &'static str>);

impl Sources {
    /// Those of a graph.
    pub(crate) fn of(graph: &Graph) -> Self {
        let mut sources = Self::default();
        graph.texts().for_each(|path| sources.add(path, TEXT));
        graph.files().for_each(|path| sources.add(path, READ));
        sources
    }

    /// Those of a graph that was checked and may be broken.
    pub(crate) fn of_checked(path: &Path, checked: &Checked) -> Self {
        let mut sources = Self::default();
        let texts = [path].into_iter().chain(checked.subgraphs.iter().map(|path| &**path));
        texts.for_each(|path| sources.add(path, TEXT));
        checked.files.iter().for_each(|file| sources.add(&file.path, READ));
        sources
    }

    /// One more file, and what it is.
    pub(crate) fn add(&mut self, path: &Path, what: &'static str) {
        if let Ok(path) = real(path) {
            self.0.entry(path).or_insert(what);
        }
    }

    /// All of another list.
    pub(crate) fn extend(&mut self, other: &Self) {
        self.0.extend(other.0.iter().map(|(path, what)| (path.clone(), *what)));
    }

    /// What a file is that must not be replaced.
    pub(super) fn use_of(&self, path: &Path) -> Option<&'static str> {
        let known = real(path).ok().and_then(|path| self.0.get(&path));
        let is_text = path.extension().is_some_and(|ending| ending == "ron")
            || path.file_name() == Some(OsStr::new(MARKER));
        let by_people =
            || (is_text && path.exists()).then_some("graphs and tests are made by people");
        known.copied().or_else(by_people)
    }
}

/// The path without links, also of a file that is not there yet.
fn real(path: &Path) -> std::io::Result<PathBuf> {
    std::fs::canonicalize(path).or_else(|error| {
        let name = path.file_name().ok_or(error)?;
        Ok(std::fs::canonicalize(super::beside(path))?.join(name))
    })
}
