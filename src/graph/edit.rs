//! Puts values into the text of a graph file without touching another byte.

use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use super::check::load_text;
use super::{Files, Graph, Options};
use crate::catalog::Catalog;
use crate::error::{Problem, Severity, Source, Span, code};
use crate::text::{Body, Field, Kind, Token, Tree, nearest_or_all, parse, syntax_problems, tokens};

/// A graph file's text with values put into it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Edited {
    /// The new text.
    pub text: String,
    /// What was put where, in order.
    pub changes: Vec<Put>,
}

/// A value that was put into a graph file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Put {
    /// `name` or `node.field`, as it was given.
    pub target: String,
    /// What stood there; none if nothing did.
    pub before: Option<String>,
    /// What stands there now.
    pub after: String,
}

impl Graph {
    /// The text of the graph file at `path` with values put into it: (`name` or `node.field.field`, RON) each.
    ///
    /// Only the literals named change; a field that is not there is added as the author writes fields. The values are checked
    /// as [`Graph::load`] checks them, except that the files that the graph reads need not be there.
    ///
    /// # Errors
    /// The text cannot be read, a target is not there or stands for a parameter, or the new text has problems that the old one
    /// does not have.
    pub fn edited(
        path: &Path,
        text: &str,
        set: &[(String, String)],
        catalog: &Catalog,
        options: &Options,
    ) -> Result<Edited, Vec<Problem>> {
        let (_, mistakes) = parse(text);
        if !mistakes.is_empty() {
            return Err(syntax_problems(path, text, mistakes));
        }
        let judge = Judge { path, catalog, options };
        judge.edited(text, set)
    }
}

/// Puts values into a text and judges what comes of it.
struct Judge<'a> {
    path: &'a Path,
    catalog: &'a Catalog,
    options: &'a Options,
}

