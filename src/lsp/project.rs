//! The files of a project by the names in them: where a name is declared, where it is used, and what a new one changes.
//!
//! Names come from the reading that the check does, because a new name must be right in every file. A rename is refused while a text cannot
//! be read.

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use maquette_edit::{Named, NamesOf, Symbol, SymbolSort, real};
use maquette_golden::case;
use maquette_golden::suite::FileKind;
use maquette_graph::catalog::Catalog;
use maquette_graph::{Options, field_of, is_name, is_type_name};
use maquette_syntax::error::{Problem, Severity, Span};
use maquette_syntax::paths::project_root;
use maquette_syntax::{Passed, each_word};

/// Folders deeper than this are not looked into.
const DEEPEST: usize = 12;

/// More files are not looked into.
const MOST: usize = 5_000;

/// What files there are in a project, and the names in them.
#[derive(Default)]
pub(super) struct Project {
    names: HashMap<PathBuf, (Arc<str>, Arc<NamesOf>)>,
}

/// A name in a file.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Found {
    pub(super) file: PathBuf,
    pub(super) span: Span,
    pub(super) declares: bool,
    pub(super) is_field: bool,
}

/// New texts of files, by path.
pub(super) type Texts = BTreeMap<PathBuf, String>;

impl Project {
    /// The names in a file; none while its text cannot be read.
    pub(super) fn names(
        &mut self,
        path: &Path,
        catalog: &Catalog,
        options: &Options,
    ) -> Arc<NamesOf> {
        let path = real(path);
        let Ok(text) = options.text(&path) else { return Arc::default() };
        if let Some((known, names)) = self.names.get(&path)
            && **known == *text
        {
            return names.clone();
        }
        let names = Arc::new(names_of(&path, &text, catalog, options));
        self.names.insert(path, (text.into(), names.clone()));
        names
    }

    /// Forgets what it knows of names: what one file names may hang on others.
    pub(super) fn forget(&mut self) {
        self.names.clear();
    }

    /// What the name at a place names.
    pub(super) fn at(
        &mut self,
        path: &Path,
        at: usize,
        catalog: &Catalog,
        options: &Options,
    ) -> Vec<Named> {
        let names = self.names(path, catalog, options);
        names
            .all
            .iter()
            .filter(|named| named.span.start <= at && at <= named.span.end)
            .cloned()
            .collect()
    }

    /// Where something is declared: in the file of a graph, of a type of nodes the graph itself.
    pub(super) fn declaration(
        &mut self,
        symbol: &Symbol,
        catalog: &Catalog,
        options: &Options,
    ) -> Option<Found> {
        let names = self.names(&symbol.file, catalog, options);
        if symbol.sort == SymbolSort::Type {
            let file = names.types.get(&symbol.name)?.clone();
            return Some(Found { file, span: Span::default(), declares: true, is_field: false });
        }
        let found = names.all.iter().find(|named| named.declares && named.symbol == *symbol)?;
        Some(Found { file: symbol.file.clone(), span: found.span, declares: true, is_field: false })
    }

    /// All places in the project that name something.
    pub(super) fn places(
        &mut self,
        symbol: &Symbol,
        catalog: &Catalog,
        options: &Options,
    ) -> Vec<Found> {
        let (mut found, field) = (Vec::new(), field_of(&symbol.name));
        for file in files_of(&symbol.file, options) {
            // Most files do not have the word at all.
            if !options
                .text(&file)
                .is_ok_and(|text: String| text.contains(&symbol.name) || text.contains(&field))
            {
                continue;
            }
            let names = self.names(&file, catalog, options);
            let named = names.all.iter().filter(|named| named.symbol == *symbol);
            found.extend(named.map(|named| Found {
                file: file.clone(),
                span: named.span,
                declares: named.declares,
                is_field: named.is_field,
            }));
        }
        found
    }

