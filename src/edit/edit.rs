//! Edits the text of a graph, and checks the edited text.

use std::borrow::Cow;
use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use maquette_graph::catalog::Catalog;
use maquette_graph::load::load_text;
use maquette_graph::migrate::{migrate_target, migrated_text, prepare_for};
use maquette_graph::{
    CheckedGraph, EditError, Files, Options, apply, patch, place_value, target_in_file,
};
use maquette_syntax::error::{Diagnostic, Severity, Source, code};
use maquette_syntax::{
    Kind, Token, edit_with_trailing_commas, parse, quote, syntax_diagnostics, tokens,
    with_trailing_commas,
};
use serde::Deserialize;

use super::structure::Structure;

/// One edit of a graph.
///
/// New parts are written in the canonical form, on lines of their own or after their neighbors, depending on the layout of the neighbors.
/// Removing a part also removes the comments inside of it and those that follow it on its line. Comments above the part are kept.
///
/// The name of a node, an input or a parameter may begin with its section: `nodes.nose` or `params.nose`. This is required if the name
/// occurs both as a parameter and as a node or input.
///
/// The JSON form is an object of one entry: `{"add": {"name": "spots", "node": "Threshold", "fields": [["image", "scan.color"]]}}`.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase", deny_unknown_fields)]
pub enum Edit {
    /// Adds a node.
    Add {
        /// The name of the new node.
        name: String,
        /// The type of the new node: a node type of the catalog, a graph under `use`, `ForEach` or `Switch`.
        node: String,
        /// Names and values of the new node's fields, in order. Each value is RON, or a text if it cannot be parsed as RON. Links need no
        /// quotes.
        #[serde(default)]
        fields: Vec<(String, String)>,
        /// The node after which the new node is inserted. `None` inserts it after the last node of the graph.
        #[serde(default)]
        after: Option<String>,
    },
    /// Removes a node, an input or a parameter.
    Remove {
        /// The name of the part to be removed.
        name: String,
        /// True to also remove references to the removed part: links at optional ports, entries in lists of links, outputs and
        /// expectations. If false, the edit fails if there are references.
        #[serde(default)]
        and_links: bool,
    },
    /// Renames a node, an input or a parameter, and all references to it in the same file. References in other files, such as patches of
    /// the graph and graphs that use it, are not updated.
    Rename {
        /// The current name of the node, input or parameter.
        from: String,
        /// The new name of the node, input or parameter.
        to: String,
    },
    /// Links a port. The new link replaces the link that the port has, if any.
    Link {
        /// The port, `node.port`. If the port takes a list, the link is appended to the list. `node.port.2` is the third link of a list.
        /// For a `ForEach`, the ports are those of the repeated node type; for a `Switch`, they are its cases.
        port: String,
        /// The source of the link, `node` or `node.output`.
        to: String,
    },
    /// Removes the link at a port. If the port takes a list, removes all links of the port.
    Unlink {
        /// The port, `node.port`. `node.port.2` is the third link of a list.
        port: String,
    },
    /// Replaces a literal value. A missing field is added in the style of its neighbors.
    Set {
        /// The target of the value: `name` for the default of a parameter, or `node.field.field` for a field of a node.
        target: String,
        /// The new value: RON, or a text if it cannot be parsed as RON.
        value: String,
    },
    /// Adds an output, changes its source, or removes it.
    Output {
        /// The name of the output: the path of a file, or a port to which other graphs can link.
        name: String,
        /// The source of the output, `node` or `node.output`. `None` to remove the output.
        #[serde(default)]
        to: Option<String>,
    },
}

impl Edit {
    /// Returns the values in the edit, as the user wrote them: as RON, or as texts without quotes.
    fn values(&self) -> Vec<&str> {
        match self {
            Self::Add { fields, .. } => fields.iter().map(|(_, value)| &value[..]).collect(),
            Self::Set { value, .. } => vec![value],
            _ => Vec::new(),
        }
    }
}

/// The text of a graph file before and after some edits, and the values that the edits have set.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EditedText {
    /// The text of the file after the edits.
    pub text: String,
    /// The text before the edits, for undoing all of them.
    pub before: String,
    /// The values that [`Edit::Set`] has written, in order.
    pub changes: Vec<ValueChange>,
}

/// The change of one value in a graph file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ValueChange {
    /// The target of the value: `name` for the default of a parameter, or `node.field`. Outdated names in the target have been replaced by
    /// current ones.
    pub target: String,
    /// The previous value. `None` if the target had no value.
    pub before: Option<String>,
    /// The new value, as it was written into the file.
    pub after: String,
}

