//! Fields that a call needs and does not have, as what may be written there.

use maquette_syntax::cursor;
use maquette_syntax::error::{Problem, Span, code};

use super::completion::{Sort, proposals};
use super::library::Library;
use super::scope::Scope;
use super::slot::{Inside, Slot, Slots};

/// So many values are offered for a field,
const MOST: usize = 5;

/// of so many that are tried.
const MOST_TRIED: usize = 20;

/// The ways to add the field that a problem says is missing: texts that are put into one place, the likeliest first, of which each is right.
/// A port without anything to link gets an empty link, which completion fills.
pub(super) fn additions(
    library: &Library<'_>,
    problem: &Problem,
    is_right: impl Fn(&str) -> bool,
) -> Option<(Span, Vec<String>)> {
    let text = &problem.source.text[..];
    let call = text.get(problem.span.start..problem.span.end)?;
    let open = problem.span.start + call.find('(')? + 1;
    if problem.code != code::MISSING_FIELD {
        return None;
    }
    let scope = Scope::of(text);
    let frames = cursor(text, open).frames;
    let given = &frames.last()?.given;
    let (inside, _) = Slots { library, scope: &scope }.at(&frames);
    let Inside::Fields(_, fields) = inside else { return None };
    let field = fields.iter().find(|field| {
        let is_named = problem.message.contains(&format!("`{}`", field.name));
        field.required && is_named && given.iter().all(|name| name.text != field.name)
    })?;
    let is_first = text[open..].trim_start().starts_with(')');
    let end = if is_first { "" } else { ", " };
    fn whole(value: &str, end: &str, name: &str) -> String {
        format!("{name}: {value}{end}")
    }
    let (before, behind) = match &field.slot {
        Slot::Link(_) => ("\"", "\""),
        Slot::List(item) if matches!(**item, Slot::Link(_)) => ("[\"", "\"]"),
        _ => ("", ""),
    };
    // What completion proposes there.
    let start = format!("{}{}: {before}", &text[..open], field.name);
    let with_field = format!("{start}{behind}{end}{}", &text[open..]);
    let found = proposals(library, &with_field, start.len()).list.into_iter();
    fn is_value(sort: Sort) -> bool {
        matches!(sort, Sort::Link | Sort::Choice | Sort::Value | Sort::File)
    }
    let found = found.filter(|it| is_value(it.sort) && !it.insert.contains("$0)"));
    let texts = found.map(|it| {
        whole(&format!("{before}{}{behind}", it.insert.replace("$0", "")), end, &field.name)
    });
    let mut texts: Vec<_> = texts
        .take(MOST_TRIED)
        .filter(|new| is_right(&format!("{}{new}{}", &text[..open], &text[open..])))
        .take(MOST)
        .collect();
    if texts.is_empty() && !before.is_empty() {
        texts.push(whole(&format!("{before}{behind}"), end, &field.name));
    }
    (!texts.is_empty()).then_some((Span { start: open, end: open }, texts))
}
