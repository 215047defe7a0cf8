//! The contents of watched files, so that events without a change are dropped.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use super::batch::Shape;

/// What is known of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Content {
    Missing,
    Empty,
    /// There is something, but no file that can be read.
    Unreadable(ErrorKind),
    Bytes(blake3::Hash),
}

impl Content {
    fn of(path: &Path) -> Self {
        Self::read(path).unwrap_or_else(|error| match error.kind() {
            ErrorKind::NotFound => Self::Missing,
            kind => Self::Unreadable(kind),
        })
    }

    fn read(path: &Path) -> std::io::Result<Self> {
        // Opening a pipe would wait for its writer.
        if !std::fs::metadata(path)?.is_file() {
            return Ok(Self::Unreadable(ErrorKind::InvalidInput));
        }
        let mut hasher = blake3::Hasher::new();
        hasher.update_reader(File::open(path)?)?;
        Ok(if hasher.count() == 0 { Self::Empty } else { Self::Bytes(hasher.finalize()) })
    }

    fn shape(&self) -> Shape {
        match self {
            Self::Missing | Self::Empty => Shape::Unfinished,
            Self::Unreadable(_) | Self::Bytes(_) => Shape::Whole,
        }
    }
}

/// What every watched file holds now, and what it held when a change was last acted on.
#[derive(Debug, Default)]
pub(crate) struct Contents {
    now: BTreeMap<PathBuf, Content>,
    acted_on: BTreeMap<PathBuf, Content>,
}

impl Contents {
    /// Reads files that were not known yet, and forgets those that are no longer wanted.
    pub(crate) fn keep<'a>(&mut self, wanted: impl Iterator<Item = &'a Path>) {
        let wanted: BTreeSet<&Path> = wanted.collect();
        self.now.retain(|path, _| wanted.contains(path.as_path()));
        self.acted_on.retain(|path, _| wanted.contains(path.as_path()));
        for path in wanted {
            if !self.now.contains_key(path) {
                let content = Content::of(path);
                self.acted_on.insert(path.to_owned(), content.clone());
                self.now.insert(path.to_owned(), content);
            }
        }
    }

    /// Reads a file again: whether what it holds has changed, and into what.
    pub(crate) fn refresh(&mut self, path: &Path) -> Option<Shape> {
        let before = self.now.get_mut(path)?;
        let content = Content::of(path);
        let shape = content.shape();
        let changed = *before != content;
        *before = content;
        changed.then_some(shape)
    }

    /// Which of these files hold something else than when this was last asked of them.
    pub(crate) fn act_on(&mut self, paths: BTreeSet<PathBuf>) -> Vec<PathBuf> {
        let mut changed = Vec::new();
        for path in paths {
            let Some(content) = self.now.get(&path) else { continue };
            if self.acted_on.insert(path.clone(), content.clone()).as_ref() != Some(content) {
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
    fn only_another_content_is_a_change() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        let mut contents = Contents::default();
        contents.keep([path.as_path()].into_iter());
        assert_eq!(contents.refresh(&path), None);
        std::fs::write(&path, "one").unwrap();
        assert_eq!(contents.refresh(&path), Some(Shape::Whole));
        std::fs::write(&path, "one").unwrap();
        assert_eq!(contents.refresh(&path), None);
        std::fs::write(&path, "").unwrap();
        assert_eq!(contents.refresh(&path), Some(Shape::Unfinished));
    }

    #[test]
    fn a_file_that_comes_back_as_it_was_needs_no_action() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        std::fs::write(&path, "one").unwrap();
        let mut contents = Contents::default();
        contents.keep([path.as_path()].into_iter());
        std::fs::remove_file(&path).unwrap();
        assert_eq!(contents.refresh(&path), Some(Shape::Unfinished));
        std::fs::write(&path, "one").unwrap();
        assert_eq!(contents.refresh(&path), Some(Shape::Whole));
        assert!(contents.act_on([path.clone()].into()).is_empty());
        std::fs::write(&path, "two").unwrap();
        contents.refresh(&path);
        assert_eq!(contents.act_on([path.clone()].into()), [path]);
    }
}
