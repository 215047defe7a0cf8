//! The place of a value in a text, by the names that lead there.

use maquette_syntax::error::{Span, code};
use maquette_syntax::{Body, DEEPEST, Field, Kind, Tree, nearest_or_all, parse, unit_names};

use super::splice::{Splice, added, put_entry};
use crate::quality;
use crate::quality::{is_draft, is_side};
use crate::tree::is_patch;

/// Why a value cannot be put where it should be.
pub struct Refusal {
    pub code: &'static str,
    pub span: Span,
    pub message: String,
    pub help: String,
}

impl Refusal {
    pub(super) fn new(span: Span, message: String, help: String) -> Self {
        Self { code: code::UNKNOWN_FIELD, span, message, help }
    }
}

/// The edits that put a value to its place, and what stands there now. What stands for a parameter is replaced only if
/// `overrules`. In a `Draft` it is the value for final results, or for drafts if the edit is of a `draft`, unless the new value is a
/// `Draft` itself. What is no `Draft` becomes one by the edit of a `draft`, which leaves the final value as it is.
pub fn place(
    text: &str,
    target: &str,
    value: &str,
    overrules: bool,
    draft: bool,
) -> Result<(Vec<Splice>, Option<String>), Refusal> {
    if target.split('.').count() > DEEPEST {
        let message = format!(
            "{}..: this leads more than {DEEPEST} deep",
            &target[..target.floor_char_boundary(40)]
        );
        return Err(Refusal::new(Span::default(), message, "no value lies that deep".into()));
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
        // Of a node that is patched further in, the longest name there is counts.
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
        return Err(Refusal {
            code: code::UNKNOWN_LINK,
            ..Refusal::new(Span::default(), message, help.into())
        });
    };
    put(entry, &path.split('.').collect::<Vec<_>>())
}

/// The same within one value.
fn in_call(
    text: &str,
    entry: &Tree,
    steps: &[&str],
    value: &str,
    overrules: bool,
    side: Option<bool>,
) -> Result<(Vec<Splice>, Option<String>), Refusal> {
    fn is_computed(text: &str) -> bool {
        let tree = parse(text).0;
        tree.call_of("Param").is_some() || tree.call_of("Expr").is_some()
    }
    if let Some((vector, index)) = vector_in_unit(entry, steps, side)
        && let Kind::Call { name: Some(unit), body: Body::Items(items) } = &vector.kind
        && let Some(item) = items.get(index)
        && (side != Some(true) || is_in_draft(entry, steps, item))
    {
        fn written(tree: &Tree, text: &str) -> String {
            text[tree.span.start..tree.span.end].to_owned()
        }
        let (new, unit) = (parse(value).0, &unit.text);
        // In the unit of the others it stands as they do.
        if let Some(number) = new.call_of(unit) {
            let number = value[number.span.start..number.span.end].to_owned();
            return Ok((vec![(item.span, number)], Some(written(item, text))));
        }
        let each = items.iter().enumerate().map(|(at, other)| match at == index {
            true => value.to_owned(),
            false => format!("{unit}({})", written(other, text)),
        });
        let all = format!("({})", Vec::from_iter(each).join(", "));
        return Ok((vec![(vector.span, all)], Some(format!("{unit}({})", written(item, text)))));
    }
    match find(entry, steps, side)? {
        Found::Value(tree) => {
            if !overrules && !is_computed(value) {
                not_computed(tree, value)?;
            }
            let before = text[tree.span.start..tree.span.end].to_owned();
            let value = match side == Some(true) && !is_in_draft(entry, steps, tree) {
                true => format!("Draft(final: {before}, draft: {value})"),
                false => value.to_owned(),
            };
            Ok((vec![(tree.span, value)], Some(before)))
        }
        Found::Missing(owner, rest) => {
            let (name, inner) = (&rest[0], &rest[1..]);
            if side == Some(true) && !is_in_draft(entry, steps, owner) {
                let message = format!("`{name}` is left out, and so has no final value to keep");
                let help = format!("give both: Draft(final: .., draft: {value})");
                let code = code::MISSING_FIELD;
                return Err(Refusal { code, ..Refusal::new(owner.span, message, help) });
            }
            if rest.iter().any(|step| step.starts_with(|c: char| c.is_ascii_digit())) {
                let message = format!("`{name}` is not there, so that it has no items to set");
                return Err(Refusal::new(owner.span, message, format!("give all of `{name}`")));
            }
            let value = inner
                .iter()
                .rev()
                .fold(value.to_owned(), |value, name| format!("({name}: {value})"));
            Ok((added(text, owner, name, &value), None))
        }
    }
}

/// The vector with one unit for all of its numbers, such as `cm(1, 0, 2)`, and the number of it that a way leads to.
fn vector_in_unit<'t>(
    entry: &'t Tree,
    steps: &[&str],
    side: Option<bool>,
) -> Option<(&'t Tree, usize)> {
    let (last, before) = steps.split_last()?;
    let index = last.parse().ok()?;
    let Ok(Found::Value(vector)) = find(entry, before, side) else { return None };
    let unit = vector.name().filter(|name| unit_names().any(|unit| unit == name.text));
    let is_vector =
        matches!(&vector.kind, Kind::Call { body: Body::Items(items), .. } if items.len() > 1);
    (unit.is_some() && is_vector).then_some((vector, index))
}

