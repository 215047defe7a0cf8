//! What people made: no result may replace it.

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use maquette_graph::{Checked, Graph};
use maquette_syntax::paths::{MARKER, folder_of_new};

const TEXT: &str = "the graph is made of this file";
const READ: &str = "the graph reads this file";

/// The files that graphs are made of and that they read, and which of both it is.
#[derive(Clone, Debug, Default)]
pub struct Sources(BTreeMap<PathBuf, &'static str>);

impl Sources {
    /// Those of a graph.
    pub fn of(graph: &Graph) -> Self {
        let mut sources = Self::default();
        graph.texts().for_each(|path| sources.add(path, TEXT));
        graph.files().for_each(|path| sources.add(path, READ));
        sources
    }

    /// Those of a graph that was checked and may be broken.
    pub fn of_checked(path: &Path, checked: &Checked) -> Self {
        let mut sources = Self::default();
        let texts = [path].into_iter().chain(checked.subgraphs.iter().map(|path| &**path));
        texts.for_each(|path| sources.add(path, TEXT));
        checked.files.iter().for_each(|file| sources.add(&file.path, READ));
        sources
    }

    /// One more file, and what it is.
    pub fn add(&mut self, path: &Path, what: &'static str) {
        if let Some(path) = real(path) {
            self.0.entry(path).or_insert(what);
        }
    }

    /// All of another list.
    pub fn extend(&mut self, other: &Self) {
        self.0.extend(other.0.iter().map(|(path, what)| (path.clone(), *what)));
    }

    /// What a file is that must not be replaced.
    pub(super) fn use_of(&self, path: &Path) -> Option<&'static str> {
        let path = real(path)?;
        let is_text = path.extension().is_some_and(|ending| ending == "ron")
            || path.file_name() == Some(OsStr::new(MARKER));
        let by_people =
            || (is_text && path.exists()).then_some("graphs and tests are made by people");
        self.0.get(&path).copied().or_else(by_people)
    }
}

/// The path without links and dots, also of a file that is not there yet, or whose folder is not: `new/../scan.ply` is `scan.ply` once that
/// folder has been made.
fn real(path: &Path) -> Option<PathBuf> {
    fn whole(path: &Path) -> Option<PathBuf> {
        Some(folder_of_new(path).join(path.file_name()?))
    }
    fn there(path: &Path) -> Option<PathBuf> {
        std::fs::canonicalize(path).ok()
    }
    there(path).or_else(|| whole(path).map(|path| there(&path).unwrap_or(path)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_known_by_any_way_to_it_also_by_one_that_will_be_there() {
        let folder = tempfile::tempdir().unwrap();
        fn at(name: &str, folder: &tempfile::TempDir) -> PathBuf {
            folder.path().join(name)
        }
        for name in ["scan.ply", "other.ron", "mine.ply"] {
            std::fs::write(at(name, &folder), "").unwrap();
        }
        let mut sources = Sources::default();
        sources.add(&at("scan.ply", &folder), READ);
        sources.add(&at("new.ply", &folder), READ);
        for way in ["", "./", "x/../", "x/y/../../", "x/./../"] {
            let use_of = |name: &str| sources.use_of(&at(&format!("{way}{name}"), &folder));
            assert_eq!(use_of("scan.ply"), Some(READ), "{way}");
            assert_eq!(use_of("new.ply"), Some(READ), "{way}");
            assert!(use_of("other.ron").is_some(), "{way}");
            assert_eq!(use_of("mine.ply"), None, "{way}");
        }
    }
}
