//! Remembers the contents of watched files, to find out which file events are real changes.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use super::batch::FileState;

/// The content of a file, or the reason why there is none.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Content {
    Missing,
    Empty,
    /// The path exists, but cannot be read as a file.
    Unreadable(ErrorKind),
    Bytes(blake3::Hash),
}

impl Content {
    fn load(path: &Path) -> Self {
        Self::read(path).unwrap_or_else(|error| match error.kind() {
            ErrorKind::NotFound => Self::Missing,
            kind => Self::Unreadable(kind),
        })
    }

    fn read(path: &Path) -> std::io::Result<Self> {
        // Do not open a pipe, because that would block until a program writes to it.
        if !std::fs::metadata(path)?.is_file() {
            return Ok(Self::Unreadable(ErrorKind::InvalidInput));
        }
        let mut hasher = blake3::Hasher::new();
        hasher.update_reader(File::open(path)?)?;
        Ok(if hasher.count() == 0 { Self::Empty } else { Self::Bytes(hasher.finalize()) })
    }

    fn shape(&self) -> FileState {
        match self {
            Self::Missing | Self::Empty => FileState::Unfinished,
            Self::Unreadable(_) | Self::Bytes(_) => FileState::Complete,
        }
    }
}

/// The contents of all watched files: the present ones, and those at the last evaluation.
#[derive(Debug, Default)]
pub(crate) struct Contents {
    now: BTreeMap<PathBuf, Content>,
    at_last_evaluation: BTreeMap<PathBuf, Content>,
}

impl Contents {
    /// Reads the newly watched files, and forgets files that are not watched any more.
    pub(crate) fn keep<'a>(&mut self, watched: impl Iterator<Item = &'a Path>) {
        let watched: BTreeSet<&Path> = watched.collect();
        self.now.retain(|path, _| watched.contains(path.as_path()));
        self.at_last_evaluation.retain(|path, _| watched.contains(path.as_path()));
        for path in watched {
            if !self.now.contains_key(path) {
                let content = Content::load(path);
                self.at_last_evaluation.insert(path.to_owned(), content.clone());
                self.now.insert(path.to_owned(), content);
            }
        }
    }

    /// Reads a file again. Returns its state if its content has changed, otherwise `None`.
    pub(crate) fn refresh(&mut self, path: &Path) -> Option<FileState> {
        let before = self.now.get_mut(path)?;
        let content = Content::load(path);
        let shape = content.shape();
        let changed = *before != content;
        *before = content;
        changed.then_some(shape)
    }

    /// Returns those of the given files whose content has changed since the last evaluation. Records their contents as evaluated.
    pub(crate) fn take_changed(&mut self, paths: BTreeSet<PathBuf>) -> Vec<PathBuf> {
        let mut changed = Vec::new();
        for path in paths {
            let Some(content) = self.now.get(&path) else { continue };
            if self.at_last_evaluation.insert(path.clone(), content.clone()).as_ref()
                != Some(content)
            {
                changed.push(path);
            }
        }
        changed
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_new_content_is_a_change() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        let mut contents = Contents::default();
        contents.keep([path.as_path()].into_iter());
        assert_eq!(contents.refresh(&path), None);
        std::fs::write(&path, "one").unwrap();
        assert_eq!(contents.refresh(&path), Some(FileState::Complete));
        std::fs::write(&path, "one").unwrap();
        assert_eq!(contents.refresh(&path), None);
        std::fs::write(&path, "").unwrap();
        assert_eq!(contents.refresh(&path), Some(FileState::Unfinished));
    }

    #[test]
    fn a_restored_file_is_no_change() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        std::fs::write(&path, "one").unwrap();
        let mut contents = Contents::default();
        contents.keep([path.as_path()].into_iter());
        std::fs::remove_file(&path).unwrap();
        assert_eq!(contents.refresh(&path), Some(FileState::Unfinished));
        std::fs::write(&path, "one").unwrap();
        assert_eq!(contents.refresh(&path), Some(FileState::Complete));
        assert!(contents.take_changed([path.clone()].into()).is_empty());
        std::fs::write(&path, "two").unwrap();
        contents.refresh(&path);
        assert_eq!(contents.take_changed([path.clone()].into()), [path]);
    }
}