    /// The places, by file, at which another name of something must stand.
    ///
    /// # Errors
    /// Why it cannot have it, in words.
    pub(super) fn renamed(
        &mut self,
        symbol: &Symbol,
        to: &str,
        catalog: &Catalog,
        options: &Options,
    ) -> Result<BTreeMap<PathBuf, Vec<(Span, String)>>, String> {
        may_have(symbol, to)?;
        if symbol.name == to {
            return Ok(BTreeMap::new());
        }
        let declared = self.names(&symbol.file, catalog, options);
        if declared
            .all
            .iter()
            .any(|it| it.declares && it.symbol.name == to && it.symbol.sort != SymbolSort::Output)
        {
            return Err(format!("there is already a `{to}` in {}", symbol.file.display()));
        }
        let places = self.places(symbol, catalog, options);
        let mut new: BTreeMap<PathBuf, Vec<(Span, String)>> = BTreeMap::new();
        for found in &places {
            let names = self.names(&found.file, catalog, options);
            let also = names.all.iter().find(|it| it.span == found.span && it.symbol != *symbol);
            if let Some(also) = also {
                let (file, other) = (found.file.display(), also.symbol.file.display());
                return Err(format!(
                    "{file} names `{}` of {other} by the same word: rename both by hand",
                    symbol.name
                ));
            }
            let word = if found.is_field { field_of(to) } else { to.to_owned() };
            new.entry(found.file.clone()).or_default().push((found.span, word));
        }
        if symbol.sort == SymbolSort::Node {
            let (layout, spans) = beside(symbol, options)?;
            if !spans.is_empty() {
                new.insert(layout, spans.into_iter().map(|span| (span, to.to_owned())).collect());
            }
        }
        let mut texts = Texts::new();
        for (file, words) in &mut new {
            let text = options.text(file);
            let mut text =
                text.map_err(|error| format!("cannot read {}: {error}", file.display()))?;
            words.sort_unstable();
            words.dedup();
            for (span, word) in words.iter().rev() {
                text.replace_range(span.start..span.end, word);
            }
            texts.insert(file.clone(), text);
        }
        // What a `ForEach` carries goes from an output to the input of the same name.
        let other = match symbol.sort {
            SymbolSort::Node => Some(SymbolSort::Output),
            SymbolSort::Output => Some(SymbolSort::Node),
            _ => None,
        };
        let has_other = other.is_some_and(|sort| {
            let other = Symbol { sort, ..symbol.clone() };
            declared.all.iter().any(|it| it.declares && it.symbol == other)
        });
        no_new_problems(&texts, catalog, options).map_err(|why| match has_other {
            true => format!(
                "{why}; an input and an output of one name, which a `ForEach` carries, must be renamed together, by hand"
            ),
            false => why,
        })?;
        Ok(new)
    }
}

fn names_of(path: &Path, text: &str, catalog: &Catalog, options: &Options) -> NamesOf {
    match FileKind::of(path, text) {
        FileKind::Graph => maquette_edit::names_in(path, text, catalog, options),
        FileKind::Test => match case::read_text(path, text.to_owned(), catalog) {
            (Some(test), problems) if problems.is_empty() => {
                maquette_edit::names_in_test(text, &test.graphs, catalog, options)
            }
            _ => NamesOf::default(),
        },
        FileKind::Sweep => maquette_edit::names_in_sweep(path, text, catalog, options),
        FileKind::Handles => NamesOf::default(),
    }
}

/// Whether something may have a name.
fn may_have(symbol: &Symbol, to: &str) -> Result<(), String> {
    let is_file = symbol.sort == SymbolSort::Output && symbol.name.contains('.');
    match symbol.sort {
        _ if is_file => Err(format!(
            "`{}` is the name of a file, and goldens are kept under it: change it by hand",
            symbol.name
        )),
        SymbolSort::Type if !is_type_name(to) => Err(format!(
            "`{to}` cannot name a type of nodes: such names begin with a capital letter"
        )),
        SymbolSort::Type => Ok(()),
        _ if !is_name(to) => Err(format!(
            "`{to}` cannot be a name: a lower-case letter, then lower-case letters, digits and hyphens"
        )),
        _ => Ok(()),
    }
}

