//! Fields that are written with hyphens, as the names are that they stand for.
//!
//! RON has no hyphens in names of fields, and names of nodes, inputs and parameters have no underscores. So an underscore in a field
//! represents a hyphen, and each spelling has one meaning.

use ronin_core::SyntaxKind;

use super::file::{Mistake, Token};
use super::help::Help;
use crate::error::Span;

/// Names with hyphens in the place of fields: `eye-step: 3`.
pub(super) fn hyphened_fields(text: &str, tokens: &[(SyntaxKind, Span)]) -> Vec<Mistake> {
    let mut last = None;
    let mut mistakes = Vec::new();
    for &(kind, at) in tokens.iter().filter(|(kind, _)| !kind.is_trivia()) {
        let token = Token::of(kind);
        let before = last.replace((token, at));
        let (Token::Colon, Some((Token::Word, word))) = (token, before) else { continue };
        let name = &text[..word.end];
        let name = &name[name
            .trim_end_matches(|c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '-'))
            .len()..];
        if name.len() <= word.end - word.start
            || !name.starts_with(|c: char| c.is_ascii_lowercase())
        {
            continue;
        }
        let span = Span { start: word.end - name.len(), end: word.end };
        let field = name.replace('-', "_");
        let message = format!("`{name}` is no field: in a field `_` stands for a hyphen");
        let help = Help::edit(format!("write `{field}`"), span, field);
        mistakes.push(Mistake { span, message, help });
    }
    mistakes
}
