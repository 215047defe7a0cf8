//! Lock files: what the graphs that a graph uses were when somebody took them, kept beside it in `NAME.lock.ron`.
//!
//! A lock goes by bytes, except for how lines end: whether two texts mean the same hangs on the program and its packs, and a lock
//! must not. The texts themselves stand in the file, too: what an update would take can be told only beside what was there, every
//! clone of a project has both, and one file is written whole or not at all.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

use maquette_syntax::error::{Problem, Severity, Source, Span, code};
use maquette_syntax::{Kind, Tree, parse, syntax_problems};
use maquette_value::{Hash, plain};

use super::{Difference, Graph, Options};
use crate::catalog::Catalog;
use crate::load::first;
use crate::options::folder_of;
use crate::world::World;

/// The ending of lock files.
pub const ENDING: &str = "lock.ron";

/// The graphs that a graph uses, by their paths relative to its folder.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Lock(pub BTreeMap<String, Locked>);

/// A used graph as it was.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Locked {
    pub version: Option<String>,
    /// Its text; lines end in `\n`.
    pub text: String,
}

impl Locked {
    fn hash(&self) -> Hash {
        Hash::of(self.text.as_bytes())
    }

    /// The version, or that there is none.
    pub fn version(&self) -> &str {
        self.version.as_deref().unwrap_or("no version")
    }
}

/// What a graph uses now.
pub struct UsedNow {
    pub lock: Lock,
    /// The types that it makes of graphs, and the paths of these in the lock.
    pub names: Vec<(String, String)>,
}

/// The lock file of a graph.
pub fn beside(graph: &Path) -> PathBuf {
    graph.with_extension(ENDING)
}

impl Lock {
    /// The lock of a graph; none if it has none.
    ///
    /// # Errors
    /// If the file cannot be read, is no lock, or was changed by hand.
    pub fn of(graph: &Path) -> Result<Option<Self>, Box<Problem>> {
        let name = beside(graph);
        let invalid = |text: &str, span, message: String| {
            let source = Arc::new(Source { name: name.clone(), text: text.to_owned() });
            let help = format!("`maquette lock {}` makes it anew", graph.display());
            Box::new(problem((source, span), message, help))
        };
        let text = match plain::read_text(&name) {
            Ok(text) => text,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            Err(error) => {
                let message = format!("the lock file cannot be read: {error}");
                return Err(invalid("", Span::default(), message));
            }
        };
        let (tree, mistakes) = parse(&text);
        if let Some(mistake) = syntax_problems(&name, &text, mistakes).into_iter().next() {
            return Err(invalid(&text, mistake.span, mistake.message));
        }
        read(&tree).map(Some).map_err(|(span, message)| invalid(&text, span, message))
    }

    /// What the graph at `path` uses now, with paths relative to `folder`.
    ///
    /// # Errors
    /// What is wrong with the graph or one that it uses.
    pub fn now(
        path: &Path,
        folder: &Path,
        catalog: &Catalog,
        options: &Options,
    ) -> Result<UsedNow, Vec<Problem>> {
        let text = options.text(path).map_err(|error| {
            let source = Arc::new(Source { name: path.to_owned(), text: String::new() });
            let message = format!("cannot read the graph: {error}");
            vec![problem((source, Span::default()), message, String::new())]
        })?;
        let (world, _) = first(path, text, catalog, options);
        // What a node of an unknown type does says nothing of the files.
        if world.problems.iter().any(|problem| {
            problem.severity == Severity::Error && problem.code != code::UNKNOWN_NODE
        }) {
            return Err(world.problems);
        }
        let folder = folder_of(&folder.join("graph.ron"));
        let mut lock = Self::default();
        for entered in &world.entered {
            let Some(locked) = world.locked(&entered.path, &entered.real) else { continue };
            lock.0.insert(relative(&folder, &entered.real), locked);
        }
        let named = world.listed.iter().filter(|(depth, ..)| *depth == 1);
        let names = named.map(|(_, name, graph)| {
            let real = std::fs::canonicalize(&graph.sheet.source.name).unwrap_or_default();
            (name.clone(), relative(&folder, &real))
        });
        Ok(UsedNow { lock, names: names.collect() })
    }

