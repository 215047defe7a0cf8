//! A test without what is wrong in it, so that the rest can be judged as well.

use maquette_syntax::error::Span;
use maquette_syntax::{Body, Finding, Kind, Tree};

/// Takes out the smallest fields and entries in which something was found, or that are broken. Items of lists, such as expectations, go as a
/// whole: without a field they would say something else.
pub(super) fn keep_sound(test: &mut Tree, findings: &[Finding]) {
    mend(test, &findings.iter().map(|finding| finding.span).collect::<Vec<_>>());
}

fn mend(tree: &mut Tree, places: &[Span]) {
    match &mut tree.kind {
        Kind::Call { body: Body::Fields(fields), .. } => {
            fields.iter_mut().for_each(|field| mend(&mut field.value, places));
            fields.retain(|field| is_sound(field.name.span, &field.value, places));
        }
        Kind::Map(entries) => {
            entries.iter_mut().for_each(|(_, value)| mend(value, places));
            entries.retain(|(key, value)| is_sound(key.span, value, places));
        }
        Kind::List(items) => items.retain(|item| item.is_whole() && !has_any(item.span, places)),
        _ => {}
    }
}

/// Whether nothing was found at a name or the whole of its value. What was found inside has been taken out, where it has an inside.
fn is_sound(name: Span, value: &Tree, places: &[Span]) -> bool {
    let has_inside = matches!(
        value.kind,
        Kind::Call { body: Body::Fields(_), .. } | Kind::Map(_) | Kind::List(_)
    );
    value.is_whole()
        && !places.iter().any(|place| [name, value.span].contains(place))
        && (has_inside || !has_any(value.span, places))
}

fn has_any(span: Span, places: &[Span]) -> bool {
    places.iter().any(|place| span.start <= place.start && place.end <= span.end)
}
