//! Problems as people read them: with the lines of the graph, and marks under what is wrong.

use annotate_snippets::{AnnotationKind, Group, Level, Origin, Renderer, Snippet};

use crate::error::{Place, Problem, Severity, Span};

mod words;

use words::harmless_in_place;
pub use words::{escaped, harmless, on_one_line};

impl Problem {
    /// The problem as the command line prints it: over several lines, with the place in the graph's text, and with colors of a terminal if
    /// they are wanted. Whatever a terminal would act on is shown instead.
    pub fn to_text(&self, color: bool) -> String {
        in_full(self, color, None)
    }
}

/// A problem with its lines of the graph, over several lines; long lines are cut around the place if there is a width.
pub fn in_full(problem: &Problem, color: bool, width: Option<usize>) -> String {
    let renderer = if color { Renderer::styled() } else { Renderer::plain() };
    let renderer = width.map_or(renderer.clone(), |width| renderer.term_width(width));
    renderer.render(&[snippet(problem)])
}

/// All words in it are made harmless: names and lines of others stand in a problem.
fn snippet(problem: &Problem) -> Group<'_> {
    let level = match problem.severity {
        Severity::Error => Level::ERROR,
        Severity::Warning => Level::WARNING,
    };
    let group = level.primary_title(on_one_line(&problem.message)).id(problem.code);
    let text = &problem.source.text;
    let path = on_one_line(&problem.source.name.to_string_lossy()).into_owned();
    let group = if problem.span == Span::default() || text.is_empty() {
        group.element(Origin::path(path))
    } else if let Some(shown) = shown_lines(text, &[problem.span]) {
        let label = problem.note.as_ref();
        let both = label.and_then(|(note, _)| shown_lines(text, &[problem.span, *note]));
        let part = |shown: Span| {
            Snippet::source(harmless_in_place(&text[shown.start..shown.end]))
                .line_start(Place::of(text, shown.start).line)
                .path(path.clone())
        };
        fn inside(span: Span, shown: Span, text: &str) -> std::ops::Range<usize> {
            span.start - shown.start..first_line_end(span, text) - shown.start
        }
        let shown = both.unwrap_or(shown);
        let mut snippet =
            part(shown).annotation(AnnotationKind::Primary.span(inside(problem.span, shown, text)));
        let mut other = None;
        if let Some((span, words)) = label {
            let context = |shown| {
                AnnotationKind::Context.span(inside(*span, shown, text)).label(on_one_line(words))
            };
            match (both, shown_lines(text, &[*span])) {
                (Some(shown), _) => snippet = snippet.annotation(context(shown)),
                // Too far away for one picture.
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
        let Place { line, column } = Place::of(text, problem.span.start);
        group.element(Origin::path(path).line(line).char_column(column))
    };
    let group = match &problem.help[..] {
        "" => group,
        help => group.element(Level::HELP.message(on_one_line(help))),
    };
    let uses = problem.uses.iter().rev();
    let uses = uses.map(|at| format!("used by `{}` at {}", at.name, at.place()));
    group.elements(uses.map(|text| Level::NOTE.message(on_one_line(&text).into_owned())))
}

/// A text longer than this is not shown around a problem: nobody would read it, and drawing marks under it takes long.
const MOST_SHOWN: usize = 4096;

/// The lines that hold some places; none if they are too long to show.
fn shown_lines(text: &str, spans: &[Span]) -> Option<Span> {
    let start = spans.iter().map(|span| span.start).min()?;
    let end = spans.iter().map(|span| first_line_end(*span, text)).max()?;
    let start = text[..start].rfind('\n').map_or(0, |newline| newline + 1);
    let end = text[end..].find('\n').map_or(text.len(), |newline| end + newline);
    (end - start <= MOST_SHOWN).then_some(Span { start, end })
}

/// Where the part of a span that lies in its first line ends: a long call is shown by its first line.
fn first_line_end(span: Span, text: &str) -> usize {
    let newline = text[span.start..].find('\n');
    newline.map_or(span.end, |newline| span.end.min(span.start + newline))
}