    /// The lock as a file of its own.
    pub fn to_text(&self, graph: &Path) -> String {
        let name = graph.file_name().unwrap_or_default().to_string_lossy();
        let mut text = format!(
            "// The graphs that {name} uses, as `maquette lock` or `maquette update` took them.\nLock(\n    format: 1,\n    files: {{\n"
        );
        let mut texts = BTreeMap::new();
        for (path, locked) in &self.0 {
            let hash = locked.hash().to_string();
            let version = locked.version.iter().map(|version| format!("version: {version:?}, "));
            let version = String::from_iter(version);
            let _ = writeln!(text, "        {path:?}: ({version}hash: \"{hash}\"),");
            texts.insert(hash, &locked.text);
        }
        text.push_str("    },\n    texts: {\n");
        for (hash, content) in texts {
            let runs = content.split('"').skip(1);
            let runs = runs.map(|rest| rest.len() - rest.trim_start_matches('#').len());
            let marks = "#".repeat(runs.max().map_or(1, |most| most + 1));
            let _ = writeln!(text, "        \"{hash}\": r{marks}\"{content}\"{marks},");
        }
        text.push_str("    },\n)\n");
        text
    }
}

/// Reads `Lock(format: 1, files: {..}, texts: {..})`.
fn read(tree: &Tree) -> Result<Lock, (Span, String)> {
    fn field(tree: &Tree, name: &str) -> Option<Tree> {
        let fields = tree.fields().unwrap_or_default().iter();
        fields.clone().find(|field| field.name.text == name).map(|field| field.value.clone())
    }
    fn map(name: &str, tree: &Tree) -> Result<Vec<(Tree, Tree)>, (Span, String)> {
        match field(tree, name).map(|value| value.kind) {
            Some(Kind::Map(entries)) => Ok(entries),
            _ => Err((tree.span, format!("a lock file needs a map `{name}`"))),
        }
    }
    let is_lock = tree.name().is_some_and(|name| name.text == "Lock");
    let format = field(tree, "format").map(|format| format.kind);
    if !is_lock || !matches!(format, Some(Kind::Number { value: 1.0, .. })) {
        return Err((tree.span, "a lock file begins with `Lock(format: 1, ..)`".into()));
    }
    let texts = map("texts", tree)?;
    let mut lock = Lock::default();
    for (key, value) in map("files", tree)? {
        fn text(name: &str, value: &Tree) -> Option<String> {
            field(value, name).and_then(|it| it.text().map(str::to_owned))
        }
        let (Some(path), Some(hash)) = (key.text(), text("hash", &value)) else {
            return Err((key.span, "a file of a lock has a path and a hash".into()));
        };
        let found = texts.iter().find(|(known, _)| known.text() == Some(&hash));
        let found = found.and_then(|(_, text)| text.text()).map(with_plain_ends);
        let locked = found.map(|text| Locked { version: text_of(&value, "version"), text });
        match locked.filter(|locked| locked.hash().to_string() == hash) {
            Some(locked) => lock.0.insert(path.to_owned(), locked),
            None => {
                return Err((key.span, format!("the text of `{path}` is not what its hash says")));
            }
        };
    }
    Ok(lock)
}

fn text_of(tree: &Tree, name: &str) -> Option<String> {
    let field = tree.fields()?.iter().find(|field| field.name.text == name)?;
    field.value.text().map(str::to_owned)
}

/// Lines that end as on any other system: what a clone makes of them is nobody's change.
fn with_plain_ends(text: &str) -> String {
    text.replace("\r\n", "\n")
}

/// The path of a file from a folder on, both without links.
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

fn problem((source, span): (Arc<Source>, Span), message: String, help: String) -> Problem {
    Problem { help, ..Problem::new(Severity::Error, code::LOCK, (source, span), message) }
}