/// The places that name a node in the file beside its graph which says where an editor shows it. Pins would be of another node.
fn beside(symbol: &Symbol, options: &Options) -> Result<(PathBuf, Vec<Span>), String> {
    fn keys(path: &Path, options: &Options, symbol_name: &str) -> Vec<Span> {
        let mut found = Vec::new();
        let text = options.text(path).unwrap_or_default();
        each_word(&text, |_, passed| {
            if let Passed::Name(name) = passed
                && name.text == *symbol_name
                && text[..name.span.start].ends_with('"')
            {
                found.push(name.span);
            }
        });
        found
    }
    let pins = symbol.file.with_extension("pins.ron");
    if !keys(&pins, options, &symbol.name).is_empty() {
        let (name, pins) = (&symbol.name, pins.display());
        return Err(format!(
            "`{name}` is pinned in {pins}: unpin it first, for a pin is of a name"
        ));
    }
    let layout = symbol.file.with_extension("layout.ron");
    let found = keys(&layout, options, &symbol.name);
    Ok((layout, found))
}

/// Refuses texts that have errors which the old ones do not have.
fn no_new_problems(texts: &Texts, catalog: &Catalog, options: &Options) -> Result<(), String> {
    fn errors(options: &Options, path: &Path, catalog: &Catalog) -> Vec<Problem> {
        let text = options.text(path).unwrap_or_default();
        let (problems, _) = FileKind::of(path, &text).problems(path, text, catalog, options);
        let errors = problems.into_iter().filter(|problem| problem.severity == Severity::Error);
        Vec::from_iter(errors)
    }
    let mut new = options.clone();
    new.texts.extend(texts.iter().map(|(path, text)| (path.clone(), text.clone())));
    for path in texts.keys().filter(|path| !path.to_string_lossy().ends_with(".layout.ron")) {
        let after = errors(&new, path, catalog);
        // What was wrong before need not be known where nothing is wrong.
        let before = if after.is_empty() { Vec::new() } else { errors(options, path, catalog) };
        fn count(all: &[Problem], code: &str) -> usize {
            all.iter().filter(|it| it.code == code).count()
        }
        let worse = after.iter().find(|it| count(&before, it.code) < count(&after, it.code));
        if let Some(problem) = worse {
            return Err(format!("{}: {}", problem.source.name.display(), problem.message));
        }
    }
    Ok(())
}

/// The files with graphs, patches and tests of the project that a file belongs to, and those that have not been saved yet.
pub(super) fn files_of(path: &Path, options: &Options) -> Vec<PathBuf> {
    let root = project_root(path.parent().unwrap_or(Path::new("/")));
    let mut files = Vec::new();
    collect(&root, 0, &mut files);
    files.extend(options.texts.keys().filter(|path| path.starts_with(&root)).cloned());
    files.sort();
    files.dedup();
    files
}

fn collect(folder: &Path, depth: usize, files: &mut Vec<PathBuf>) {
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    let mut entries: Vec<_> = entries.flatten().collect();
    entries.sort_by_key(std::fs::DirEntry::file_name);
    for entry in entries {
        let (name, path) = (entry.file_name().to_string_lossy().into_owned(), entry.path());
        let Ok(kind) = entry.file_type() else { continue };
        if kind.is_dir()
            && !name.starts_with('.')
            && name != "target"
            && name != "goldens"
            && depth < DEEPEST
        {
            collect(&path, depth + 1, files);
        }
        let is_beside =
            [".pins.ron", ".lock.ron", ".layout.ron"].iter().any(|ending| name.ends_with(ending));
        if kind.is_file() && name.ends_with(".ron") && !is_beside && files.len() < MOST {
            files.push(path);
        }
    }
}
