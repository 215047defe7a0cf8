//! Options for reading a graph.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use maquette_syntax::paths::without_dots;
use maquette_value::fs;

pub fn folder_of(path: &Path) -> PathBuf {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    let folder = folder.unwrap_or(Path::new("."));
    std::fs::canonicalize(folder).unwrap_or_else(|_| folder.to_owned())
}

/// Options for reading a graph.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// Folders outside of the project from which the graph may read files.
    pub roots: Vec<PathBuf>,
    /// Values that replace defaults of parameters and fields of nodes. Each pair is a target, `name` or `node.field`, and a value in RON.
    pub set: Vec<(String, String)>,
    /// True to use the draft value of each `Draft(final: .., draft: ..)`. Results computed from different values have different cache keys,
    /// so a final run never uses the result of a draft.
    pub draft: bool,
    /// True to use the pinned results that are stored next to the graph's file, instead of computing the pinned nodes.
    pub pins: bool,
    /// Requirements for the files that the graph reads.
    pub files: Files,
    /// Texts that replace the content of graph files, by path, such as the unsaved texts of an editor.
    pub texts: BTreeMap<PathBuf, String>,
    /// True to report an error if a used graph differs from its state in the lock file. Otherwise a difference is a warning.
    pub locked: bool,
}

impl Options {
    /// Adds a text that replaces the content of the graph file at this path.
    #[must_use]
    pub fn with_text(mut self, path: impl Into<PathBuf>, text: impl Into<String>) -> Self {
        self.texts.insert(path.into(), text.into());
        self
    }

    /// Returns the options as command-line options. The option for pins is not included.
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

    /// Returns the content of the graph file at this path, or the text that replaces it.
    pub fn text(&self, path: &Path) -> std::io::Result<String> {
        match self.text_in_place_of(path) {
            Some(text) => Ok(text.clone()),
            None => fs::read_text(path),
        }
    }

    /// Returns the text that replaces a file. Different spellings of one path are recognized.
    fn text_in_place_of(&self, path: &Path) -> Option<&String> {
        let texts = Some(&self.texts).filter(|texts| !texts.is_empty())?;
        texts
            .get(path)
            .or_else(|| texts.get(&without_dots(path)))
            .or_else(|| texts.get(&std::fs::canonicalize(path).ok()?))
    }

    /// Returns true if a text replaces the file at this path.
    pub fn has_text(&self, path: &Path) -> bool {
        self.text_in_place_of(path).is_some()
    }
}

/// Requirements for the files that a graph reads.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Files {
    /// Files must exist, and must be inside of the project.
    #[default]
    Needed,
    /// Files may be missing, but must be inside of the project. For editing a graph.
    Inside,
    /// Files are not checked. For reading a graph without evaluating it.
    Ignored,
}

/// A file that a node of a graph reads.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReadFile {
    /// The path of the file, which may be missing.
    pub path: PathBuf,
    /// The name of the node that reads the file.
    pub node: String,
    /// True if the node can run without the file.
    pub optional: bool,
}
