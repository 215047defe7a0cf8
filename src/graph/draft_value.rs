//! `Draft(final: 4, draft: 1)`: a value for final results, and a cheaper one for drafts.

use maquette_syntax::error::{Span, code};
use maquette_syntax::{Body, Field, Kind, LocalDiagnostic, Name, Tree, nearest_or_all};

/// The names of the fields of a `Draft`: the value for final results, and the value for drafts.
const SIDES: [&str; 2] = ["final", "draft"];

/// Returns true if a value is a `Draft(..)`.
pub fn is_draft(tree: &Tree) -> bool {
    matches!(&tree.kind, Kind::Call { name: Some(name), .. } if name.text == "Draft")
}

/// Creates a `Draft(..)`. `value` returns the value for the field of the given name.
pub(super) fn make_draft(value: impl Fn(&str) -> Tree) -> Tree {
    fn name(text: &str) -> Name {
        Name { text: text.to_owned(), span: Span::default() }
    }
    let fields = SIDES.map(|side| Field { name: name(side), value: value(side) });
    let kind = Kind::Call { name: Some(name("Draft")), body: Body::Fields(fields.to_vec()) };
    Tree::new(Span::default(), kind)
}

/// Returns true if the value is or contains a `Draft(..)`.
pub fn has_draft(tree: &Tree) -> bool {
    is_draft(tree)
        || match &tree.kind {
            Kind::List(items) | Kind::Call { body: Body::Items(items), .. } => {
                items.iter().any(has_draft)
            }
            Kind::Call { body: Body::Fields(fields), .. } => {
                fields.iter().any(|field| has_draft(&field.value))
            }
            Kind::Map(entries) => entries.iter().any(|(_, value)| has_draft(value)),
            _ => false,
        }
}

/// Returns true if a word is a field of a `Draft`.
pub fn is_side(word: &str) -> bool {
    SIDES.contains(&word)
}

/// Returns one side of a `Draft`: the value for drafts if `draft` is true, else the one for final results. `None` if that side is missing.
pub fn side(tree: &Tree, draft: bool) -> Option<&Tree> {
    let wanted = SIDES[usize::from(draft)];
    let found = tree.fields()?.iter().find(|field| field.name.text == wanted);
    found.map(|field| &field.value)
}

/// Applies a function to both values of a `Draft`, the one for final results and the one for drafts.
pub(super) fn map_sides(tree: &Tree, mut replaced: impl FnMut(&Tree) -> Tree) -> Tree {
    let Kind::Call { name, body: Body::Fields(fields) } = &tree.kind else { return tree.clone() };
    let body = Body::Fields(
        fields
            .iter()
            .map(|field| Field { name: field.name.clone(), value: replaced(&field.value) })
            .collect(),
    );
    Tree { kind: Kind::Call { name: name.clone(), body }, ..tree.clone() }
}

/// Returns one side of a `Draft`: the value for drafts if `draft` is true, else the one for final results. Returns any other value as it
/// is. If the `Draft` has errors, adds them to the diagnostics and returns `None`.
pub(super) fn resolve_side<'t>(
    tree: &'t Tree,
    draft: bool,
    diagnostics: &mut Vec<LocalDiagnostic>,
) -> Option<&'t Tree> {
    if !is_draft(tree) {
        return Some(tree);
    }
    let Some(fields) = tree.fields() else {
        let message = "the values of a Draft need names".to_owned();
        diagnostics.push(LocalDiagnostic::new(
            code::WRONG_VALUE,
            tree.span,
            message,
            "write Draft(final: 4, draft: 1)",
        ));
        return None;
    };
    let unknown = fields.iter().filter(|field| !is_side(&field.name.text));
    let mut is_valid = true;
    for field in unknown {
        let word = &field.name.text;
        let help = nearest_or_all(word, "its fields", &SIDES);
        diagnostics.push(LocalDiagnostic::new(
            code::UNKNOWN_FIELD,
            field.name.span,
            format!("Draft has no field `{word}`"),
            help,
        ));
        is_valid = false;
    }
    if let Some(lacking) = SIDES.iter().find(|side| fields.iter().all(|f| f.name.text != **side))
        && is_valid
    {
        let message = format!("Draft needs a field `{lacking}`");
        diagnostics.push(LocalDiagnostic::new(
            code::MISSING_FIELD,
            tree.span,
            message,
            "write Draft(final: 4, draft: 1)",
        ));
        is_valid = false;
    }
    side(tree, draft).filter(|_| is_valid)
}