/// Applies edits to the text of the graph file at `path`, one after the other.
///
/// Parts that the edits do not mention are kept byte by byte. The final text is checked as by [`Graph::load`](maquette_graph::Graph::load),
/// except that files read by the graph may be missing. Only the final text must be valid, not the text after each edit.
///
/// # Errors
/// The text cannot be parsed, an edit refers to a missing part or removes a required part, or the new text has errors that the old text did
/// not have. In these cases nothing is edited. Positions refer to the text before the failing edit or to the new text; each diagnostic
/// contains the text to which its position refers.
pub fn edit(
    path: &Path,
    text: &str,
    edits: &[Edit],
    catalog: &Catalog,
    options: &Options,
) -> Result<EditedText, Vec<Diagnostic>> {
    let (tree, errors) = parse(text);
    if !errors.is_empty() {
        return Err(syntax_diagnostics(path, text, errors));
    }
    // If a name occurs twice, an edit of that name is ambiguous.
    let twice = patch::duplicates(&tree);
    if !twice.is_empty() {
        let source = Arc::new(Source { name: path.to_owned(), text: text.to_owned() });
        return Err(twice
            .into_iter()
            .map(|diagnostic| diagnostic.into_diagnostic(&source))
            .collect());
    }
    let editor = Editor { path, catalog, options };
    if matches!(with_trailing_commas(text), Cow::Borrowed(_)) {
        return editor.edit(text, edits);
    }
    // Renaming and replacing values does not require moving leading commas, unless the number of commas changes.
    if edits.iter().all(|edit| matches!(edit, Edit::Rename { .. } | Edit::Set { .. }))
        && let Ok(edited) = editor.edit(text, edits)
        && comma_count(&edited.text) == comma_count(text)
    {
        return Ok(edited);
    }
    EditedText::with_commas_behind(text, |text| editor.edit(text, edits))
}

fn comma_count(text: &str) -> usize {
    tokens(text).iter().filter(|(token, _)| *token == Token::Comma).count()
}

impl EditedText {
    /// Moves leading commas to the ends of the previous lines, runs an edit on this text, and moves the commas back to the beginnings of
    /// lines.
    pub(super) fn with_commas_behind(
        text: &str,
        edit: impl FnOnce(&str) -> Result<Self, Vec<Diagnostic>>,
    ) -> Result<Self, Vec<Diagnostic>> {
        let mut changes = Vec::new();
        let new = edit_with_trailing_commas(text, |text| {
            let edited = edit(text)?;
            changes = edited.changes;
            Ok::<_, Vec<Diagnostic>>(edited.text)
        })?;
        Ok(Self { text: new, before: text.to_owned(), changes })
    }
}

/// Writes values into the text of the graph file at `path`. Each item is a target, `name` or `node.field.field`, and a value in RON.
///
/// # Errors
/// The errors of [`edit()`] with [`Edit::Set`].
pub fn set_values(
    path: &Path,
    text: &str,
    set: &[(String, String)],
    catalog: &Catalog,
    options: &Options,
) -> Result<EditedText, Vec<Diagnostic>> {
    edit(
        path,
        text,
        &set.iter()
            .map(|(target, value)| Edit::Set { target: target.clone(), value: value.clone() })
            .collect::<Vec<_>>(),
        catalog,
        options,
    )
}

/// Renames a node, an input or a parameter in a text, without checking the result. Returns `None` if the text does not contain the old
/// name.
pub(super) fn rename_in(
    path: &Path,
    text: &str,
    from: &str,
    to: &str,
    catalog: &Catalog,
) -> Option<String> {
    let options = Options { files: Files::Ignored, ..Options::default() };
    let editor = Editor { path, catalog, options: &options };
    let edit = Edit::Rename { from: from.to_owned(), to: to.to_owned() };
    Some(editor.apply_unchecked(text, &[edit], std::iter::empty()).ok()?.text)
}

/// Edits the text of one graph file, and checks the edited text.
pub(super) struct Editor<'a> {
    pub(super) path: &'a Path,
    pub(super) catalog: &'a Catalog,
    pub(super) options: &'a Options,
}

