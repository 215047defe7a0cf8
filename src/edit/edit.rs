//! Edits of a graph's text, and how they are judged.

use std::borrow::Cow;
use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use maquette_graph::catalog::Catalog;
use maquette_graph::load::load_text;
use maquette_graph::migrate::{ready_for, renewed_target, renewed_text};
use maquette_graph::{Checked, Files, Options, Refusal, apply, patch, place, written};
use maquette_syntax::error::{Problem, Severity, Source, code};
use maquette_syntax::{
    Kind, Token, commas_behind, parse, quoted, syntax_problems, tokens, with_commas_behind,
};
use serde::Deserialize;

use super::structure::Structure;

/// One edit of a graph.
///
/// What is added is written in the canonical form, on lines of its own or behind its neighbors as these stand. What is taken away
/// takes the comments inside of it along and those behind it on its line; those above it stay.
///
/// A name of a node, an input or a parameter may have its section before it, `nodes.nose` or `params.nose`, and must where both
/// have the name.
///
/// As JSON it is an object of one entry: `{"add": {"name": "spots", "node": "Threshold", "fields": [["image", "scan.color"]]}}`.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase", deny_unknown_fields)]
pub enum Edit {
    /// A new node.
    Add {
        /// Its name.
        name: String,
        /// Its type: a node of the catalog, a graph under `use`, `ForEach` or `Switch`.
        node: String,
        /// Its fields in order: names, and values as RON. What is no RON is text; links may do without quotes.
        #[serde(default)]
        fields: Vec<(String, String)>,
        /// The node behind which it stands; the last one if there is none.
        #[serde(default)]
        after: Option<String>,
    },
    /// Takes away a node, an input or a parameter.
    Remove {
        /// Its name.
        name: String,
        /// Whether what names it goes along: links to ports that can do without, entries of lists of links, outputs and
        /// expectations. Else it is refused while something names it.
        #[serde(default)]
        and_links: bool,
    },
    /// Gives a node, an input or a parameter another name, with all that names it in this file. What names it in others, as a
    /// `Patch` or a use of this graph does, is not known here.
    Rename {
        /// Its name.
        from: String,
        /// The new one.
        to: String,
    },
    /// Links a port, which may have been linked before.
    Link {
        /// `node.port`; a port that takes many gets one more. `node.port.2` is the third link of the list. The ports of a `ForEach`
        /// are those of its nodes, and those of a `Switch` its cases.
        port: String,
        /// `node` or `node.output`.
        to: String,
    },
    /// Takes away the link at a port; all of them at one that takes many.
    Unlink {
        /// `node.port`, or `node.port.2` for the third link of the list.
        port: String,
    },
    /// Puts a value in place of a literal; a field that is not there is added as its author writes fields.
    Set {
        /// `name` for a parameter's default, or `node.field.field`.
        target: String,
        /// The value as RON. What is no RON is text.
        value: String,
    },
    /// Adds, changes or takes away an output.
    Output {
        /// Its name: a file, or a port of a graph that others use.
        name: String,
        /// What it gives, `node` or `node.output`; none takes it away.
        #[serde(default)]
        to: Option<String>,
    },
}

impl Edit {
    /// Its values, which may be meant as RON or as text.
    fn values(&self) -> Vec<&str> {
        match self {
            Self::Add { fields, .. } => fields.iter().map(|(_, value)| &value[..]).collect(),
            Self::Set { value, .. } => vec![value],
            _ => Vec::new(),
        }
    }
}

/// A graph file's text after some edits.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Edited {
    /// The new text.
    pub text: String,
    /// The text as it was: who puts it back has undone all of the edits.
    pub before: String,
    /// What was put where by [`Edit::Set`], in order.
    pub changes: Vec<Put>,
}

/// A value that was put into a graph file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Put {
    /// `name` or `node.field`, under the name that it has now.
    pub target: String,
    /// What stood there; none if nothing did.
    pub before: Option<String>,
    /// What stands there now.
    pub after: String,
}

/// The text of the graph file at `path` after some edits, one after the other.
///
/// What the edits do not speak of keeps every byte. The new text is checked as [`Graph::load`](maquette_graph::Graph::load) checks it, behind the last edit,
/// except that the files that the graph reads need not be there; so edits that are right together may be given together.
///
/// # Errors
/// The text cannot be read, an edit speaks of what is not there or takes away what is needed, or the new text has problems
/// that the old one does not have. Then nothing is edited. Places are those in the text that an edit was about to change, or
/// in the new one, which each problem has with it.
pub fn edit(
    path: &Path,
    text: &str,
    edits: &[Edit],
    catalog: &Catalog,
    options: &Options,
) -> Result<Edited, Vec<Problem>> {
    let (tree, mistakes) = parse(text);
    if !mistakes.is_empty() {
        return Err(syntax_problems(path, text, mistakes));
    }
    // Which of both an edit means is not known.
    let twice = patch::duplicates(&tree);
    if !twice.is_empty() {
        let source = Arc::new(Source { name: path.to_owned(), text: text.to_owned() });
        return Err(twice.into_iter().map(|finding| finding.at(&source)).collect());
    }
    let judge = Judge { path, catalog, options };
    if matches!(commas_behind(text), Cow::Borrowed(_)) {
        return judge.edited(text, edits);
    }
    // Names and values that are replaced leave commas alone.
    if edits.iter().all(|edit| matches!(edit, Edit::Rename { .. } | Edit::Set { .. }))
        && let Ok(edited) = judge.edited(text, edits)
        && commas(&edited.text) == commas(text)
    {
        return Ok(edited);
    }
    Edited::with_commas_behind(text, |text| judge.edited(text, edits))
}

