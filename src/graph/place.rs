//! Finds values in the text of a graph by their paths, such as `node.field`, and edits them.

use maquette_syntax::error::{Span, code};
use maquette_syntax::{Body, Field, Kind, MAX_DEPTH, Tree, nearest_or_all, parse, unit_names};

use super::splice::{Splice, add_field, put_entry};
use crate::draft_value;
use crate::draft_value::{is_draft, is_side};
use crate::tree::{is_patch, text_in_call};

/// The reason why an edit is impossible, with the code and position for a diagnostic.
pub struct EditError {
    pub code: &'static str,
    pub span: Span,
    pub message: String,
    pub help: String,
}

impl EditError {
    pub(super) fn new(span: Span, message: String, help: String) -> Self {
        Self { code: code::UNKNOWN_FIELD, span, message, help }
    }
}

/// Returns the edits that set the value at a target, and the previous value.
///
/// A `Param` or an `Expr` is replaced only if `overrules` is set. In a `Draft`, only one side is replaced: the value for drafts if `draft`
/// is set, else the one for final results. A new value that is itself a `Draft` replaces the whole. If `draft` is set, a plain value
/// becomes a `Draft` that keeps the old value for final results.
pub fn place_value(
    text: &str,
    target: &str,
    value: &str,
    overrules: bool,
    draft: bool,
) -> Result<(Vec<Splice>, Option<String>), EditError> {
    if target.split('.').count() > MAX_DEPTH {
        let message = format!(
            "{}..: the path has more than {MAX_DEPTH} steps",
            &target[..target.floor_char_boundary(40)]
        );
        return Err(EditError::new(Span::default(), message, "use a shorter path".into()));
    }
    let side = (!is_draft(&parse(value).0)).then_some(draft);
    let put = |entry: &Tree, steps: &[&str]| in_call(text, entry, steps, value, overrules, side);
    let (tree, _) = parse(text);
    let is_patch = is_patch(&tree);
    let (section, what, name, path) = match target.split_once('.') {
        _ if overrules && target == "doc" => {
            return put(&tree, &["doc"]);
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
        // If several entries of a patch contain the target, the one with the longest key is used.
        fn begins(key: &str, target: &str) -> Option<String> {
            target.strip_prefix(key).and_then(|rest| rest.strip_prefix('.')).map(str::to_owned)
        }
        let known =
            entries.iter().filter_map(|(key, entry)| Some((begins(key.text()?, target)?, entry)));
        return match (known.min_by_key(|(rest, _)| rest.len()), entry) {
            (Some((rest, entry)), _) => put(entry, &rest.split('.').collect::<Vec<_>>()),
            (None, Some((_, entry))) => put(entry, &[]),
            (None, None) => Ok((new_entry(text, &tree, section, target, value), None)),
        };
    }
    let Some((_, entry)) = entry else {
        let known: Vec<&str> = entries.iter().filter_map(|(key, _)| key.text()).collect();
        let help = nearest_or_all(name, &format!("its {what}s"), &known);
        let message = format!("the graph has no {what} `{name}`");
        return Err(EditError {
            code: code::UNKNOWN_LINK,
            ..EditError::new(Span::default(), message, help.into())
        });
    };
    put(entry, &path.split('.').collect::<Vec<_>>())
}

/// Returns the edits that set a part of one value, such as a field of a node call.
fn in_call(
    text: &str,
    entry: &Tree,
    steps: &[&str],
    value: &str,
    overrules: bool,
    side: Option<bool>,
) -> Result<(Vec<Splice>, Option<String>), EditError> {
    fn is_computed(text: &str) -> bool {
        let tree = parse(text).0;
        tree.call_of("Param").is_some() || tree.call_of("Expr").is_some()
    }
    if let Some((vector, index)) = vector_in_unit(entry, steps, side)
        && let Kind::Call { name: Some(unit), body: Body::Items(items) } = &vector.kind
        && let Some(item) = items.get(index)
        && (side != Some(true) || is_in_draft(entry, steps, item))
    {
        fn text_of(tree: &Tree, text: &str) -> String {
            text[tree.span.start..tree.span.end].to_owned()
        }
        let (new, unit) = (parse(value).0, &unit.text);
        // Omit the unit of the number if it equals the unit of the vector.
        if let Some(number) = new.call_of(unit) {
            let number = value[number.span.start..number.span.end].to_owned();
            return Ok((vec![(item.span, number)], Some(text_of(item, text))));
        }
        let each = items.iter().enumerate().map(|(at, other)| match at == index {
            true => value.to_owned(),
            false => format!("{unit}({})", text_of(other, text)),
        });
        let all = format!("({})", Vec::from_iter(each).join(", "));
        return Ok((vec![(vector.span, all)], Some(format!("{unit}({})", text_of(item, text)))));
    }
    match find(entry, steps, side)? {
        PathEnd::Value(tree) => {
            if !overrules && !is_computed(value) {
                check_not_computed(tree, value)?;
            }
            let before = text[tree.span.start..tree.span.end].to_owned();
            let value = match side == Some(true) && !is_in_draft(entry, steps, tree) {
                true => format!("Draft(final: {before}, draft: {value})"),
                false => value.to_owned(),
            };
            Ok((vec![(tree.span, value)], Some(before)))
        }
        PathEnd::Missing(owner, rest) => {
            let (name, inner) = (&rest[0], &rest[1..]);
            if side == Some(true) && !is_in_draft(entry, steps, owner) {
                let message = format!("`{name}` is omitted, so it has no final value to keep");
                let help = format!("give both: Draft(final: .., draft: {value})");
                let code = code::MISSING_FIELD;
                return Err(EditError { code, ..EditError::new(owner.span, message, help) });
            }
            if rest.iter().any(|step| step.starts_with(|c: char| c.is_ascii_digit())) {
                let message = format!("`{name}` does not exist, so it has no items to set");
                return Err(EditError::new(owner.span, message, format!("give all of `{name}`")));
            }
            let value = inner
                .iter()
                .rev()
                .fold(value.to_owned(), |value, name| format!("({name}: {value})"));
            Ok((add_field(text, owner, name, &value), None))
        }
    }
}

/// If a path leads to a number in a vector with a common unit, such as `cm(1, 0, 2)`, returns the vector and the index of the number.
fn vector_in_unit<'t>(
    entry: &'t Tree,
    steps: &[&str],
    side: Option<bool>,
) -> Option<(&'t Tree, usize)> {
    let (last, before) = steps.split_last()?;
    let index = last.parse().ok()?;
    let Ok(PathEnd::Value(vector)) = find(entry, before, side) else { return None };
    let unit = vector.name().filter(|name| unit_names().any(|unit| unit == name.text));
    let is_vector =
        matches!(&vector.kind, Kind::Call { body: Body::Items(items), .. } if items.len() > 1);
    (unit.is_some() && is_vector).then_some((vector, index))
}