impl Judge<'_> {
    fn edited(&self, text: &str, set: &[(String, String)]) -> Result<Edited, Vec<Problem>> {
        let known = self.problems(text);
        let spellings: Vec<Vec<String>> = set.iter().map(|(_, value)| spellings(value)).collect();
        let mut chosen: Vec<usize> = Vec::with_capacity(set.len());
        for ((target, _), spellings) in set.iter().zip(&spellings) {
            // A word in place of a text is meant as a text.
            let old = place(text, target, &spellings[0], false).ok().and_then(|(_, before)| before);
            let is_text = old.is_some_and(|old| old.starts_with('"'));
            chosen.push(if is_text { spellings.len() - 1 } else { 0 });
        }
        let attempt = |chosen: &[usize]| {
            let spelled = spellings.iter().zip(chosen).map(|(spellings, &k)| &spellings[k]);
            let edited = self.put(text, set, spelled)?;
            let problems = news(&known, self.problems(&edited.text));
            Ok::<_, Vec<Problem>>((edited, problems))
        };
        let (mut best, mut problems) = attempt(&chosen)?;
        for index in 0..set.len() {
            if problems.is_empty() || spellings[index].len() < 2 {
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

    fn put<'s>(
        &self,
        text: &str,
        set: &[(String, String)],
        values: impl Iterator<Item = &'s String>,
    ) -> Result<Edited, Vec<Problem>> {
        let mut edited = Edited { text: text.to_owned(), changes: Vec::new() };
        for ((target, given), value) in set.iter().zip(values) {
            let (edits, before) = place(&edited.text, target, value, false)
                .map_err(|refusal| vec![self.refused(&edited.text, target, given, refusal)])?;
            edited.text = apply(&edited.text, edits);
            edited.changes.push(Put { target: target.clone(), before, after: value.clone() });
        }
        Ok(edited)
    }

    /// The problems of a text, except for files that are not there.
    fn problems(&self, text: &str) -> Vec<Problem> {
        let check = |files| {
            let options = Options { files, ..self.options.clone() };
            load_text(self.path, text.to_owned(), self.catalog, &options).problems
        };
        let mut problems = check(Files::Ignored);
        let outside = check(Files::Needed).into_iter();
        problems.extend(outside.filter(|problem| problem.code == code::OUTSIDE));
        problems
    }

    fn refused(&self, text: &str, target: &str, value: &str, refusal: Refusal) -> Problem {
        let source = Source { name: self.path.to_owned(), text: text.to_owned() };
        Problem {
            severity: Severity::Error,
            code: refusal.code,
            source: Arc::new(source),
            span: refusal.span,
            message: format!("{target}={value}: {}", refusal.message),
            help: refusal.help,
            note: None,
            uses: Vec::new(),
        }
    }
}

/// The problems that are not among those that were known.
fn news(known: &[Problem], problems: Vec<Problem>) -> Vec<Problem> {
    let key = |problem: &Problem| (problem.code, problem.message.clone());
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

/// How a value may be meant: as RON, and as a text that was given without its quotes, for a bare word may be either.
fn spellings(value: &str) -> Vec<String> {
    let quoted = || {
        let escaped = value.replace('\\', "\\\\").replace('"', "\\\"");
        format!("\"{}\"", escaped.replace('\n', "\\n").replace('\r', "\\r").replace('\t', "\\t"))
    };
    let (tree, mistakes) = parse(value);
    if !mistakes.is_empty() {
        return vec![quoted()];
    }
    // Without comments and spaces around it.
    let plain = value[tree.span.start..tree.span.end].to_owned();
    match tree.kind {
        Kind::Word(_) => vec![plain, quoted()],
        _ => vec![plain],
    }
}

/// Why a value cannot be put where it should be.
pub(super) struct Refusal {
    pub(super) code: &'static str,
    pub(super) span: Span,
    pub(super) message: String,
    pub(super) help: String,
}

impl Refusal {
    fn new(span: Span, message: String, help: String) -> Self {
        Self { code: code::UNKNOWN_FIELD, span, message, help }
    }
}

/// A text in place of a part of another.
pub(super) type Edit = (Span, String);

fn apply(text: &str, mut edits: Vec<Edit>) -> String {
    edits.sort_by_key(|(span, _)| *span);
    let mut result = String::with_capacity(text.len() + 64);
    let mut copied = 0;
    for (span, new) in edits {
        result.push_str(&text[copied..span.start]);
        result.push_str(&new);
        copied = span.end;
    }
    result + &text[copied..]
}

/// The edits that put a value to its place, and what stands there now. What stands for a parameter is replaced only if
/// `overrules`.
pub(super) fn place(
    text: &str,
    target: &str,
    value: &str,
    overrules: bool,
) -> Result<(Vec<Edit>, Option<String>), Refusal> {
    let (tree, _) = parse(text);
    let is_patch = tree.name().is_some_and(|name| name.text == "Patch");
    let (section, what, name, path) = match target.split_once('.') {
        _ if overrules && target == "doc" => {
            return in_call(text, &tree, &["doc"], value, overrules);
        }
        Some((node, path)) => ("nodes", "node", node, path),
        None if is_patch => ("params", "parameter", target, ""),
        None => ("params", "parameter", target, "default"),
    };
    let fields = tree.fields().unwrap_or_default().iter();
    let maps = fields.filter(|field| field.name.text == section);
    let entries = maps.filter_map(|field| match &field.value.kind {
        Kind::Map(entries) => Some(entries),
        _ => None,
    });
    let entries: Vec<_> = entries.flatten().collect();
    let entry = entries.iter().find(|(key, _)| key.text() == Some(name));
    if is_patch {
        // Of a node that is patched further in, the longest name there is counts.
        let begins = |key: &str| {
            target.strip_prefix(key).and_then(|rest| rest.strip_prefix('.')).map(str::to_owned)
        };
        let known = entries.iter().filter_map(|(key, entry)| Some((begins(key.text()?)?, entry)));
        return match (known.min_by_key(|(rest, _)| rest.len()), entry) {
            (Some((rest, entry)), _) => {
                in_call(text, entry, &Vec::from_iter(rest.split('.')), value, overrules)
            }
            (None, Some((_, entry))) => in_call(text, entry, &[], value, overrules),
            (None, None) => Ok((new_entry(text, &tree, section, target, value), None)),
        };
    }
    let Some((_, entry)) = entry else {
        let known: Vec<&str> = entries.iter().filter_map(|(key, _)| key.text()).collect();
        let help = nearest_or_all(name, &format!("its {what}s"), &known);
        let message = format!("the graph has no {what} `{name}`");
        return Err(Refusal {
            code: code::UNKNOWN_LINK,
            ..Refusal::new(Span::default(), message, help)
        });
    };
    in_call(text, entry, &Vec::from_iter(path.split('.')), value, overrules)
}

/// The same within one value.
fn in_call(
    text: &str,
    entry: &Tree,
    steps: &[&str],
    value: &str,
    overrules: bool,
) -> Result<(Vec<Edit>, Option<String>), Refusal> {
    let is_computed = |text: &str| {
        let tree = parse(text).0;
        tree.call_of("Param").is_some() || tree.call_of("Expr").is_some()
    };
    match find(entry, steps)? {
        Found::Value(tree) => {
            if !overrules && !is_computed(value) {
                not_computed(tree, value)?;
            }
            let before = text[tree.span.start..tree.span.end].to_owned();
            Ok((vec![(tree.span, value.to_owned())], Some(before)))
        }
        Found::Missing(owner, rest) => {
            let (name, inner) = (&rest[0], &rest[1..]);
            if rest.iter().any(|step| step.starts_with(|c: char| c.is_ascii_digit())) {
                let message = format!("`{name}` is not there, so that it has no items to set");
                return Err(Refusal::new(owner.span, message, format!("give all of `{name}`")));
            }
            let within = |value, name: &String| format!("({name}: {value})");
            let value = inner.iter().rev().fold(value.to_owned(), within);
            Ok((added(text, owner, name, &value), None))
        }
    }
}

/// The edits that give a patch an entry that it does not have: `"growth": 25.0`, or `"red.select": (distance: 25.0)`.
fn new_entry(text: &str, patch: &Tree, section: &str, target: &str, value: &str) -> Vec<Edit> {
    let entry = match target.rsplit_once('.') {
        Some((node, field)) => format!("\"{node}\": ({field}: {value})"),
        None => format!("\"{target}\": {value}"),
    };
    let map = field(patch, section).map(|field| &field.value);
    match map.map(|map| (&map.kind, map.span)) {
        Some((Kind::Map(entries), span)) => match &entries[..] {
            [before @ .., (key, value)] => {
                let before = before.last().map(|(_, value)| value.span.end);
                let last = Span { start: key.span.start, end: value.span.end };
                behind(text, span, before, last, &entry)
            }
            [] => vec![(span, format!("{{ {entry} }}"))],
        },
        _ => added(text, patch, section, &format!("{{ {entry} }}")),
    }
}

/// Where a way through a value ends.
enum Found<'t> {
    Value(&'t Tree),
    /// At this call, which does not have the first of these fields.
    Missing(&'t Tree, Vec<String>),
}

/// Follows a way through fields, entries and items. The name of a choice, `Near` of `Near(..)`, may be a step of it.
fn find<'t>(tree: &'t Tree, path: &[&str]) -> Result<Found<'t>, Refusal> {
    let Some((step, rest)) = path.split_first() else { return Ok(Found::Value(tree)) };
    not_computed(tree, "VALUE")?;
    let numbered = |items: &'t [Tree]| match step.parse::<usize>() {
        Ok(index) if index < items.len() => find(&items[index], rest),
        _ => {
            let message = format!("there is no item `{step}`");
            let help = match items.len() {
                0 => "it is empty".to_owned(),
                count => format!("its items are numbered from 0 to {}", count - 1),
            };
            Err(Refusal::new(tree.span, message, help))
        }
    };
    let missing = || Ok(Found::Missing(tree, path.iter().map(|&step| step.to_owned()).collect()));
    match &tree.kind {
        Kind::Call { name: Some(name), .. } if name.text == *step && !rest.is_empty() => {
            find_inside(tree, rest)
        }
        Kind::List(items) => numbered(items),
        Kind::Call { body: Body::Items(items), .. } => match &items[..] {
            // `Some(..)` and other choices with one value have the fields of the value.
            [item] if step.parse::<usize>().is_err() => find(item, path),
            _ => numbered(items),
        },
        Kind::Map(entries) => {
            let entry = entries.iter().find(|(key, _)| key.text() == Some(step));
            entry.map(|(_, value)| find(value, rest)).unwrap_or_else(|| {
                let known: Vec<&str> = entries.iter().filter_map(|(key, _)| key.text()).collect();
                let help = nearest_or_all(step, "its entries", &known);
                Err(Refusal::new(tree.span, format!("there is no entry `{step}`"), help))
            })
        }
        Kind::Call { .. } => match field(tree, step) {
            Some(field) => find(&field.value, rest),
            None => missing(),
        },
        Kind::Word(_) => missing(),
        _ => {
            let message = format!("there is no `{step}` in {}", tree.in_words());
            Err(Refusal::new(tree.span, message, String::new()))
        }
    }
}

