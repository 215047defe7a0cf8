//! The help of a diagnostic: a text, and an edit that fixes the error if exactly one edit does.
//!
//! The edit comes from the code that finds the error, and is not derived from the message. `check --fix`, editors and the live page apply
//! it unchanged. A fix may reveal further errors, such as those in the fields of a node whose type was unknown.

use std::fmt;

use crate::error::Span;

/// The help of a diagnostic. The text may be empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Help {
    text: String,
    /// The edit that fixes the error. `None` if no edit, or more than one, would fix it.
    fix: Option<Box<Fix>>,
}

/// An edit that fixes an error.
#[derive(Clone, Debug, PartialEq)]
enum Fix {
    /// Replaces the name `from` by `to`. The name is within the span of the diagnostic.
    Rename { from: String, to: String },
    /// Replaces each span by the text paired with it.
    Edits(Vec<(Span, String)>),
    /// Adds a link to the port `port`, which takes values of the types `wants`. The source of the link is chosen later among the graph's
    /// nodes.
    Link { port: String, wants: Vec<String> },
}

impl Help {
    fn new(words: String, fix: Fix) -> Self {
        Self { text: words, fix: Some(Box::new(fix)) }
    }

    /// Creates a help whose fix replaces a span by a text.
    pub fn edit(words: impl Into<String>, span: Span, text: impl Into<String>) -> Self {
        Self::new(words.into(), Fix::Edits(vec![(span, text.into())]))
    }

    /// Creates a help whose fix replaces a name.
    pub fn rename(words: String, from: &str, to: &str) -> Self {
        Self::new(words, Fix::Rename { from: from.to_owned(), to: to.to_owned() })
    }

    /// Creates a help whose fix adds a link to a port, which takes values of the types `wants`.
    pub(crate) fn link(words: String, port: &str, wants: Vec<String>) -> Self {
        Self::new(words, Fix::Link { port: port.to_owned(), wants })
    }

    /// If the fix adds a link: returns the port, and the types of values that it takes. Otherwise `None`.
    pub fn missing_link(&self) -> Option<(&str, &[String])> {
        match self.fix.as_deref()? {
            Fix::Link { port, wants } => Some((port, wants)),
            _ => None,
        }
    }

    /// Returns the new name if the fix replaces a name. Otherwise `None`.
    pub fn suggested_name(&self) -> Option<&str> {
        match self.fix.as_deref()? {
            Fix::Rename { to, .. } => Some(to),
            _ => None,
        }
    }

    /// Replaces the fix of the help by `edits`.
    pub fn set_edits(&mut self, edits: Vec<(Span, String)>) {
        self.fix = Some(Box::new(Fix::Edits(edits)));
    }

    /// Replaces the text of the help and keeps the fix.
    pub(crate) fn map_text(self, words: impl FnOnce(&str) -> String) -> Self {
        Self { text: words(&self.text), ..self }
    }

    pub fn is_empty(&self) -> bool {
        self.text.is_empty()
    }

    /// Returns the edits that fix the diagnostic at `span`. Empty if there is no fix, or if the name to be replaced does not occur exactly
    /// once at `span`.
    pub(crate) fn edits(&self, text: &str, span: Span) -> Vec<(Span, String)> {
        match self.fix.as_deref() {
            None | Some(Fix::Link { .. }) => Vec::new(),
            Some(Fix::Edits(edits)) => edits.clone(),
            Some(Fix::Rename { from, to }) => {
                let found = find_single(text.get(span.start..span.end).unwrap_or_default(), from);
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

    /// Maps the spans of the edits by the function `place`. If it returns `None` for a span, the fix is removed.
    pub(crate) fn map_spans(self, place: impl Fn(Span) -> Option<Span>) -> Self {
        let Some(Fix::Edits(edits)) = self.fix.as_deref() else { return self };
        let moved = edits.iter().map(|(span, text)| Some((place(*span)?, text.clone())));
        let fix = moved.collect::<Option<_>>().map(|edits| Box::new(Fix::Edits(edits)));
        Self { fix, ..self }
    }
}

/// Returns the byte offset of a name that occurs exactly once in a text. Otherwise `None`.
fn find_single(text: &str, name: &str) -> Option<usize> {
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
        f.write_str(&self.text)
    }
}

impl From<&str> for Help {
    fn from(words: &str) -> Self {
        words.to_owned().into()
    }
}

impl From<String> for Help {
    fn from(words: String) -> Self {
        Self { text: words, fix: None }
    }
}

impl From<Help> for String {
    fn from(help: Help) -> Self {
        help.text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_replaced_if_it_occurs_once() {
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
