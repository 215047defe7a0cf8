//! Lock files. The lock file `NAME.lock.ron` is next to the graph `NAME.ron` and contains the texts of all graphs that it used when the
//! lock was written.
//!
//! The state of a used graph is its text, compared byte by byte except for line endings. A hash of the meaning would not be stable, because
//! the meaning depends on the version of the program and its packs. The lock contains whole texts instead of hashes: to show what has
//! changed, every clone of the project needs the old text. All texts are in one file, because a single file can be written atomically.

use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

use maquette_syntax::error::{Diagnostic, Severity, Source, Span, code};
use maquette_syntax::{format_plain_data, parse, parse_plain_data, quote, syntax_diagnostics};
use maquette_value::{Hash, fs};
use serde::{Deserialize, Serialize};

use super::{Difference, Graph, Options};
use crate::catalog::Catalog;
use crate::load::check_file;
use crate::options::folder_of;
use crate::world::World;

/// The extension of lock files.
pub const EXTENSION: &str = "lock.ron";

/// The graphs that a graph uses, by their paths relative to the folder of that graph.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Lock(pub BTreeMap<String, LockedGraph>);

/// The state that a used graph had when the lock was written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LockedGraph {
    pub version: Option<String>,
    /// The text of the graph, with `\n` line endings.
    pub text: String,
}

impl LockedGraph {
    /// Returns the version of the graph, or the text `no version`.
    pub fn version(&self) -> &str {
        self.version.as_deref().unwrap_or("no version")
    }
}

/// The current state of all graphs that a graph uses.
pub struct UsedGraphs {
    pub lock: Lock,
    /// The node types that the graph declares with `use`. Each has the path of the used graph in the lock.
    pub names: Vec<(String, String)>,
}

/// Returns the path of a graph's lock file.
pub fn lock_path(graph: &Path) -> PathBuf {
    graph.with_extension(EXTENSION)
}

impl Lock {
    /// Reads the lock file of a graph. Returns `None` if the graph has no lock file.
    ///
    /// # Errors
    /// The file cannot be read, is not a lock file, or was changed by hand.
    pub fn read(graph: &Path) -> Result<Option<Self>, Box<Diagnostic>> {
        let name = lock_path(graph);
        let invalid = |text: &str, span, message: String| {
            let source = Arc::new(Source { name: name.clone(), text: text.to_owned() });
            let help = format!("`maquette lock {}` writes it again", graph.display());
            Box::new(lock_error((source, span), message, help))
        };
        let text = match fs::read_text(&name) {
            Ok(text) => text,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            Err(error) => {
                let message = format!("the lock file cannot be read: {error}");
                return Err(invalid("", Span::default(), message));
            }
        };
        let (_, errors) = parse(&text);
        if let Some(error) = syntax_diagnostics(&name, &text, errors).into_iter().next() {
            return Err(invalid(&text, error.span, error.message));
        }
        parse_lock(&text).map(Some).map_err(|(span, message)| invalid(&text, span, message))
    }

    /// Returns the current state of the graphs that the graph at `path` uses. Their paths are relative to `folder`.
    ///
    /// # Errors
    /// The graph, or a graph that it uses, has errors.
    pub fn current(
        path: &Path,
        folder: &Path,
        catalog: &Catalog,
        options: &Options,
    ) -> Result<UsedGraphs, Vec<Diagnostic>> {
        let text = options.text(path).map_err(|error| {
            let source = Arc::new(Source { name: path.to_owned(), text: String::new() });
            let message = format!("cannot read the graph: {error}");
            vec![lock_error((source, Span::default()), message, String::new())]
        })?;
        let (world, _) = check_file(path, text, catalog, options);
        // Ignore unknown node types, because they do not affect which files the graph uses.
        if world.diagnostics.iter().any(|diagnostic| {
            diagnostic.severity == Severity::Error && diagnostic.code != code::UNKNOWN_NODE
        }) {
            return Err(world.diagnostics);
        }
        let folder = folder_of(&folder.join("graph.ron"));
        let mut lock = Self::default();
        for entered in &world.references {
            let Some(locked) = world.locked_graph(&entered.path, &entered.canonical_path) else {
                continue;
            };
            lock.0.insert(relative(&folder, &entered.canonical_path), locked);
        }
        let named = world.node_types.iter().filter(|(depth, ..)| *depth == 1);
        let names = named.map(|(_, name, graph)| {
            let real = std::fs::canonicalize(&graph.source_map.source.name).unwrap_or_default();
            (name.clone(), relative(&folder, &real))
        });
        Ok(UsedGraphs { lock, names: names.collect() })
    }