/// The same behind the name of a choice.
fn find_inside<'t>(tree: &'t Tree, path: &[&str]) -> Result<Found<'t>, Refusal> {
    match (&tree.kind, field(tree, path[0])) {
        (Kind::Call { body: Body::Items(items), .. }, _) if items.len() == 1 => {
            find(&items[0], path)
        }
        (_, Some(field)) => find(&field.value, &path[1..]),
        _ => Ok(Found::Missing(tree, path.iter().map(|&step| step.to_owned()).collect())),
    }
}

fn field<'t>(tree: &'t Tree, name: &str) -> Option<&'t Field> {
    tree.fields()?.iter().find(|field| field.name.text == name)
}

/// Refuses a place that stands for a parameter, and says which to set instead.
fn not_computed(tree: &Tree, value: &str) -> Result<(), Refusal> {
    let refuse = |message: String, help: String| {
        Err(Refusal { code: code::EXPRESSION, ..Refusal::new(tree.span, message, help) })
    };
    if let Some(name) = tree.call_of("Param").and_then(Tree::text) {
        let message = format!("its value is Param(\"{name}\"), a parameter of the graph");
        return refuse(message, format!("set the parameter: {name}={value}"));
    }
    if let Some(text) = tree.call_of("Expr").and_then(Tree::text) {
        let message = format!("its value is computed by Expr(\"{text}\")");
        return refuse(message, "set a parameter in it, or give another Expr(\"..\")".into());
    }
    Ok(())
}

