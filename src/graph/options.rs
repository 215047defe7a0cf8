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
    /// Values that replace defaults and fields, as pairs of `name` or `node.field` and a value in RON.
    pub set: Vec<(String, String)>,
    /// True if each `Draft(final: .., draft: ..)` has its draft value. Results that are computed from different values have different keys,
    /// so a final run never uses the result of a draft.
    pub draft: bool,
    /// True if results that are pinned next to the graph's file replace the nodes that computed them.
    pub pins: bool,
    /// Requirements for the files that the graph reads.
    pub files: Files,
    /// Texts that replace the files of graphs, by path, such as the unsaved texts of an editor.
    pub texts: BTreeMap<PathBuf, String>,
    /// True if the used graphs must be equal to those in the lock file. Otherwise differences are only warnings.
    pub locked: bool,
}

impl Options {
    /// Adds a text that replaces the file of a graph, which is at this path.
    #[must_use]
    pub fn with_text(mut self, path: impl Into<PathBuf>, text: impl Into<String>) -> Self {
        self.texts.insert(path.into(), text.into());
        self
    }

    /// Returns command-line options with the same meaning. Pins are not included.
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

    /// Returns the text of a graph's file, or the text that replaces the file.
    pub fn text(&self, path: &Path) -> std::io::Result<String> {
        match self.text_in_place_of(path) {
            Some(text) => Ok(text.clone()),
            None => fs::read_text(path),
        }
    }

    /// Returns the text that replaces a file. The path of the file may be spelled in any way.
    fn text_in_place_of(&self, path: &Path) -> Option<&String> {
        let texts = Some(&self.texts).filter(|texts| !texts.is_empty())?;
        texts
            .get(path)
            .or_else(|| texts.get(&without_dots(path)))
            .or_else(|| texts.get(&std::fs::canonicalize(path).ok()?))
    }

    /// Returns true if a text replaces the file.
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
    /// Files may be missing, but must be inside of the project. This is for editing.
    Inside,
    /// Files are not checked. This is for reading a graph without evaluating it.
    Ignored,
}

/// A file that a node of a graph reads.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReadFile {
    /// The path of the file, which may be missing.
    pub path: PathBuf,
    /// The name of the node that reads the file.
    pub node: String,
    /// True if the node also runs without the file.
    pub optional: bool,
}