    /// Returns the text of the lock file.
    pub fn to_text(&self, graph: &Path) -> String {
        let name = graph.file_name().unwrap_or_default().to_string_lossy();
        let mut file = LockFile { format: 1, files: BTreeMap::new(), texts: BTreeMap::new() };
        for (path, LockedGraph { version, text }) in &self.0 {
            let hash = Hash::compute(text.as_bytes());
            file.files.insert(path.clone(), LockedFile { version: version.clone(), hash });
            file.texts.insert(hash.to_string(), text.clone());
        }
        let comment = format!("The graphs that {name} uses, as recorded by `maquette lock`.");
        format_plain_data(&comment, "Lock", 2, &file)
    }
}

/// The content of a lock file, `Lock(format: 1, files: {..}, texts: {..})`.
#[derive(Serialize, Deserialize)]
#[serde(rename = "Lock")]
struct LockFile {
    format: u32,
    files: BTreeMap<String, LockedFile>,
    /// The texts of the files, by the hashes of the texts.
    texts: BTreeMap<String, String>,
}

#[derive(Serialize, Deserialize)]
struct LockedFile {
    #[serde(default, skip_serializing_if = "Option::is_none")]
    version: Option<String>,
    hash: Hash,
}

/// Reads a lock file.
fn parse_lock(text: &str) -> Result<Lock, (Span, String)> {
    let file: LockFile = parse_plain_data(text)?;
    if file.format != 1 {
        let message =
            format!("expected a lock file with `format: 1`, found `format: {}`", file.format);
        return Err((Span::default(), message));
    }
    let mut lock = Lock::default();
    for (path, LockedFile { version, hash }) in file.files {
        let locked = file.texts.get(&hash.to_string()).map(|text| with_plain_ends(text));
        match locked.filter(|text| Hash::compute(text.as_bytes()) == hash) {
            Some(text) => lock.0.insert(path, LockedGraph { version, text }),
            None => {
                let start = text.find(&quote(&path)).unwrap_or_default();
                let span = Span { start, end: start };
                return Err((span, format!("the text of `{path}` does not match its hash")));
            }
        };
    }
    Ok(lock)
}

/// Replaces all line endings by `\n`, because version control may convert line endings.
fn with_plain_ends(text: &str) -> String {
    text.replace("\r\n", "\n")
}

