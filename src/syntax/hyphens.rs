//! Reports field names that contain hyphens. The names of inputs and parameters have hyphens, and their fields have underscores instead.
//!
//! In RON, field names cannot contain hyphens. In graphs, names of nodes, inputs and parameters cannot contain underscores. So an
//! underscore in a field name always represents a hyphen.

use ronin_core::SyntaxKind;

use super::help::Help;
use super::parser::{SyntaxError, Token};
use crate::error::Span;

/// Reports fields whose names contain hyphens, such as `eye-step: 3`.
pub(super) fn hyphened_fields(text: &str, tokens: &[(SyntaxKind, Span)]) -> Vec<SyntaxError> {
    let mut last = None;
    let mut errors = Vec::new();
    for &(kind, at) in tokens.iter().filter(|(kind, _)| !kind.is_trivia()) {
        let token = Token::from_kind(kind);
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
        let message = format!("`{name}` is not a field name: a field has `_` instead of hyphens");
        let help = Help::edit(format!("write `{field}`"), span, field);
        errors.push(SyntaxError { span, message, help });
    }
    errors
}
