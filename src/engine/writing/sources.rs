//! The source files of a graph: files made by people, which results must not replace.

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use maquette_graph::{CheckedGraph, Graph};
use maquette_syntax::paths::{MARKER, folder_of_new};

const TEXT: &str = "the graph consists of this file";
const READ: &str = "the graph reads this file";

/// The files of which graphs consist, and the files that graphs read. Each path has a description of how the file is used.
#[derive(Clone, Debug, Default)]
pub struct Sources(BTreeMap<PathBuf, &'static str>);

impl Sources {
    /// Collects the files of a graph.
    pub fn of_graph(graph: &Graph) -> Self {
        let mut sources = Self::default();
        graph.texts().for_each(|path| sources.add(path, TEXT));
        graph.files().for_each(|path| sources.add(path, READ));
        sources
    }

    /// Collects the files of a graph that was loaded from `path`, even if the graph has errors.
    pub fn of_checked(path: &Path, checked: &CheckedGraph) -> Self {
        let mut sources = Self::default();
        let texts = [path].into_iter().chain(checked.subgraphs.iter().map(|path| &**path));
        texts.for_each(|path| sources.add(path, TEXT));
        checked.files.iter().for_each(|file| sources.add(&file.path, READ));
        sources
    }

    /// Adds a file. `what` describes how the file is used.
    pub fn add(&mut self, path: &Path, what: &'static str) {
        if let Some(path) = real(path) {
            self.0.entry(path).or_insert(what);
        }
    }

    /// Adds all files of `other`.
    pub fn extend(&mut self, other: &Self) {
        self.0.extend(other.0.iter().map(|(path, what)| (path.clone(), *what)));
    }

    /// Returns the description of how a file is used, or `None` if the file may be replaced.
    pub(super) fn use_of(&self, path: &Path) -> Option<&'static str> {
        let path = real(path)?;
        let is_text = path.extension().is_some_and(|extension| extension == "ron")
            || path.file_name() == Some(OsStr::new(MARKER));
        self.0.get(&path).copied().or_else(|| {
            (is_text && path.exists()).then_some("graphs and tests are written by people")
        })
    }
}

/// Returns a path without symbolic links and dots, or `None` if the path has no file name. The file or folder need not exist yet. For
/// example, `new/../scan.ply` becomes `scan.ply`, because the path will lead to that file once the folder `new` exists.
fn real(path: &Path) -> Option<PathBuf> {
    fn without_parent_links(path: &Path) -> Option<PathBuf> {
        Some(folder_of_new(path).join(path.file_name()?))
    }
    fn canonical(path: &Path) -> Option<PathBuf> {
        std::fs::canonicalize(path).ok()
    }
    canonical(path)
        .or_else(|| without_parent_links(path).map(|path| canonical(&path).unwrap_or(path)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_recognized_by_any_path_even_through_future_folders() {
        let folder = tempfile::tempdir().unwrap();
        fn path_in(name: &str, folder: &tempfile::TempDir) -> PathBuf {
            folder.path().join(name)
        }
        for name in ["scan.ply", "other.ron", "mine.ply"] {
            std::fs::write(path_in(name, &folder), "").unwrap();
        }
        let mut sources = Sources::default();
        sources.add(&path_in("scan.ply", &folder), READ);
        sources.add(&path_in("new.ply", &folder), READ);
        for way in ["", "./", "x/../", "x/y/../../", "x/./../"] {
            let use_of = |name: &str| sources.use_of(&path_in(&format!("{way}{name}"), &folder));
            assert_eq!(use_of("scan.ply"), Some(READ), "{way}");
            assert_eq!(use_of("new.ply"), Some(READ), "{way}");
            assert!(use_of("other.ron").is_some(), "{way}");
            assert_eq!(use_of("mine.ply"), None, "{way}");
        }
    }
}
