//! Renders diagnostics with source lines and annotations.

use annotate_snippets::{AnnotationKind, Group, Level, Origin, Renderer, Snippet};

use crate::error::{Diagnostic, Position, Severity, Span};

mod escape;

use escape::sanitize_same_length;
pub use escape::{escape_json, escape_xml, sanitize, sanitize_line};

impl Diagnostic {
    /// Renders the diagnostic as the command line prints it, with source lines. Uses terminal colors if `color` is set. Visible symbols
    /// replace control characters.
    pub fn to_text(&self, color: bool) -> String {
        render(self, color, None)
    }
}

/// Renders a diagnostic with its source lines. Lines longer than `width` columns are truncated around the span.
pub fn render(diagnostic: &Diagnostic, color: bool, width: Option<usize>) -> String {
    let renderer = if color { Renderer::styled() } else { Renderer::plain() };
    let renderer = width.map_or(renderer.clone(), |width| renderer.term_width(width));
    renderer.render(&[snippet(diagnostic)])
}

/// Builds the snippet of a diagnostic. All texts in it are sanitized, because names and lines may come from untrusted files.
fn snippet(diagnostic: &Diagnostic) -> Group<'_> {
    let level = match diagnostic.severity {
        Severity::Error => Level::ERROR,
        Severity::Warning => Level::WARNING,
    };
    let group = level.primary_title(sanitize_line(&diagnostic.message)).id(diagnostic.code);
    let text = &diagnostic.source.text;
    let path = sanitize_line(&diagnostic.source.name.to_string_lossy()).into_owned();
    let group = if diagnostic.span == Span::default() || text.is_empty() {
        group.element(Origin::path(path))
    } else if let Some(shown) = shown_lines(text, &[diagnostic.span]) {
        let label = diagnostic.note.as_ref();
        let both = label.and_then(|(note, _)| shown_lines(text, &[diagnostic.span, *note]));
        let part = |shown: Span| {
            Snippet::source(sanitize_same_length(&text[shown.start..shown.end]))
                .line_start(Position::from_offset(text, shown.start).line)
                .path(path.clone())
        };
        fn relative_range(span: Span, shown: Span, text: &str) -> std::ops::Range<usize> {
            span.start - shown.start..first_line_end(span, text) - shown.start
        }
        let shown = both.unwrap_or(shown);
        let mut snippet = part(shown).annotation(AnnotationKind::Primary.span(relative_range(
            diagnostic.span,
            shown,
            text,
        )));
        let mut other = None;
        if let Some((span, words)) = label {
            let context = |shown| {
                AnnotationKind::Context
                    .span(relative_range(*span, shown, text))
                    .label(sanitize_line(words))
            };
            match (both, shown_lines(text, &[*span])) {
                (Some(shown), _) => snippet = snippet.annotation(context(shown)),
                // The note is too far from the span for one snippet, so show it in its own snippet.
                (None, Some(shown)) => other = Some(part(shown).annotation(context(shown))),
                (None, None) => {}
            }
        }
        let group = group.element(snippet);
        match other {
            Some(other) => group.element(other),
            None => group,
        }
    } else {
        let Position { line, column } = Position::from_offset(text, diagnostic.span.start);
        group.element(Origin::path(path).line(line).char_column(column))
    };
    let group = match &diagnostic.help[..] {
        "" => group,
        help => group.element(Level::HELP.message(sanitize_line(help))),
    };
    let uses = diagnostic.uses.iter().rev();
    let uses = uses.map(|at| format!("used by `{}` at {}", at.name, at.location()));
    group.elements(uses.map(|text| Level::NOTE.message(sanitize_line(&text).into_owned())))
}

/// Maximum length in bytes of the source lines that are shown with a diagnostic. Annotating longer lines takes too long.
const MAX_EXCERPT: usize = 4096;

/// Returns the span of the whole lines that contain all `spans`. `None` if that span is longer than [`MAX_EXCERPT`].
fn shown_lines(text: &str, spans: &[Span]) -> Option<Span> {
    let start = spans.iter().map(|span| span.start).min()?;
    let end = spans.iter().map(|span| first_line_end(*span, text)).max()?;
    let start = text[..start].rfind('\n').map_or(0, |newline| newline + 1);
    let end = text[end..].find('\n').map_or(text.len(), |newline| end + newline);
    (end - start <= MAX_EXCERPT).then_some(Span { start, end })
}

/// Returns the end of the annotated part of a span: the part on the span's first line.
fn first_line_end(span: Span, text: &str) -> usize {
    let newline = text[span.start..].find('\n');
    newline.map_or(span.end, |newline| span.end.min(span.start + newline))
}
