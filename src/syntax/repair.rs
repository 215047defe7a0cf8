//! A text that is repaired by edits, and where its parts stand in the text as it was.

use crate::error::Span;

/// A text in the place of a part of another one.
pub(super) type Edit = (Span, String);

/// A text that is being repaired.
pub(super) struct Repair {
    pub(super) text: String,
    /// For each byte of it, and its end, the place in the text as it was.
    places: Vec<usize>,
    /// Places in the text as it was.
    pub(super) doubtful: Vec<Span>,
}

impl Repair {
    pub(super) fn of(text: &str) -> Self {
        let places = (0..=text.len()).collect();
        Self { text: text.to_owned(), places, doubtful: Vec::new() }
    }

    /// Makes edits, which are in order.
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

    pub(super) fn place(&self, span: Span) -> Span {
        let end = self.text.len();
        let [start, end] = [span.start, span.end].map(|at| self.places[at.min(end)]);
        Span { start, end: end.max(start) }
    }

    pub(super) fn doubt(&mut self, spans: &[Span]) {
        let places: Vec<_> = spans.iter().map(|span| self.place(*span)).collect();
        self.doubtful.extend(places);
    }
}