fn commas(text: &str) -> usize {
    tokens(text).iter().filter(|(token, _)| *token == Token::Comma).count()
}

impl Edited {
    /// Runs an edit on a text with its commas behind values, and moves them back to the beginnings of lines.
    pub(super) fn with_commas_behind(
        text: &str,
        edit: impl FnOnce(&str) -> Result<Self, Vec<Problem>>,
    ) -> Result<Self, Vec<Problem>> {
        let mut changes = Vec::new();
        let new = with_commas_behind(text, |text| {
            let edited = edit(text)?;
            changes = edited.changes;
            Ok::<_, Vec<Problem>>(edited.text)
        })?;
        Ok(Self { text: new, before: text.to_owned(), changes })
    }
}

/// The text of the graph file at `path` with values put into it: (`name` or `node.field.field`, RON) each.
///
/// # Errors
/// As [`edit()`] with [`Edit::Set`].
pub fn edited(
    path: &Path,
    text: &str,
    set: &[(String, String)],
    catalog: &Catalog,
    options: &Options,
) -> Result<Edited, Vec<Problem>> {
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

/// A text with another name of a node, an input or a parameter in it; none if there is no such thing. What comes of it is not judged.
pub(super) fn renamed_in(
    path: &Path,
    text: &str,
    from: &str,
    to: &str,
    catalog: &Catalog,
) -> Option<String> {
    let options = Options { files: Files::Ignored, ..Options::default() };
    let judge = Judge { path, catalog, options: &options };
    let edit = Edit::Rename { from: from.to_owned(), to: to.to_owned() };
    Some(judge.done(text, &[edit], std::iter::empty()).ok()?.text)
}

/// Edits a text and judges what comes of it.
pub(super) struct Judge<'a> {
    pub(super) path: &'a Path,
    pub(super) catalog: &'a Catalog,
    pub(super) options: &'a Options,
}