/// Whether what a way for drafts leads to lies in a `Draft`: final results have something else there.
fn is_in_draft(entry: &Tree, steps: &[&str], reached: &Tree) -> bool {
    let is_named = steps.iter().any(|step| is_side(step));
    is_named
        || !find(entry, steps, Some(false)).is_ok_and(|found| match found {
            Found::Value(other) | Found::Missing(other, _) => other.span == reached.span,
        })
}

/// The edits that give a patch an entry that it does not have: `"growth": 25.0`, or `"red.select": (distance: 25.0)`.
fn new_entry(text: &str, patch: &Tree, section: &str, target: &str, value: &str) -> Vec<Splice> {
    let entry = match target.rsplit_once('.') {
        Some((node, field)) => format!("\"{node}\": ({field}: {value})"),
        None => format!("\"{target}\": {value}"),
    };
    match field(patch, section).map(|field| &field.value) {
        Some(map @ Tree { kind: Kind::Map(_), .. }) => {
            put_entry(text, map, None, false, |_| entry.clone())
        }
        _ => added(text, patch, section, &format!("{{ {entry} }}")),
    }
}

/// Where a way through a value ends.
pub enum Found<'t> {
    Value(&'t Tree),
    /// At this call, which does not have the first of these fields.
    Missing(&'t Tree, Vec<String>),
}

/// Follows a way through fields, entries and items. The name of a choice, `Near` of `Near(..)`, may be a step of it. Of a `Draft` it goes on
/// in this side, unless it names one itself; without a side it ends there.
pub fn find<'t>(tree: &'t Tree, path: &[&str], side: Option<bool>) -> Result<Found<'t>, Refusal> {
    if is_draft(tree)
        && !path.first().is_some_and(|step| is_side(step))
        && let Some(inside) = side.and_then(|draft| quality::side(tree, draft))
    {
        return find(inside, path, side);
    }
    let Some((step, rest)) = path.split_first() else { return Ok(Found::Value(tree)) };
    not_computed(tree, "VALUE")?;
    let numbered = |items: &'t [Tree]| match step.parse::<usize>() {
        Ok(index) if index < items.len() => find(&items[index], rest, side),
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
            find_inside(tree, rest, side)
        }
        Kind::List(items) => numbered(items),
        Kind::Call { body: Body::Items(items), .. } => match &items[..] {
            // `Some(..)` and other choices with one value have the fields of the value.
            [item] if step.parse::<usize>().is_err() => find(item, path, side),
            _ => numbered(items),
        },
        Kind::Map(entries) => {
            let entry = entries.iter().find(|(key, _)| key.text() == Some(step));
            entry.map(|(_, value)| find(value, rest, side)).unwrap_or_else(|| {
                let known: Vec<&str> = entries.iter().filter_map(|(key, _)| key.text()).collect();
                let help = nearest_or_all(step, "its entries", &known);
                Err(Refusal::new(tree.span, format!("there is no entry `{step}`"), help.into()))
            })
        }
        Kind::Call { .. } => match field(tree, step) {
            Some(field) => find(&field.value, rest, side),
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
fn find_inside<'t>(
    tree: &'t Tree,
    path: &[&str],
    side: Option<bool>,
) -> Result<Found<'t>, Refusal> {
    match (&tree.kind, field(tree, path[0])) {
        (Kind::Call { body: Body::Items(items), .. }, _) if items.len() == 1 => {
            find(&items[0], path, side)
        }
        (_, Some(field)) => find(&field.value, &path[1..], side),
        _ => Ok(Found::Missing(tree, path.iter().map(|&step| step.to_owned()).collect())),
    }
}

pub fn field<'t>(tree: &'t Tree, name: &str) -> Option<&'t Field> {
    tree.fields()?.iter().find(|field| field.name.text == name)
}

/// Why nothing can be put at a way through a value, if that leads nowhere: past the last item, or into what has no parts. What is missing is no
/// reason: it can be added.
pub fn unreachable_part(tree: &Tree, path: &[&str], draft: bool) -> Option<Refusal> {
    find(tree, path, Some(draft)).err()
}

/// Refuses a place that stands for a parameter, and says which to set instead.
fn not_computed(tree: &Tree, value: &str) -> Result<(), Refusal> {
    fn refuse(message: String, help: String, tree_span: &Span) -> Result<(), Refusal> {
        Err(Refusal { code: code::EXPRESSION, ..Refusal::new(*tree_span, message, help) })
    }
    if let Some(name) = tree.call_of("Param").and_then(Tree::text) {
        let message = format!("its value is Param(\"{name}\"), a parameter of the graph");
        return refuse(message, format!("set the parameter: {name}={value}"), &tree.span);
    }
    if let Some(text) = tree.call_of("Expr").and_then(Tree::text) {
        let message = format!("its value is computed by Expr(\"{text}\")");
        return refuse(
            message,
            "set a parameter in it, or give another Expr(\"..\")".into(),
            &tree.span,
        );
    }
    Ok(())
}
