//! A text that is checked as one, and the files that its parts stand in.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::schema::Finding;
use super::tree::{Given, Origin, Tree};
use crate::error::{Place, Problem, Source, Span, Use};

/// A text that is checked as one. A patched graph is the graph's text with parts that stand in the patch's file.
#[derive(Debug, PartialEq)]
pub struct Sheet {
    /// The file, and the text that is checked.
    pub source: Arc<Source>,
    /// The folder that paths in the text are relative to.
    pub folder: PathBuf,
    /// The folder of the file that was named, which may be a patch: paths that are set from outside are relative to it.
    pub named_folder: PathBuf,
    /// What the text is made of, in order, if it is not one file's.
    pub parts: Vec<TextPart>,
}

/// A part of a text that stands in some file.
#[derive(Clone, Debug, PartialEq)]
pub struct TextPart {
    /// Where it is in the whole text.
    pub span: Span,
    /// Where it stands.
    pub source: Arc<Source>,
    pub start: usize,
    pub folder: PathBuf,
}

impl Sheet {
    pub fn new(source: Arc<Source>, folder: PathBuf) -> Arc<Self> {
        Arc::new(Self { source, named_folder: folder.clone(), folder, parts: Vec::new() })
    }

    fn part(&self, at: usize) -> Option<&TextPart> {
        let index = self.parts.partition_point(|part| part.span.end <= at);
        self.parts.get(index).or_else(|| self.parts.last())
    }

    /// The file in which a part of the text stands, and where.
    pub fn place(&self, span: Span) -> (Arc<Source>, Span) {
        let Some(part) = self.part(span.start).filter(|_| span != Span::default()) else {
            return (self.source.clone(), span);
        };
        let length = span.end.min(part.span.end).saturating_sub(span.start);
        let start = part.start + (span.start - part.span.start.min(span.start));
        // A span that begins in a part and ends behind another one ends where it does in its own file.
        let end = match self.part(span.end.saturating_sub(1)) {
            Some(last) if Arc::ptr_eq(&last.source, &part.source) && last.start >= part.start => {
                last.start + span.end.saturating_sub(last.span.start)
            }
            _ => start + length,
        };
        (part.source.clone(), Span { start, end })
    }

    /// The same in words: `graphs/face.ron:9:30`.
    pub fn place_in_words(&self, span: Span) -> String {
        let (source, span) = self.place(span);
        let Place { line, column } = Place::of(&source.text, span.start);
        format!("{}:{line}:{column}", source.name.display())
    }

    /// The folder that a path at this place is relative to.
    pub fn folder_of(&self, span: Span) -> &Path {
        self.part(span.start).map_or(&self.folder, |part| &part.folder)
    }

    /// The folder that a path is relative to: that of the file in which it is written, wherever it is used.
    pub(crate) fn folder_for<'a>(&'a self, path: &'a Tree) -> &'a Path {
        match &path.origin {
            Some(Origin::Given(Given { sheet, set: Some(_), .. })) => &sheet.named_folder,
            Some(Origin::Given(Given { sheet, span, set: None })) => sheet.folder_of(*span),
            Some(Origin::Set(_)) => &self.named_folder,
            Some(Origin::Default(span)) => self.folder_of(*span),
            None => self.folder_of(path.span),
        }
    }

    /// A finding as a problem of its file.
    pub fn problem(&self, finding: Finding, uses: &[Use]) -> Problem {
        let (source, span) = self.place(finding.span);
        let here = |span| {
            let (other, place) = self.place(span);
            Arc::ptr_eq(&other, &source).then_some(place)
        };
        let mut help = finding.help.clone().moved(here);
        let note = finding.note.clone().and_then(|(span, words)| {
            if let Some(place) = here(span) {
                return Some((place, words));
            }
            let place = self.place_in_words(span);
            help = std::mem::take(&mut help).in_words(|help| {
                let gap = if help.is_empty() { "" } else { "; " };
                format!("{words}: {place}{gap}{help}")
            });
            None
        });
        Problem { note, uses: uses.to_vec(), ..Finding { span, help, ..finding }.at(&source) }
    }
}