impl Editor<'_> {
    fn edit(&self, text: &str, edits: &[Edit]) -> Result<EditedText, Vec<Diagnostic>> {
        let known = self.errors(text);
        let (mut spelled, mut chosen): (Vec<Vec<String>>, Vec<usize>) = (Vec::new(), Vec::new());
        for edit in edits {
            for value in edit.values() {
                let spellings = spellings(value);
                // If the old value is a string in quotes, try first to read a new value that is a bare word as a string without quotes.
                let is_text = match edit {
                    Edit::Set { target, .. } => {
                        let draft = self.options.draft;
                        let target = target_in_file(&parse(text).0, target, draft);
                        let placed = target.and_then(|target| {
                            place_value(text, &target, &spellings[0], false, draft)
                        });
                        placed
                            .is_ok_and(|(_, before)| before.is_some_and(|old| old.starts_with('"')))
                    }
                    _ => false,
                };
                chosen.push(if is_text { spellings.len() - 1 } else { 0 });
                spelled.push(spellings);
            }
        }
        let only_names = edits.iter().all(|edit| matches!(edit, Edit::Rename { .. }));
        let attempt = |chosen: &[usize]| {
            let values = spelled.iter().zip(chosen).map(|(spellings, &k)| &spellings[k][..]);
            let edited = self.apply_unchecked(text, edits, values)?;
            let diagnostics = new_errors(&known, self.errors(&edited.text), only_names);
            Ok::<_, Vec<Diagnostic>>((edited, diagnostics))
        };
        let (mut best, mut diagnostics) = attempt(&chosen)?;
        for index in 0..spelled.len() {
            if diagnostics.is_empty() || spelled[index].len() < 2 {
                continue;
            }
            chosen[index] = 1 - chosen[index];
            let (other, others) = attempt(&chosen)?;
            // Accept the other reading of the value if it removes all errors. The reading as a text is also accepted if it removes some
            // errors.
            if others.is_empty() || (chosen[index] == 1 && others.len() < diagnostics.len()) {
                (best, diagnostics) = (other, others);
            } else {
                chosen[index] = 1 - chosen[index];
            }
        }
        if diagnostics.is_empty() { Ok(best) } else { Err(diagnostics) }
    }

    /// Applies the edits, and does not check the resulting graph. `values` are the values of all edits in order, each in the chosen
    /// spelling.
    pub(super) fn apply_unchecked<'s>(
        &self,
        text: &str,
        edits: &[Edit],
        mut values: impl Iterator<Item = &'s str>,
    ) -> Result<EditedText, Vec<Diagnostic>> {
        let before = text.to_owned();
        let mut edited = EditedText { text: before.clone(), before, changes: Vec::new() };
        for edit in edits {
            let values: Vec<_> = values.by_ref().take(edit.values().len()).collect();
            if let Edit::Set { target, value: given } = edit {
                let (mut target, mut value) = (
                    self.target_in_file(&edited.text, target).map_err(|error: EditError| {
                        let message = format!("{target}={given}: {}", error.message);
                        vec![self.diagnostic(&edited.text, EditError { message, ..error })]
                    })?,
                    values.concat(),
                );
                let (graph, tree) = (parse(&edited.text).0, parse(&value).0);
                if let Some((now, migrated)) = migrate_target(&graph, &target, &tree, self.catalog)
                {
                    (target, value) = (now, migrated_text(&tree, &migrated.value, &value));
                }
                let text = prepare_for(edited.text.clone(), &target, self.catalog);
                let value = self.with_default(&text, &target, &value);
                let placed = value.and_then(|value| {
                    let (splices, before) = self.put_value(&text, &target, &value)?;
                    Ok((value, splices, before))
                });
                let (value, splices, before) = placed.map_err(|error| {
                    let message = format!("{target}={given}: {}", error.message);
                    vec![self.diagnostic(&text, EditError { message, ..error })]
                })?;
                // When drafts are edited, a plain value may have been replaced by a `Draft` that contains the old and the new value. Record
                // this `Draft` as the new value.
                let draft = before.as_ref().filter(|_| self.options.draft);
                let draft = draft.map(|before| format!("Draft(final: {before}, draft: {value})"));
                let after = draft
                    .filter(|after| splices.iter().any(|(_, text)| text.contains(after)))
                    .unwrap_or(value);
                edited.text = apply(&text, splices);
                edited.changes.push(ValueChange { target, before, after });
            } else {
                let structure = Structure::read(self, &edited.text)?;
                edited.text =
                    structure.apply(edit, &values).map_err(|errors: Vec<EditError>| {
                        errors
                            .into_iter()
                            .map(|error| self.diagnostic(&edited.text, error))
                            .collect::<Vec<_>>()
                    })?;
            }
        }
        Ok(edited)
    }

    /// Returns the errors of a text. A missing file is not an error.
    fn errors(&self, text: &str) -> Vec<Diagnostic> {
        self.check(text, self.options.draft).diagnostics
    }

    /// Checks the text of a graph: with the values for drafts if `draft` is set, otherwise with those for final results. Returns errors but
    /// no warnings; a missing file is not an error.
    pub(super) fn check(&self, text: &str, draft: bool) -> CheckedGraph {
        let mut checked = self.check_with(Files::Inside, text, draft);
        // A file outside of the project stops the check. To also find the errors of values, check again and ignore files.
        if checked.diagnostics.iter().any(|diagnostic| diagnostic.code == code::OUTSIDE) {
            let others = self.check_with(Files::Ignored, text, draft).diagnostics.into_iter();
            let others = others.filter(|diagnostic| !checked.diagnostics.contains(diagnostic));
            let others = Vec::from_iter(others);
            checked.diagnostics.extend(others);
        }
        checked.diagnostics.retain(|diagnostic| diagnostic.severity == Severity::Error);
        checked
    }

    /// Returns true if a file exists, or if the options have a text that replaces it.
    pub(super) fn has_file(&self, path: &Path) -> bool {
        self.options.has_text(path) || path.symlink_metadata().is_ok()
    }

    fn check_with(&self, files: Files, text: &str, draft: bool) -> CheckedGraph {
        let options = Options { files, draft, ..self.options.clone() };
        load_text(self.path, text.to_owned(), self.catalog, &options)
    }

    pub(super) fn diagnostic(&self, text: &str, error: EditError) -> Diagnostic {
        let source = Arc::new(Source { name: self.path.to_owned(), text: text.to_owned() });
        let EditError { code, span, message, help } = error;
        Diagnostic { help, ..Diagnostic::new(Severity::Error, code, (source, span), message) }
    }
}

