//! What to do about a problem: in words, and as an edit of the text where there is one answer.
//!
//! The edit is determined where the problem is found, never from its words. `check --fix`, editors and the live page apply the edit as it
//! is. An edit may show what the mistake has hidden, such as the fields of a node whose type was not known.

use std::fmt;

use crate::error::Span;

/// What to do about a problem. The words may be empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Help {
    words: String,
    /// None if only people can decide.
    fix: Option<Box<Fix>>,
}

/// What makes a problem go away.
#[derive(Clone, Debug, PartialEq)]
enum Fix {
    /// Another name in the place of the one that stands at the problem's place.
    Rename { from: String, to: String },
    /// Texts in the place of what stands at some spans.
    Edits(Vec<(Span, String)>),
    /// A link at a port, as soon as it is known what there is to link.
    Link { port: String, wants: Vec<String> },
}

impl Help {
    fn new(words: String, fix: Fix) -> Self {
        Self { words, fix: Some(Box::new(fix)) }
    }

    /// Help that is one edit of the text.
    pub fn edit(words: impl Into<String>, span: Span, text: impl Into<String>) -> Self {
        Self::new(words.into(), Fix::Edits(vec![(span, text.into())]))
    }

    /// Help that is another name.
    pub fn rename(words: String, from: &str, to: &str) -> Self {
        Self::new(words, Fix::Rename { from: from.to_owned(), to: to.to_owned() })
    }

    /// Help that is a link at a port, which wants values of some types.
    pub(crate) fn link(words: String, port: &str, wants: Vec<String>) -> Self {
        Self::new(words, Fix::Link { port: port.to_owned(), wants })
    }

    /// The port that lacks a link, and the types of values that it takes.
    pub fn lacking(&self) -> Option<(&str, &[String])> {
        match self.fix.as_deref()? {
            Fix::Link { port, wants } => Some((port, wants)),
            _ => None,
        }
    }

    /// The name that was meant.
    pub fn meant(&self) -> Option<&str> {
        match self.fix.as_deref()? {
            Fix::Rename { to, .. } => Some(to),
            _ => None,
        }
    }

    /// The same words with this edit.
    pub fn with_edits(&mut self, edits: Vec<(Span, String)>) {
        self.fix = Some(Box::new(Fix::Edits(edits)));
    }

    /// The same edit, in other words.
    pub(crate) fn in_words(self, words: impl FnOnce(&str) -> String) -> Self {
        Self { words: words(&self.words), ..self }
    }

    pub fn is_empty(&self) -> bool {
        self.words.is_empty()
    }

    /// The edits of a text that make the problem at `span` go away; none if people have to decide.
    pub(crate) fn edits(&self, text: &str, span: Span) -> Vec<(Span, String)> {
        match self.fix.as_deref() {
            None | Some(Fix::Link { .. }) => Vec::new(),
            Some(Fix::Edits(edits)) => edits.clone(),
            Some(Fix::Rename { from, to }) => {
                let found = only(text.get(span.start..span.end).unwrap_or_default(), from);
                found
                    .map(|at: usize| {
                        let start = span.start + at;
                        (Span { start, end: start + from.len() }, to.clone())
                    })
                    .into_iter()
                    .collect()
            }
        }
    }

    /// The same with its spans elsewhere; without an edit if one of them is nowhere.
    pub(crate) fn moved(self, place: impl Fn(Span) -> Option<Span>) -> Self {
        let Some(Fix::Edits(edits)) = self.fix.as_deref() else { return self };
        let moved = edits.iter().map(|(span, text)| Some((place(*span)?, text.clone())));
        let fix = moved.collect::<Option<_>>().map(|edits| Box::new(Fix::Edits(edits)));
        Self { fix, ..self }
    }
}

/// Where a name stands in a text, if it does so once.
fn only(text: &str, name: &str) -> Option<usize> {
    fn is_part(c: char) -> bool {
        c.is_alphanumeric() || c == '_'
    }
    let mut found = text.match_indices(name).map(|(at, _)| at).filter(|at| {
        let (before, behind) = (&text[..*at], &text[at + name.len()..]);
        !before.ends_with(is_part) && !behind.starts_with(is_part)
    });
    found.next().filter(|_| !name.is_empty() && found.next().is_none())
}

impl fmt::Display for Help {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.words)
    }
}

impl From<&str> for Help {
    fn from(words: &str) -> Self {
        words.to_owned().into()
    }
}

impl From<String> for Help {
    fn from(words: String) -> Self {
        Self { words, fix: None }
    }
}

impl From<Help> for String {
    fn from(help: Help) -> Self {
        help.words
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_replaced_where_it_stands_once() {
        fn edits(text: &str, from: &str) -> Vec<(Span, String)> {
            let span = Span { start: 1, end: text.len() };
            Help::rename(String::new(), from, "doll").edits(text, span)
        }
        fn edit(start: usize, end: usize) -> Vec<(Span, String)> {
            vec![(Span { start, end }, "doll".to_owned())]
        }
        assert_eq!(edits("(\"dol\")", "dol"), edit(2, 5));
        assert_eq!(edits("(\"dol.dolly\")", "dol"), edit(2, 5));
        assert_eq!(edits("(\"dol.dol\")", "dol"), [], "nobody knows which");
        assert_eq!(edits("(\"dolly\")", "dol"), []);
        assert_eq!(edits("(\"\")", ""), []);
        let far = Help::rename(String::new(), "a", "b");
        assert_eq!(far.edits("a", Span { start: 5, end: 9 }), []);
    }
}
