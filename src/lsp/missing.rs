//! Quick fixes that add missing required fields.

use maquette_syntax::cursor;
use maquette_syntax::error::{Diagnostic, Span, code};

use super::completion::{ProposalKind, proposals};
use super::expected_syntax::{BracketContent, ExpectedSyntax, SyntaxResolver};
use super::library::Library;
use super::scope::Scope;

/// The maximum number of values offered to the user for one missing field.
const MAX_OFFERED: usize = 5;

/// The maximum number of values tried for one missing field.
const MAX_TRIED: usize = 20;

/// Returns texts that add the field which a diagnostic reports as missing, and where to insert them. The most likely text comes first. Each
/// text is tested: `is_right` is called with the content of the file after the insertion. If no link fits a missing port, the port gets an
/// empty link that the user can complete.
pub(super) fn additions(
    library: &Library<'_>,
    problem: &Diagnostic,
    is_right: impl Fn(&str) -> bool,
) -> Option<(Span, Vec<String>)> {
    let text = &problem.source.text[..];
    let call = text.get(problem.span.start..problem.span.end)?;
    let open = problem.span.start + call.find('(')? + 1;
    if problem.code != code::MISSING_FIELD {
        return None;
    }
    let scope = Scope::parse(text);
    let frames = cursor(text, open).frames;
    let given = &frames.last()?.names;
    let (inside, _) = SyntaxResolver { library, scope: &scope }.resolve(&frames);
    let BracketContent::Fields(_, fields) = inside else { return None };
    let field = fields.iter().find(|field| {
        let is_named = problem.message.contains(&format!("`{}`", field.name));
        field.required && is_named && given.iter().all(|name| name.text != field.name)
    })?;
    let is_first = text[open..].trim_start().starts_with(')');
    let end = if is_first { "" } else { ", " };
    fn field_text(value: &str, end: &str, name: &str) -> String {
        format!("{name}: {value}{end}")
    }
    let (before, behind) = match &field.slot {
        ExpectedSyntax::Link(_) => ("\"", "\""),
        ExpectedSyntax::List(item) if matches!(**item, ExpectedSyntax::Link(_)) => ("[\"", "\"]"),
        _ => ("", ""),
    };
    // Try the values that completion would propose at this position.
    let start = format!("{}{}: {before}", &text[..open], field.name);
    let with_field = format!("{start}{behind}{end}{}", &text[open..]);
    let found = proposals(library, &with_field, start.len()).list.into_iter();
    fn is_value(sort: ProposalKind) -> bool {
        matches!(
            sort,
            ProposalKind::Link | ProposalKind::Choice | ProposalKind::Value | ProposalKind::File
        )
    }
    let found = found.filter(|it| is_value(it.kind) && !it.insert.contains("$0)"));
    let texts = found.map(|it| {
        field_text(&format!("{before}{}{behind}", it.insert.replace("$0", "")), end, &field.name)
    });
    let mut texts: Vec<_> = texts
        .take(MAX_TRIED)
        .filter(|new| is_right(&format!("{}{new}{}", &text[..open], &text[open..])))
        .take(MAX_OFFERED)
        .collect();
    if texts.is_empty() && !before.is_empty() {
        texts.push(field_text(&format!("{before}{behind}"), end, &field.name));
    }
    (!texts.is_empty()).then_some((Span { start: open, end: open }, texts))
}
