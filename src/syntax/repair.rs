//! A text that is repaired step by step, and the mapping from its positions to the original text.

use crate::error::Span;

/// An edit of a text: the span to be replaced, and the new text.
pub(super) type Edit = (Span, String);

/// A text that is being repaired.
pub(super) struct Repair {
    pub(super) text: String,
    /// For each byte of the repaired text, and for the end of that text, the offset in the original text.
    places: Vec<usize>,
    /// Spans of the original text whose values may not be those that the author meant.
    pub(super) doubtful: Vec<Span>,
}

impl Repair {
    pub(super) fn new(text: &str) -> Self {
        let places = (0..=text.len()).collect();
        Self { text: text.to_owned(), places, doubtful: Vec::new() }
    }

    /// Applies edits, which must be sorted by position. Skips an edit that begins inside of an earlier one.
    pub(super) fn apply(&mut self, edits: &[Edit]) {
        let (mut text, mut places, mut copied) = (String::new(), Vec::new(), 0);
        for (span, new) in edits {
            if span.start < copied {
                continue;
            }
            text.push_str(&self.text[copied..span.start]);
            places.extend(&self.places[copied..span.start]);
            text.push_str(new);
            places.extend(std::iter::repeat_n(self.places[span.start], new.len()));
            copied = span.end;
        }
        text.push_str(&self.text[copied..]);
        places.extend(&self.places[copied..]);
        (self.text, self.places) = (text, places);
    }

    pub(super) fn source_span(&self, span: Span) -> Span {
        let end = self.text.len();
        let [start, end] = [span.start, span.end].map(|at| self.places[at.min(end)]);
        Span { start, end: end.max(start) }
    }

    pub(super) fn mark_doubtful(&mut self, spans: &[Span]) {
        let places: Vec<_> = spans.iter().map(|span| self.source_span(*span)).collect();
        self.doubtful.extend(places);
    }
}
