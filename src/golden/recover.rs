//! Removes the faulty parts of a test file, so that the rest can be checked.

use maquette_syntax::error::Span;
use maquette_syntax::{Body, Kind, LocalDiagnostic, Tree};

/// Removes the smallest fields and entries that cannot be parsed or contain an error. An item of a list, such as an expectation, is removed
/// as a whole, because it would have another meaning without one of its fields.
pub(super) fn remove_faulty(test: &mut Tree, diagnostics: &[LocalDiagnostic]) {
    prune(test, &diagnostics.iter().map(|diagnostic| diagnostic.span).collect::<Vec<_>>());
}

fn prune(tree: &mut Tree, places: &[Span]) {
    match &mut tree.kind {
        Kind::Call { body: Body::Fields(fields), .. } => {
            fields.iter_mut().for_each(|field| prune(&mut field.value, places));
            fields.retain(|field| is_sound(field.name.span, &field.value, places));
        }
        Kind::Map(entries) => {
            entries.iter_mut().for_each(|(_, value)| prune(value, places));
            entries.retain(|(key, value)| is_sound(key.span, value, places));
        }
        Kind::List(items) => items.retain(|item| item.is_complete() && !has_any(item.span, places)),
        _ => {}
    }
}

/// Returns true if no error is at the name, or at the value as a whole. Faulty parts inside of the value have already been removed.
fn is_sound(name: Span, value: &Tree, places: &[Span]) -> bool {
    let has_inside = matches!(
        value.kind,
        Kind::Call { body: Body::Fields(_), .. } | Kind::Map(_) | Kind::List(_)
    );
    value.is_complete()
        && !places.iter().any(|place| [name, value.span].contains(place))
        && (has_inside || !has_any(value.span, places))
}

fn has_any(span: Span, places: &[Span]) -> bool {
    places.iter().any(|place| span.start <= place.start && place.end <= span.end)
}