impl Judge<'_> {
    fn edited(&self, text: &str, edits: &[Edit]) -> Result<Edited, Vec<Problem>> {
        let known = self.problems(text);
        let (mut spelled, mut chosen): (Vec<Vec<String>>, Vec<usize>) = (Vec::new(), Vec::new());
        for edit in edits {
            for value in edit.values() {
                let spellings = spellings(value);
                // A word in place of a text is meant as a text.
                let is_text = match edit {
                    Edit::Set { target, .. } => {
                        let draft = self.options.draft;
                        let target = written(&parse(text).0, target, draft);
                        let put =
                            |target: String| place(text, &target, &spellings[0], false, draft);
                        let old = target.and_then(put).ok().and_then(|(_, before)| before);
                        old.is_some_and(|old| old.starts_with('"'))
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
            let edited = self.done(text, edits, values)?;
            let problems = news(&known, self.problems(&edited.text), only_names);
            Ok::<_, Vec<Problem>>((edited, problems))
        };
        let (mut best, mut problems) = attempt(&chosen)?;
        for index in 0..spelled.len() {
            if problems.is_empty() || spelled[index].len() < 2 {
                continue;
            }
            chosen[index] = 1 - chosen[index];
            let (other, others) = attempt(&chosen)?;
            // A word that stands where a text stood is better only if all is well with it.
            if others.is_empty() || (chosen[index] == 1 && others.len() < problems.len()) {
                (best, problems) = (other, others);
            } else {
                chosen[index] = 1 - chosen[index];
            }
        }
        if problems.is_empty() { Ok(best) } else { Err(problems) }
    }

    /// The text after the edits, with these spellings of their values; nothing is judged yet.
    pub(super) fn done<'s>(
        &self,
        text: &str,
        edits: &[Edit],
        mut values: impl Iterator<Item = &'s str>,
    ) -> Result<Edited, Vec<Problem>> {
        let before = text.to_owned();
        let mut edited = Edited { text: before.clone(), before, changes: Vec::new() };
        for edit in edits {
            let values: Vec<_> = values.by_ref().take(edit.values().len()).collect();
            if let Edit::Set { target, value: given } = edit {
                let (mut target, mut value) = (
                    self.written(&edited.text, target).map_err(|refusal: Refusal| {
                        let message = format!("{target}={given}: {}", refusal.message);
                        vec![self.refused(&edited.text, Refusal { message, ..refusal })]
                    })?,
                    values.concat(),
                );
                let (graph, tree) = (parse(&edited.text).0, parse(&value).0);
                if let Some((now, put)) = renewed_target(&graph, &target, &tree, self.catalog) {
                    (target, value) = (now, renewed_text(&tree, &put.value, &value));
                }
                let text = ready_for(edited.text.clone(), &target, self.catalog);
                let value = self.beside_default(&text, &target, &value);
                let put = value.and_then(|value| {
                    let (splices, before) = self.put(&text, &target, &value)?;
                    Ok((value, splices, before))
                });
                let (value, splices, before) = put.map_err(|refusal| {
                    let message = format!("{target}={given}: {}", refusal.message);
                    vec![self.refused(&text, Refusal { message, ..refusal })]
                })?;
                // What was no `Draft` has become one.
                let draft = before.as_ref().filter(|_| self.options.draft);
                let draft = draft.map(|before| format!("Draft(final: {before}, draft: {value})"));
                let after = draft
                    .filter(|after| splices.iter().any(|(_, text)| text.contains(after)))
                    .unwrap_or(value);
                edited.text = apply(&text, splices);
                edited.changes.push(Put { target, before, after });
            } else {
                let structure = Structure::read(self, &edited.text)?;
                edited.text =
                    structure.edited(edit, &values).map_err(|refusals: Vec<Refusal>| {
                        refusals
                            .into_iter()
                            .map(|refusal| self.refused(&edited.text, refusal))
                            .collect::<Vec<_>>()
                    })?;
            }
        }
        Ok(edited)
    }

    /// The problems of a text, except for files that are not there.
    fn problems(&self, text: &str) -> Vec<Problem> {
        self.checked(text, self.options.draft).problems
    }

    /// What a text says, for drafts or for final results, and its errors; files need not be there.
    pub(super) fn checked(&self, text: &str, draft: bool) -> Checked {
        let check = |files| {
            let options = Options { files, draft, ..self.options.clone() };
            load_text(self.path, text.to_owned(), self.catalog, &options)
        };
        let mut checked = check(Files::Inside);
        // A file outside hides what would be wrong with values.
        if checked.problems.iter().any(|problem| problem.code == code::OUTSIDE) {
            let others = check(Files::Ignored).problems.into_iter();
            let others = others.filter(|problem| !checked.problems.contains(problem));
            let others = Vec::from_iter(others);
            checked.problems.extend(others);
        }
        checked.problems.retain(|problem| problem.severity == Severity::Error);
        checked
    }

    pub(super) fn refused(&self, text: &str, refusal: Refusal) -> Problem {
        let source = Arc::new(Source { name: self.path.to_owned(), text: text.to_owned() });
        let Refusal { code, span, message, help } = refusal;
        Problem { help, ..Problem::new(Severity::Error, code, (source, span), message) }
    }
}

/// The problems that are not among those that were known. With `other_names`, the same may be said of other names.
fn news(known: &[Problem], problems: Vec<Problem>, other_names: bool) -> Vec<Problem> {
    let key = |problem: &Problem| (problem.code, (!other_names).then(|| problem.message.clone()));
    let mut counts: HashMap<_, usize> = HashMap::new();
    for problem in known {
        *counts.entry(key(problem)).or_default() += 1;
    }
    let mut news = problems;
    news.retain(|problem| match counts.get_mut(&key(problem)) {
        Some(count) if 0 < *count => {
            *count -= 1;
            false
        }
        _ => true,
    });
    news
}

/// How a value may be meant: as RON, and as a text or a list of texts that was given without quotes, for bare words may be either.
fn spellings(value: &str) -> Vec<String> {
    let (tree, mistakes) = parse(value);
    if !mistakes.is_empty() {
        return vec![list_of_texts(value).unwrap_or_else(|| quoted(value))];
    }
    // Without comments and spaces around it.
    let plain = value[tree.span.start..tree.span.end].to_owned();
    let texts = match tree.kind {
        Kind::Word(_) => Some(quoted(value)),
        Kind::List(items) if items.iter().any(|item| matches!(item.kind, Kind::Word(_))) => {
            list_of_texts(&plain)
        }
        _ => None,
    };
    std::iter::once(plain).chain(texts).collect()
}

/// `[scan.color, "mask"]` with all in quotes; none if it is no list of such words.
fn list_of_texts(value: &str) -> Option<String> {
    let items = value.trim().strip_prefix('[')?.strip_suffix(']')?.trim();
    let items = items.strip_suffix(',').unwrap_or(items).split(',').map(str::trim);
    let written = |item: &str| {
        let word = item.strip_prefix('"').and_then(|item| item.strip_suffix('"')).unwrap_or(item);
        (!word.is_empty() && word.chars().all(|c: char| c.is_alphanumeric() || "_-.".contains(c)))
            .then(|| quoted(word))
    };
    Some(format!("[{}]", items.map(written).collect::<Option<Vec<_>>>()?.join(", ")))
}