/// The edits that add a field to a call, or to a bare word, as its author writes fields.
fn added(text: &str, owner: &Tree, name: &str, value: &str) -> Vec<Edit> {
    let insert = |at: usize, text: String| (Span { start: at, end: at }, text);
    let Some(last) = owner.fields().and_then(<[Field]>::last) else {
        // `Name` or `Name()`, perhaps with spaces or comments in it.
        let inside = &text[owner.span.start..owner.span.end];
        return match inside.find('(') {
            Some(open) => vec![insert(owner.span.start + open + 1, format!("{name}: {value}"))],
            None => vec![insert(owner.span.end, format!("({name}: {value})"))],
        };
    };
    let colon = &text[last.name.span.end..last.value.span.start];
    let colon = if colon.trim() == ":" && !colon.contains('\n') { colon } else { ": " };
    let new = format!("{name}{colon}{value}");
    let before = match owner.fields() {
        Some([.., before, _]) => Some(before.value.span.end),
        _ => None,
    };
    let last = Span { start: last.name.span.start, end: last.value.span.end };
    behind(text, owner.span, before, last, &new)
}

/// The edits that put a new field or entry behind the last one of `owner`: on a line of its own if that one is. `before` is where
/// the one before the last ends.
fn behind(text: &str, owner: Span, before: Option<usize>, last: Span, new: &str) -> Vec<Edit> {
    let insert = |at: usize, text: String| (Span { start: at, end: at }, text);
    let line = text[..last.start].rfind('\n').map_or(0, |newline| newline + 1);
    let indent = &text[line..last.start];
    let tail = Tail::of(text, last.end, owner.end);
    if line > owner.start && indent.trim().is_empty() {
        let newline = if text[..line].ends_with("\r\n") { "\r\n" } else { "\n" };
        return match tail.comma {
            Some(_) => vec![insert(tail.line_end, format!("{newline}{indent}{new},"))],
            None if tail.line_end == last.end => {
                vec![insert(tail.line_end, format!(",{newline}{indent}{new}"))]
            }
            None => vec![
                insert(last.end, ",".into()),
                insert(tail.line_end, format!("{newline}{indent}{new}")),
            ],
        };
    }
    let is_tight = before.is_some_and(|before| &text[before..last.start] == ",");
    let comma = if is_tight { "," } else { ", " };
    vec![insert(last.end, format!("{comma}{new}"))]
}

/// What follows the last field of a call.
struct Tail {
    /// The comma behind it.
    comma: Option<usize>,
    /// Where its line ends, comments included; the line of the comma if there is one.
    line_end: usize,
}

impl Tail {
    fn of(text: &str, value_end: usize, call_end: usize) -> Self {
        let mut tail = Self { comma: None, line_end: value_end };
        let mut same_line = true;
        // A text that begins in the middle of a graph is still cut into the right pieces.
        for (part, span) in tokens(&text[value_end..call_end]) {
            let (start, end) = (value_end + span.start, value_end + span.end);
            match part {
                Token::Comma => {
                    tail = Self { comma: Some(start), line_end: end };
                    same_line = true;
                }
                Token::Space if text[start..end].contains('\n') => same_line = false,
                Token::LineComment | Token::BlockComment if same_line => {
                    tail.line_end = start + text[start..end].trim_end().len();
                }
                Token::Close => break,
                _ => {}
            }
        }
        tail
    }
}
