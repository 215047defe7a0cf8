//! What is reported of a text with syntax errors only because a part of it cannot be read.

use std::collections::BTreeSet;
use std::sync::Arc;

use super::file::Mistake;
use super::recovery::{Recovered, overlaps, recovered};
use super::sheet::Sheet;
use super::tree::Tree;
use crate::error::{Problem, Source, Span, code};

/// The parts of texts with syntax errors that may say something else than was meant.
#[derive(Clone, Debug, Default)]
pub struct Doubts {
    parts: Vec<(Arc<Source>, Span)>,
    /// The names in these parts: what seems to lack them may not.
    names: BTreeSet<String>,
    /// The names of values whose end is not certain: what they seem to lack may have been cut off.
    cut: BTreeSet<String>,
}

/// A text, read as far as it can be.
pub struct ReadText {
    /// The value; none if nothing more can be said of it than the mistakes.
    pub tree: Option<Tree>,
    /// All syntax errors.
    pub mistakes: Vec<Mistake>,
    /// None if there are no syntax errors.
    pub doubts: Option<Doubts>,
}

impl ReadText {
    /// Reads a parsed text that should hold one of these values, such as `Graph`, even if there are syntax errors in it.
    pub fn new(sheet: &Sheet, (tree, mistakes): (Tree, Vec<Mistake>), wanted: &[&str]) -> Self {
        let text = &sheet.source.text;
        if mistakes.is_empty() {
            return Self { tree: Some(tree), mistakes, doubts: None };
        }
        fn name(tree: &Tree) -> Option<String> {
            tree.name().map(|name| name.text.clone())
        }
        fn is_wanted(it: &Recovered, wanted: &[&str]) -> bool {
            name(&it.tree).is_some_and(|it| wanted.contains(&&it[..]))
        }
        let Some(found) = recovered(text, &mistakes) else {
            return Self { tree: None, mistakes, doubts: Some(Doubts::default()) };
        };
        if !is_wanted(&found, wanted) {
            return Self { tree: None, mistakes: found.mistakes, doubts: Some(Doubts::default()) };
        }
        let Recovered { tree, mistakes, doubtful } = found;
        let is_cut = mistakes.iter().any(|mistake| mistake.message.contains("close"));
        let doubts = Doubts {
            names: names_in(text, &doubtful).map(str::to_owned).collect(),
            parts: doubtful.iter().map(|part| sheet.place(*part)).collect(),
            cut: name(&tree).filter(|_| is_cut).into_iter().collect(),
        };
        Self { tree: Some(tree), mistakes, doubts: Some(doubts) }
    }
}

impl Doubts {
    /// Adds those about another text.
    pub fn extend(&mut self, other: Self) {
        self.parts.extend(other.parts);
        self.names.extend(other.names);
        self.cut.extend(other.cut);
    }

    /// Returns true if an error may be there only because a part of its text cannot be read.
    pub fn cover(&self, code: &str, (source, span): (&Source, Span), message: &str) -> bool {
        match code {
            code::SYNTAX => false,
            _ if self.parts.iter().any(|(of, part)| {
                std::ptr::eq(Arc::as_ptr(of), source) && overlaps(*part, span)
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
                let is_known =
                    |part: &str| part.split(['.', '/']).any(|it| self.names.contains(it));
                quoted.into_iter().any(is_known)
            }
            _ => false,
        }
    }

    /// Returns true if a problem may be there only because a part of its text cannot be read.
    pub fn cover_problem(&self, problem: &Problem) -> bool {
        self.cover(problem.code, (&problem.source, problem.span), &problem.message)
    }
}

/// The names in some parts of a text.
fn names_in<'t>(text: &'t str, parts: &'t [Span]) -> impl Iterator<Item = &'t str> {
    let parts = parts.iter().filter_map(|span| text.get(span.start..span.end));
    parts
        .flat_map(move |part| {
            part.split(|c: char| !(c.is_alphanumeric() || matches!(c, '_' | '-')))
        })
        .filter(|name| !name.is_empty())
}