/// Returns the diagnostics that are not among the `known` ones. If `other_names` is set, messages that differ only in names count as equal.
fn new_errors(
    known: &[Diagnostic],
    diagnostics: Vec<Diagnostic>,
    other_names: bool,
) -> Vec<Diagnostic> {
    fn key(diagnostic: &Diagnostic, other_names: bool) -> (&'static str, Option<String>) {
        (diagnostic.code, (!other_names).then(|| diagnostic.message.clone()))
    }
    let mut counts: HashMap<_, usize> = HashMap::new();
    for diagnostic in known {
        *counts.entry(key(diagnostic, other_names)).or_default() += 1;
    }
    let mut new = diagnostics;
    new.retain(|diagnostic| match counts.get_mut(&key(diagnostic, other_names)) {
        Some(count) if 0 < *count => {
            *count -= 1;
            false
        }
        _ => true,
    });
    new
}

/// Returns the possible spellings of a value that a user has typed: the value itself if it is RON, and the value with quotes added if it
/// may be a text, or a list of texts, without quotes. Only bare words, and lists that contain some, have two spellings.
fn spellings(value: &str) -> Vec<String> {
    let (tree, errors) = parse(value);
    if !errors.is_empty() {
        return vec![list_of_texts(value).unwrap_or_else(|| quote(value))];
    }
    // Remove comments and spaces around the value.
    let plain = value[tree.span.start..tree.span.end].to_owned();
    let texts = match tree.kind {
        Kind::Word(_) => Some(quote(value)),
        Kind::List(items) if items.iter().any(|item| matches!(item.kind, Kind::Word(_))) => {
            list_of_texts(&plain)
        }
        _ => None,
    };
    std::iter::once(plain).chain(texts).collect()
}

/// Returns a list such as `[scan.color, "mask"]` with quotes around all items. `None` if the value is not a list of words that can be
/// links.
fn list_of_texts(value: &str) -> Option<String> {
    let items = value.trim().strip_prefix('[')?.strip_suffix(']')?.trim();
    let items = items.strip_suffix(',').unwrap_or(items).split(',').map(str::trim);
    Some(format!("[{}]", items.map(quoted_word).collect::<Option<Vec<_>>>()?.join(", ")))
}

/// Returns a word in quotes. `None` if the word has characters that a name or link cannot have.
fn quoted_word(item: &str) -> Option<String> {
    let word = item.strip_prefix('"').and_then(|item| item.strip_suffix('"')).unwrap_or(item);
    (!word.is_empty() && word.chars().all(|c: char| c.is_alphanumeric() || "_-.".contains(c)))
        .then(|| quote(word))
}