/// Returns true if the value at a path is inside of a `Draft`. It can then be changed for drafts without affecting final results.
fn is_in_draft(entry: &Tree, steps: &[&str], reached: &Tree) -> bool {
    let is_named = steps.iter().any(|step| is_side(step));
    is_named
        || !find(entry, steps, Some(false)).is_ok_and(|found| match found {
            PathEnd::Value(other) | PathEnd::Missing(other, _) => other.span == reached.span,
        })
}

/// Returns the edits that add an entry to a patch, such as `"growth": 25.0` or `"red.select": (distance: 25.0)`.
fn new_entry(text: &str, patch: &Tree, section: &str, target: &str, value: &str) -> Vec<Splice> {
    let entry = match target.rsplit_once('.') {
        Some((node, field)) => format!("\"{node}\": ({field}: {value})"),
        None => format!("\"{target}\": {value}"),
    };
    match field(patch, section).map(|field| &field.value) {
        Some(map @ Tree { kind: Kind::Map(_), .. }) => {
            put_entry(text, map, None, false, |_| entry.clone())
        }
        _ => add_field(text, patch, section, &format!("{{ {entry} }}")),
    }
}

/// The result of following a path through a value.
pub enum PathEnd<'t> {
    Value(&'t Tree),
    /// The path ends at a missing field. Contains the call that lacks the field, and the rest of the path, which begins with that field.
    Missing(&'t Tree, Vec<String>),
}

/// Follows a path through fields, entries and items. The name of a choice, such as `Near` in `Near(..)`, may be a step of the path. At a
/// `Draft`, a step that names a side selects that side; otherwise `side` does. If `side` is `None`, the path ends at the `Draft`.
pub fn find<'t>(
    tree: &'t Tree,
    path: &[&str],
    side: Option<bool>,
) -> Result<PathEnd<'t>, EditError> {
    if is_draft(tree)
        && !path.first().is_some_and(|step| is_side(step))
        && let Some(inside) = side.and_then(|draft| draft_value::side(tree, draft))
    {
        return find(inside, path, side);
    }
    let Some((step, rest)) = path.split_first() else { return Ok(PathEnd::Value(tree)) };
    check_not_computed(tree, "VALUE")?;
    let numbered = |items: &'t [Tree]| match step.parse::<usize>() {
        Ok(index) if index < items.len() => find(&items[index], rest, side),
        _ => {
            let message = format!("there is no item `{step}`");
            let help = match items.len() {
                0 => "it is empty".to_owned(),
                count => format!("its items are numbered from 0 to {}", count - 1),
            };
            Err(EditError::new(tree.span, message, help))
        }
    };
    match &tree.kind {
        Kind::Call { name: Some(name), .. } if name.text == *step && !rest.is_empty() => {
            find_inside(tree, rest, side)
        }
        Kind::List(items) => numbered(items),
        Kind::Call { body: Body::Items(items), .. } => match &items[..] {
            // A choice such as `Some(..)` is not a step of the path, which continues in the fields of its only value.
            [item] if step.parse::<usize>().is_err() => find(item, path, side),
            _ => numbered(items),
        },
        Kind::Map(entries) => {
            let entry = entries.iter().find(|(key, _)| key.text() == Some(step));
            entry.map(|(_, value)| find(value, rest, side)).unwrap_or_else(|| {
                let known: Vec<&str> = entries.iter().filter_map(|(key, _)| key.text()).collect();
                let help = nearest_or_all(step, "its entries", &known);
                Err(EditError::new(tree.span, format!("there is no entry `{step}`"), help.into()))
            })
        }
        Kind::Call { .. } => match field(tree, step) {
            Some(field) => find(&field.value, rest, side),
            None => Ok(missing(tree, path)),
        },
        Kind::Word(_) => Ok(missing(tree, path)),
        _ => {
            let message = format!("there is no `{step}` in {}", tree.describe());
            Err(EditError::new(tree.span, message, String::new()))
        }
    }
}

