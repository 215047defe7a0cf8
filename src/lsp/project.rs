//! The names in the files of a project: declarations, uses and renaming.
//!
//! Names are read by the same parser as in `maquette check`, because a rename must be correct in every file. Therefore a file with syntax
//! errors prevents renaming.

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use maquette_edit::{FileNames, NameOccurrence, Symbol, SymbolSort, resolve_path};
use maquette_golden::case;
use maquette_golden::suite::FileKind;
use maquette_graph::catalog::Catalog;
use maquette_graph::{Options, field_of, is_name, is_type_name};
use maquette_syntax::error::{Diagnostic, Severity, Span};
use maquette_syntax::paths::project_root;
use maquette_syntax::{WalkEvent, for_each_word};

/// The maximum depth of the subfolders in which files of a project are searched.
const MAX_DEPTH: usize = 12;

/// The maximum number of files that are read in one project.
const MAX_FILES: usize = 5_000;

/// A cache of the names that occur in the files of a project.
#[derive(Default)]
pub(super) struct Project {
    names: HashMap<PathBuf, (Arc<str>, Arc<FileNames>)>,
}

/// An occurrence of a name in a file: a declaration or a use.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Occurrence {
    pub(super) file: PathBuf,
    pub(super) span: Span,
    pub(super) declares: bool,
    pub(super) is_field: bool,
}

/// The new texts of changed files, by path.
pub(super) type Texts = BTreeMap<PathBuf, String>;

