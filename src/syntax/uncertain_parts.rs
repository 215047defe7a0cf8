//! Filters out diagnostics that may only be consequences of syntax errors.

use std::collections::BTreeSet;
use std::sync::Arc;

use super::parser::{SyntaxError, UNTERMINATED_COMMENT};
use super::recovery::{Recovery, overlaps, recover};
use super::source_map::SourceMap;
use super::tree::Tree;
use crate::error::{Diagnostic, Source, Span, code};

/// Uncertain parts of texts with syntax errors. The values of these parts may not be those that the author meant.
#[derive(Clone, Debug, Default)]
pub struct UncertainParts {
    parts: Vec<(Arc<Source>, Span)>,
    /// The names in the uncertain parts. A diagnostic that one of these names does not exist may be wrong.
    names: BTreeSet<String>,
    /// The names of values whose end is uncertain. A diagnostic that a field of such a value is missing may be wrong.
    cut: BTreeSet<String>,
}

/// The readable parts of a text with syntax errors, and the errors.
pub struct ReadText {
    /// The value. `None` if the errors make it useless.
    pub tree: Option<Tree>,
    /// All syntax errors of the text.
    pub errors: Vec<SyntaxError>,
    /// The uncertain parts. `None` if the text has no syntax errors.
    pub uncertain_parts: Option<UncertainParts>,
}

impl ReadText {
    /// Recovers the value of a parsed text. `wanted` contains the possible names of the outermost call, such as `Graph`.
    pub fn new(
        source_map: &SourceMap,
        (tree, errors): (Tree, Vec<SyntaxError>),
        wanted: &[&str],
    ) -> Self {
        let text = &source_map.source.text;
        if errors.is_empty() {
            return Self { tree: Some(tree), errors, uncertain_parts: None };
        }
        fn name(tree: &Tree) -> Option<String> {
            tree.name().map(|name| name.text.clone())
        }
        fn is_wanted(it: &Recovery, wanted: &[&str]) -> bool {
            name(&it.tree).is_some_and(|it| wanted.contains(&&it[..]))
        }
        let Some(found) = recover(text, &errors) else {
            return Self { tree: None, errors, uncertain_parts: Some(UncertainParts::default()) };
        };
        if !is_wanted(&found, wanted) {
            return Self {
                tree: None,
                errors: found.errors,
                uncertain_parts: Some(UncertainParts::default()),
            };
        }
        let Recovery { tree, errors, doubtful } = found;
        let is_cut = errors
            .iter()
            .any(|error| error.message.contains("close") || error.message == UNTERMINATED_COMMENT);
        let uncertain_parts = UncertainParts {
            names: names_in(text, &doubtful).map(str::to_owned).collect(),
            parts: doubtful.iter().map(|part| source_map.locate(*part)).collect(),
            cut: name(&tree).filter(|_| is_cut).into_iter().collect(),
        };
        Self { tree: Some(tree), errors, uncertain_parts: Some(uncertain_parts) }
    }
}

impl UncertainParts {
    /// Adds the uncertain parts of another text.
    pub fn extend(&mut self, other: Self) {
        self.parts.extend(other.parts);
        self.names.extend(other.names);
        self.cut.extend(other.cut);
    }

    /// Returns true if an error may only be a consequence of a syntax error, and should not be reported.
    pub fn covers(&self, code: &str, (source, span): (&Source, Span), message: &str) -> bool {
        match code {
            code::SYNTAX => false,
            _ if self.parts.iter().any(|(part_source, part)| {
                std::ptr::eq(Arc::as_ptr(part_source), source) && overlaps(*part, span)
            }) =>
            {
                true
            }
            code::MISSING_FIELD
                if self.cut.iter().any(|name| {
                    message.strip_prefix(&name[..]).is_some_and(|rest| rest.starts_with(' '))
                }) =>
            {
                true
            }
            code::UNKNOWN_LINK | code::UNKNOWN_NODE | code::EXPRESSION | code::MISSING_FIELD => {
                let quoted = message.split('`').skip(1).step_by(2);
                quoted.flat_map(|part| part.split(['.', '/'])).any(|it| self.names.contains(it))
            }
            _ => false,
        }
    }

    /// Returns true if a diagnostic may only be a consequence of a syntax error, and should not be reported.
    pub fn covers_diagnostic(&self, diagnostic: &Diagnostic) -> bool {
        self.covers(diagnostic.code, (&diagnostic.source, diagnostic.span), &diagnostic.message)
    }
}

/// Returns the names that occur in the given spans of a text.
fn names_in<'t>(text: &'t str, parts: &'t [Span]) -> impl Iterator<Item = &'t str> {
    let parts = parts.iter().filter_map(|span| text.get(span.start..span.end));
    parts
        .flat_map(move |part| {
            part.split(|c: char| !(c.is_alphanumeric() || matches!(c, '_' | '-')))
        })
        .filter(|name| !name.is_empty())
}