impl World<'_> {
    /// A used graph as it is now.
    fn locked(&self, path: &Path, real: &Path) -> Option<Locked> {
        let text = with_plain_ends(&self.options.text(path).ok()?);
        Some(Locked { version: self.version_of(real), text })
    }

    /// Says what is not as the lock of the graph says: errors if it must be, warnings if not.
    pub(super) fn judge_lock(&mut self, path: &Path, text: &str) {
        let must = self.options.locked;
        let mut problems = match Lock::of(path) {
            Ok(None) if !must || self.entered.is_empty() => return,
            Ok(None) => {
                let source = Source { name: path.to_owned(), text: text.to_owned() };
                let message = format!("there is no lock file {}", beside(path).display());
                let help = format!("`maquette lock {}` writes it", path.display());
                vec![problem((Arc::new(source), Span::default()), message, help)]
            }
            Ok(Some(lock)) => self.differences_from(&lock, path),
            Err(problem) => vec![*problem],
        };
        if !must {
            problems.iter_mut().for_each(|problem| problem.severity = Severity::Warning);
        }
        self.problems.extend(problems);
    }

    fn differences_from(&self, lock: &Lock, path: &Path) -> Vec<Problem> {
        let folder = folder_of(path);
        let name = beside(path);
        let name = name.file_name().unwrap_or_default().to_string_lossy();
        let help = format!("`maquette update {}` shows what changed and takes it", path.display());
        let (mut problems, mut seen) = (Vec::new(), BTreeMap::new());
        for entered in &self.entered {
            let key = relative(&folder, &entered.real);
            if seen.insert(key.clone(), ()).is_some() {
                continue;
            }
            let Some(now) = self.locked(&entered.path, &entered.real) else { continue };
            let message = match lock.0.get(&key) {
                Some(locked) if locked.text == now.text => continue,
                Some(locked) => {
                    let how = in_words(&entered.path, locked, &now, self.catalog);
                    format!("`{key}` is not what {name} says: {how}")
                }
                None => format!("`{key}` is not in {name}"),
            };
            let place = (entered.source.clone(), entered.span);
            let problem = problem(place, message, help.clone());
            problems.push(Problem { uses: entered.uses.clone(), ..problem });
        }
        // Of a graph that cannot be read nobody knows what it uses.
        let is_read = self.problems.iter().all(|problem| problem.severity != Severity::Error);
        for key in lock.0.keys().filter(|key| is_read && !seen.contains_key(*key)) {
            let source = Source { name: beside(path), text: String::new() };
            let message = format!("`{key}` is in {name}, but nothing uses it any more");
            problems.push(problem((Arc::new(source), Span::default()), message, help.clone()));
        }
        problems
    }
}

/// How a used graph differs from what is locked, on one line.
fn in_words(path: &Path, before: &Locked, now: &Locked, catalog: &Catalog) -> String {
    let version = (before.version != now.version)
        .then(|| format!("version: {} -> {}", before.version(), now.version()));
    let found = differences(path, &before.text, &now.text, catalog);
    let found = found.iter().filter(|found| found.field != "version");
    let mut told: Vec<_> = version.into_iter().chain(found.map(ToString::to_string)).collect();
    let more = told.len().saturating_sub(2);
    told.truncate(2);
    if more > 0 {
        told.push(format!("and {more} more"));
    }
    match told.is_empty() {
        true => "comments or spaces differ".into(),
        false => told.join("; "),
    }
}

/// What a used graph says otherwise than before; nothing if one of the texts is no graph.
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
        fn locked(text: &str) -> Locked {
            Locked { version: Some("1.2.0".into()), text: text.into() }
        }
        let texts = ["", "Graph()", "a \"# b \"## c\n", "line\nline\n"];
        let entries = texts.iter().map(|text| (format!("lib/{}.ron", text.len()), locked(text)));
        let lock = Lock(entries.collect());
        let (tree, mistakes) = parse(&lock.to_text("face.ron".as_ref()));
        assert_eq!(mistakes, []);
        assert_eq!(read(&tree), Ok(lock));
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