impl Project {
    /// Returns the names in a file. The list is empty if the text has syntax errors.
    pub(super) fn names(
        &mut self,
        path: &Path,
        catalog: &Catalog,
        options: &Options,
    ) -> Arc<FileNames> {
        let path = resolve_path(path);
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

    /// Clears the cached names of all files. A change of one file may affect the others, because the names in a file may depend on other
    /// files.
    pub(super) fn forget(&mut self) {
        self.names.clear();
    }

    /// Returns the symbols to which the name at a position refers. One name may refer to several symbols.
    pub(super) fn symbol_at(
        &mut self,
        path: &Path,
        at: usize,
        catalog: &Catalog,
        options: &Options,
    ) -> Vec<NameOccurrence> {
        let names = self.names(path, catalog, options);
        names
            .all
            .iter()
            .filter(|named| named.span.start <= at && at <= named.span.end)
            .cloned()
            .collect()
    }

    /// Returns the place where a symbol is declared. For a node type that is a graph, this is the whole graph file.
    pub(super) fn declaration(
        &mut self,
        symbol: &Symbol,
        catalog: &Catalog,
        options: &Options,
    ) -> Option<Occurrence> {
        let names = self.names(&symbol.file, catalog, options);
        if symbol.sort == SymbolSort::Type {
            let file = names.types.get(&symbol.name)?.clone();
            return Some(Occurrence {
                file,
                span: Span::default(),
                declares: true,
                is_field: false,
            });
        }
        let found =
            names.all.iter().find(|named| named.is_declaration && named.symbol == *symbol)?;
        Some(Occurrence {
            file: symbol.file.clone(),
            span: found.span,
            declares: true,
            is_field: false,
        })
    }

    /// Returns all occurrences of a symbol in the project.
    pub(super) fn places(
        &mut self,
        symbol: &Symbol,
        catalog: &Catalog,
        options: &Options,
    ) -> Vec<Occurrence> {
        let (mut found, field) = (Vec::new(), field_of(&symbol.name));
        for file in files_of(&symbol.file, options) {
            // For speed, skip files that do not contain the word.
            if !options
                .text(&file)
                .is_ok_and(|text: String| text.contains(&symbol.name) || text.contains(&field))
            {
                continue;
            }
            let names = self.names(&file, catalog, options);
            let named = names.all.iter().filter(|named| named.symbol == *symbol);
            found.extend(named.map(|named| Occurrence {
                file: file.clone(),
                span: named.span,
                declares: named.is_declaration,
                is_field: named.is_field,
            }));
        }
        found
    }

    /// Returns the edits, by file, that rename a symbol.
    ///
    /// # Errors
    /// A message if the new name is not allowed for the symbol, or if renaming would cause errors.
    pub(super) fn rename(
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
        if declared.all.iter().any(|it| {
            it.is_declaration && it.symbol.name == to && it.symbol.sort != SymbolSort::Output
        }) {
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
            let (layout, spans) = layout_file_spans(symbol, options)?;
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
        // A `ForEach` that carries values from one element to the next connects an output to the input with the same name. So renaming only
        // one of the two causes errors, which the error message explains.
        let other = match symbol.sort {
            SymbolSort::Node => Some(SymbolSort::Output),
            SymbolSort::Output => Some(SymbolSort::Node),
            _ => None,
        };
        let has_other = other.is_some_and(|sort| {
            let other = Symbol { sort, ..symbol.clone() };
            declared.all.iter().any(|it| it.is_declaration && it.symbol == other)
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

fn names_of(path: &Path, text: &str, catalog: &Catalog, options: &Options) -> FileNames {
    match FileKind::detect(path, text) {
        FileKind::Graph => maquette_edit::names_in(path, text, catalog, options),
        FileKind::Test => match case::read_text(path, text.to_owned(), catalog) {
            (Some(test), problems) if problems.is_empty() => {
                maquette_edit::names_in_test(text, &test.graphs, catalog, options)
            }
            _ => FileNames::default(),
        },
        FileKind::Sweep => maquette_edit::names_in_sweep(path, text, catalog, options),
        FileKind::Handles => FileNames::default(),
    }
}

/// Checks that `to` is a valid new name for a symbol.
fn may_have(symbol: &Symbol, to: &str) -> Result<(), String> {
    let is_file = symbol.sort == SymbolSort::Output && symbol.name.contains('.');
    match symbol.sort {
        _ if is_file => Err(format!(
            "`{}` is the name of a file, and goldens are kept under it: change it by hand",
            symbol.name
        )),
        SymbolSort::Type if !is_type_name(to) => Err(format!(
            "`{to}` cannot be the name of a node type: such names begin with a capital letter"
        )),
        SymbolSort::Type => Ok(()),
        _ if !is_name(to) => Err(format!(
            "`{to}` cannot be a name: a lower-case letter, then lower-case letters, digits and hyphens"
        )),
        _ => Ok(()),
    }
}

/// Returns the path of a graph's layout file, and the spans in it that contain a node's name. The layout file stores the positions of nodes
/// in the diagram. Returns an error message if the node is pinned.
fn layout_file_spans(symbol: &Symbol, options: &Options) -> Result<(PathBuf, Vec<Span>), String> {
    fn keys(path: &Path, options: &Options, symbol_name: &str) -> Vec<Span> {
        let mut found = Vec::new();
        let text = options.text(path).unwrap_or_default();
        for_each_word(&text, |_, passed| {
            if let WalkEvent::Name(name) = passed
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
            "`{name}` is pinned in {pins}: remove the pin first, because a pin belongs to a name"
        ));
    }
    let layout = symbol.file.with_extension("layout.ron");
    let found = keys(&layout, options, &symbol.name);
    Ok((layout, found))
}

/// Checks that the new texts of changed files have no errors that the old texts do not have.
fn no_new_problems(texts: &Texts, catalog: &Catalog, options: &Options) -> Result<(), String> {
    fn errors(options: &Options, path: &Path, catalog: &Catalog) -> Vec<Diagnostic> {
        let text = options.text(path).unwrap_or_default();
        let (problems, _) = FileKind::detect(path, &text).diagnostics(path, text, catalog, options);
        let errors = problems.into_iter().filter(|problem| problem.severity == Severity::Error);
        Vec::from_iter(errors)
    }
    let mut new = options.clone();
    new.texts.extend(texts.iter().map(|(path, text)| (path.clone(), text.clone())));
    for path in texts.keys().filter(|path| !path.to_string_lossy().ends_with(".layout.ron")) {
        let after = errors(&new, path, catalog);
        // For speed, check the old text only if the new text has errors.
        let before = if after.is_empty() { Vec::new() } else { errors(options, path, catalog) };
        fn count(all: &[Diagnostic], code: &str) -> usize {
            all.iter().filter(|it| it.code == code).count()
        }
        let worse = after.iter().find(|it| count(&before, it.code) < count(&after, it.code));
        if let Some(problem) = worse {
            return Err(format!("{}: {}", problem.source.name.display(), problem.message));
        }
    }
    Ok(())
}

/// Returns the graphs, patches and tests in the project that contains `path`. Unsaved documents are included.
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
            && depth < MAX_DEPTH
        {
            collect(&path, depth + 1, files);
        }
        let is_beside =
            [".pins.ron", ".lock.ron", ".layout.ron"].iter().any(|ending| name.ends_with(ending));
        if kind.is_file() && name.ends_with(".ron") && !is_beside && files.len() < MAX_FILES {
            files.push(path);
        }
    }
}