/// Returns the path of a file relative to a folder. Neither path may contain symbolic links.
fn relative(folder: &Path, file: &Path) -> String {
    let (folder, file) =
        (folder.components().collect::<Vec<_>>(), file.components().collect::<Vec<_>>());
    let common = folder.iter().zip(&file).take_while(|(a, b)| a == b).count();
    let up = folder[common..].iter().map(|_| "..".to_owned());
    let down = file[common..]
        .iter()
        .map(|part: &Component<'_>| part.as_os_str().to_string_lossy().into_owned());
    up.chain(down).collect::<Vec<_>>().join("/")
}

fn lock_error((source, span): (Arc<Source>, Span), message: String, help: String) -> Diagnostic {
    Diagnostic { help, ..Diagnostic::new(Severity::Error, code::LOCK, (source, span), message) }
}

impl World<'_> {
    /// Returns the current state of a used graph. `None` if its file cannot be read.
    fn locked_graph(&self, path: &Path, real: &Path) -> Option<LockedGraph> {
        let text = with_plain_ends(&self.options.text(path).ok()?);
        Some(LockedGraph { version: self.version_of(real), text })
    }

    /// Reports the differences from the lock of the graph: as errors if `locked` is set, otherwise as warnings.
    pub(super) fn report_lock_differences(&mut self, path: &Path, text: &str) {
        let must = self.options.locked;
        let mut diagnostics = match Lock::read(path) {
            Ok(None) if !must || self.references.is_empty() => return,
            Ok(None) => {
                let source = Source { name: path.to_owned(), text: text.to_owned() };
                let message = format!("there is no lock file {}", lock_path(path).display());
                let help = format!("`maquette lock {}` writes it", path.display());
                vec![lock_error((Arc::new(source), Span::default()), message, help)]
            }
            Ok(Some(lock)) => self.differences_from(&lock, path),
            Err(diagnostic) => vec![*diagnostic],
        };
        if !must {
            diagnostics.iter_mut().for_each(|diagnostic| diagnostic.severity = Severity::Warning);
        }
        self.diagnostics.extend(diagnostics);
    }

    fn differences_from(&self, lock: &Lock, path: &Path) -> Vec<Diagnostic> {
        let folder = folder_of(path);
        let name = lock_path(path);
        let name = name.file_name().unwrap_or_default().to_string_lossy();
        let help = format!(
            "run `maquette lock --update {}` to review and accept the changes",
            path.display()
        );
        let (mut diagnostics, mut seen) = (Vec::new(), BTreeMap::new());
        for entered in &self.references {
            let key = relative(&folder, &entered.canonical_path);
            if seen.insert(key.clone(), ()).is_some() {
                continue;
            }
            let Some(now) = self.locked_graph(&entered.path, &entered.canonical_path) else {
                continue;
            };
            let message = match lock.0.get(&key) {
                Some(locked) if locked.text == now.text => continue,
                Some(locked) => {
                    let how = in_words(&entered.path, locked, &now, self.catalog);
                    format!("`{key}` differs from {name}: {how}")
                }
                None => format!("`{key}` is not in {name}"),
            };
            let place = (entered.source.clone(), entered.span);
            let diagnostic = lock_error(place, message, help.clone());
            diagnostics.push(Diagnostic { uses: entered.uses.clone(), ..diagnostic });
        }
        // If there are errors, the list of used graphs may be incomplete, so missing graphs are not reported.
        let is_read =
            self.diagnostics.iter().all(|diagnostic| diagnostic.severity != Severity::Error);
        for key in lock.0.keys().filter(|key| is_read && !seen.contains_key(*key)) {
            let source = Source { name: lock_path(path), text: String::new() };
            let message = format!("`{key}` is in {name}, but nothing uses it");
            diagnostics.push(lock_error(
                (Arc::new(source), Span::default()),
                message,
                help.clone(),
            ));
        }
        diagnostics
    }
}

/// Describes in one line how a used graph differs from its state in the lock.
fn in_words(path: &Path, before: &LockedGraph, now: &LockedGraph, catalog: &Catalog) -> String {
    let version = (before.version != now.version)
        .then(|| format!("version: {} -> {}", before.version(), now.version()));
    let found = differences(path, &before.text, &now.text, catalog);
    let found = found.iter().filter(|found| found.field != "version");
    let mut parts: Vec<_> = version.into_iter().chain(found.map(ToString::to_string)).collect();
    let more = parts.len().saturating_sub(2);
    parts.truncate(2);
    if more > 0 {
        parts.push(format!("and {more} more"));
    }
    match parts.is_empty() {
        true => "comments or spaces differ".into(),
        false => parts.join("; "),
    }
}

/// Returns the differences in meaning between two texts of a used graph. Empty if one of the texts cannot be parsed.
pub fn differences(path: &Path, before: &str, now: &str, catalog: &Catalog) -> Vec<Difference> {
    fn source(text: &str, path: &Path) -> Source {
        Source { name: path.to_owned(), text: text.to_owned() }
    }
    Graph::differences(&source(before, path), &source(now, path), catalog).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lock_is_read_as_it_was_written() {
        let texts = ["", "Graph()", "a \"# b \"## c\n", "line\nline\n"];
        let entries = texts.iter().map(|text| {
            let graph = LockedGraph { version: Some("1.2.0".into()), text: (*text).into() };
            (format!("lib/{}.ron", text.len()), graph)
        });
        let lock = Lock(entries.collect());
        let text = lock.to_text("face.ron".as_ref());
        assert_eq!(parse_lock(&text), Ok(lock));
    }

    #[test]
    fn paths_lead_from_the_folder_of_the_graph() {
        fn relative_path(folder: &str, file: &str) -> String {
            relative(folder.as_ref(), file.as_ref())
        }
        assert_eq!(relative_path("/a/b", "/a/b/lib/c.ron"), "lib/c.ron");
        assert_eq!(relative_path("/a/b", "/a/lib/c.ron"), "../lib/c.ron");
    }
}
