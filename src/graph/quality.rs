//! `Draft(final: 4, draft: 1)`: a value for final results, and one for a first look.

use maquette_syntax::error::{Span, code};
use maquette_syntax::{Body, Field, Finding, Help, Kind, Name, Tree, nearest_or_all};

/// The fields of a `Draft`: of final runs, and of drafts.
const SIDES: [&str; 2] = ["final", "draft"];

/// Whether a value is a `Draft(..)`.
pub fn is_draft(tree: &Tree) -> bool {
    matches!(&tree.kind, Kind::Call { name: Some(name), .. } if name.text == "Draft")
}

/// A `Draft(..)` of what its sides have, by their names.
pub(super) fn draft_of(value: impl Fn(&str) -> Tree) -> Tree {
    fn name(text: &str) -> Name {
        Name { text: text.to_owned(), span: Span::default() }
    }
    let fields = SIDES.map(|side| Field { name: name(side), value: value(side) });
    let kind = Kind::Call { name: Some(name("Draft")), body: Body::Fields(fields.to_vec()) };
    Tree::new(Span::default(), kind)
}

/// Whether a part of the value is a `Draft(..)`.
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

/// Whether a word names a field of a `Draft`.
pub fn is_side(word: &str) -> bool {
    SIDES.contains(&word)
}

/// What a `Draft` has for drafts, or for final results; none if that is not there.
pub fn side(tree: &Tree, draft: bool) -> Option<&Tree> {
    let wanted = SIDES[usize::from(draft)];
    let found = tree.fields()?.iter().find(|field| field.name.text == wanted);
    found.map(|field| &field.value)
}

/// The `Draft` with each of its values replaced.
pub(super) fn each_side(tree: &Tree, mut replaced: impl FnMut(&Tree) -> Tree) -> Tree {
    let Kind::Call { name, body: Body::Fields(fields) } = &tree.kind else { return tree.clone() };
    let body = Body::Fields(
        fields
            .iter()
            .map(|field| Field { name: field.name.clone(), value: replaced(&field.value) })
            .collect(),
    );
    Tree { kind: Kind::Call { name: name.clone(), body }, ..tree.clone() }
}

/// The same of any value, which stands for itself if it is no `Draft`. What is wrong with the `Draft` goes to the findings; then it
/// has no value.
pub(super) fn chosen<'t>(
    tree: &'t Tree,
    draft: bool,
    findings: &mut Vec<Finding>,
) -> Option<&'t Tree> {
    if !is_draft(tree) {
        return Some(tree);
    }
    fn find(
        code: &'static str,
        span: Span,
        message: String,
        help: Help,
        findings: &mut Vec<Finding>,
    ) {
        findings.push(Finding { code, span, message, help, note: None });
    }
    let Some(fields) = tree.fields() else {
        let message = "the values of a Draft have names".to_owned();
        find(
            code::WRONG_VALUE,
            tree.span,
            message,
            "write Draft(final: 4, draft: 1)".into(),
            findings,
        );
        return None;
    };
    let unknown = fields.iter().filter(|field| !is_side(&field.name.text));
    let mut is_sound = true;
    for field in unknown {
        let word = &field.name.text;
        let help = nearest_or_all(word, "its fields", &SIDES);
        find(
            code::UNKNOWN_FIELD,
            field.name.span,
            format!("Draft has no field `{word}`"),
            help,
            findings,
        );
        is_sound = false;
    }
    if let Some(lacking) = SIDES.iter().find(|side| fields.iter().all(|f| f.name.text != **side))
        && is_sound
    {
        let message = format!("Draft needs a field `{lacking}`");
        find(
            code::MISSING_FIELD,
            tree.span,
            message,
            "write Draft(final: 4, draft: 1)".into(),
            findings,
        );
        is_sound = false;
    }
    side(tree, draft).filter(|_| is_sound)
}
