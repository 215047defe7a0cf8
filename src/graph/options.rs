//! What shapes the reading of a graph, beside its file.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use maquette_syntax::paths::without_dots;
use maquette_value::plain;

pub fn folder_of(path: &Path) -> PathBuf {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    let folder = folder.unwrap_or(Path::new("."));
    std::fs::canonicalize(folder).unwrap_or_else(|_| folder.to_owned())
}

/// What shapes the reading of a graph, beside its file.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// Folders outside of the project that the graph may read.
    pub roots: Vec<PathBuf>,
    /// Values in place of defaults and fields: (`name` or `node.field`, RON).
    pub set: Vec<(String, String)>,
    /// Whether each `Draft(final: .., draft: ..)` stands for its draft. What is computed from another value has another key, so that a
    /// final run never takes what a draft gave.
    pub draft: bool,
    /// Whether results that are pinned beside the graph's file stand in for their nodes.
    pub pins: bool,
    /// Whether the files that the graph reads must be there.
    pub files: Files,
    /// Texts that stand in place of files of graphs, by path: those that an editor has not saved yet.
    pub texts: BTreeMap<PathBuf, String>,
    /// Whether the graphs that it uses must be what the lock file beside it says; otherwise it is a warning if they are not.
    pub locked: bool,
}

impl Options {
    /// The same with a text in place of the file of a graph at this path.
    #[must_use]
    pub fn with_text(mut self, path: impl Into<PathBuf>, text: impl Into<String>) -> Self {
        self.texts.insert(path.into(), text.into());
        self
    }

    /// The words of a command that say the same of a graph, whether or not it has pins.
    pub fn words(&self) -> Vec<String> {
        let mut words = Vec::new();
        for (name, value) in &self.set {
            words.extend(["--set".to_owned(), format!("{name}={value}")]);
        }
        for root in &self.roots {
            words.extend(["--root".to_owned(), root.display().to_string()]);
        }
        let flags = [(self.draft, "--draft"), (self.locked, "--locked")];
        let flags = flags.into_iter().filter(|(is_set, _)| *is_set);
        words.extend(flags.map(|(_, flag)| flag.to_owned()));
        words
    }

    /// The text of a graph's file, or the one that stands in its place.
    pub fn text(&self, path: &Path) -> std::io::Result<String> {
        match self.text_in_place_of(path) {
            Some(text) => Ok(text.clone()),
            None => plain::read_text(path),
        }
    }

    /// However the path is written that leads there.
    fn text_in_place_of(&self, path: &Path) -> Option<&String> {
        let texts = Some(&self.texts).filter(|texts| !texts.is_empty())?;
        texts
            .get(path)
            .or_else(|| texts.get(&without_dots(path)))
            .or_else(|| texts.get(&std::fs::canonicalize(path).ok()?))
    }

    /// Whether a text stands in place of the file.
    pub fn has_text(&self, path: &Path) -> bool {
        self.text_in_place_of(path).is_some()
    }
}

/// What a check demands of the files that a graph reads.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Files {
    /// They must be there, inside of the project.
    #[default]
    Needed,
    /// They may be missing, but no other ones may be named than those inside of the project: the graph is edited.
    Inside,
    /// Nothing: the graph is looked at, not evaluated.
    Ignored,
}

/// A file that a node of a graph reads.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReadFile {
    /// Where it is, or would be.
    pub path: PathBuf,
    /// The name of the node.
    pub node: String,
    /// Whether the node can do without it.
    pub optional: bool,
}