fn missing<'t>(tree: &'t Tree, path: &[&str]) -> PathEnd<'t> {
    PathEnd::Missing(tree, path.iter().map(|&step| step.to_owned()).collect())
}

/// Follows the rest of a path inside of a choice, after a step that named the choice.
fn find_inside<'t>(
    tree: &'t Tree,
    path: &[&str],
    side: Option<bool>,
) -> Result<PathEnd<'t>, EditError> {
    match (&tree.kind, field(tree, path[0])) {
        (Kind::Call { body: Body::Items(items), .. }, _) if items.len() == 1 => {
            find(&items[0], path, side)
        }
        (_, Some(field)) => find(&field.value, &path[1..], side),
        _ => Ok(missing(tree, path)),
    }
}

pub fn field<'t>(tree: &'t Tree, name: &str) -> Option<&'t Field> {
    tree.fields()?.iter().find(|field| field.name.text == name)
}

/// Returns the error for a path that cannot exist: it leads beyond the last item of a list, or into a value without parts. A missing field
/// is not an error, because it can be added.
pub fn unreachable_part(tree: &Tree, path: &[&str], draft: bool) -> Option<EditError> {
    find(tree, path, Some(draft)).err()
}

/// Returns an error if the value is a `Param` or an `Expr`. The error states which parameter to set instead.
fn check_not_computed(tree: &Tree, value: &str) -> Result<(), EditError> {
    fn computed_error(message: String, help: String, tree_span: &Span) -> Result<(), EditError> {
        Err(EditError { code: code::EXPRESSION, ..EditError::new(*tree_span, message, help) })
    }
    if let Some(name) = text_in_call(tree, "Param") {
        let message = format!("its value is Param(\"{name}\"), a parameter of the graph");
        return computed_error(message, format!("set the parameter: {name}={value}"), &tree.span);
    }
    if let Some(text) = text_in_call(tree, "Expr") {
        let message = format!("its value is computed by Expr(\"{text}\")");
        return computed_error(
            message,
            "set a parameter in it, or give another Expr(\"..\")".into(),
            &tree.span,
        );
    }
    Ok(())
}
