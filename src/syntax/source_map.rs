//! Maps positions in a patched text to the files from which the parts of the text come.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::local_diagnostic::LocalDiagnostic;
use super::tree::{ExternalOrigin, Origin, Tree};
use crate::error::{Diagnostic, Position, Source, Span, Use};

/// A text, and the files from which its parts come. The text of a patched graph has parts from the file of the graph and parts from the
/// file of the patch.
#[derive(Debug, PartialEq)]
pub struct SourceMap {
    /// The main file. Its text is the complete text, including parts from other files.
    pub source: Arc<Source>,
    /// The folder to which paths in the text are relative.
    pub folder: PathBuf,
    /// The folder of the file that the user opened, which may be a patch. Paths in `--set` options are relative to this folder.
    pub named_folder: PathBuf,
    /// The parts of the text in order. Empty if the whole text comes from one file.
    pub parts: Vec<TextPart>,
}

/// A part of a text that comes from one file.
#[derive(Clone, Debug, PartialEq)]
pub struct TextPart {
    /// The span of the part in the complete text.
    pub span: Span,
    /// The file from which the part of the text comes.
    pub source: Arc<Source>,
    pub start: usize,
    pub folder: PathBuf,
}

impl SourceMap {
    pub fn new(source: Arc<Source>, folder: PathBuf) -> Arc<Self> {
        Arc::new(Self { source, named_folder: folder.clone(), folder, parts: Vec::new() })
    }

    fn part(&self, at: usize) -> Option<&TextPart> {
        let index = self.parts.partition_point(|part| part.span.end <= at);
        self.parts.get(index).or_else(|| self.parts.last())
    }

    /// Returns the file that contains a span of the text, and the span in that file.
    pub fn locate(&self, span: Span) -> (Arc<Source>, Span) {
        let Some(part) = self.part(span.start).filter(|_| span != Span::default()) else {
            return (self.source.clone(), span);
        };
        let length = span.end.min(part.span.end).saturating_sub(span.start);
        let start = part.start + (span.start - part.span.start.min(span.start));
        // If the last byte of the span is in another part that comes from the same file, the result extends to that byte.
        let end = match self.part(span.end.saturating_sub(1)) {
            Some(last) if Arc::ptr_eq(&last.source, &part.source) && last.start >= part.start => {
                last.start + span.end.saturating_sub(last.span.start)
            }
            _ => start + length,
        };
        (part.source.clone(), Span { start, end })
    }

    /// Formats the location of a span: `graphs/face.ron:9:30`.
    pub fn describe_location(&self, span: Span) -> String {
        let (source, span) = self.locate(span);
        let Position { line, column } = Position::from_offset(&source.text, span.start);
        format!("{}:{line}:{column}", source.name.display())
    }

    /// Returns the folder to which a path at this span is relative.
    pub fn folder_of(&self, span: Span) -> &Path {
        self.part(span.start).map_or(&self.folder, |part| &part.folder)
    }

    /// Returns the folder to which a path is relative. This is the folder of the file that contains the path, even if another file uses it.
    pub(crate) fn folder_for<'a>(&'a self, path: &'a Tree) -> &'a Path {
        match &path.origin {
            Some(Origin::External(ExternalOrigin { source_map, set: Some(_), .. })) => {
                &source_map.named_folder
            }
            Some(Origin::External(ExternalOrigin { source_map, span, set: None })) => {
                source_map.folder_of(*span)
            }
            Some(Origin::Set(_)) => &self.named_folder,
            Some(Origin::Default(span)) => self.folder_of(*span),
            None => self.folder_of(path.span),
        }
    }

    /// Converts a diagnostic with a position in the complete text to a diagnostic of the file that contains the position.
    pub fn diagnostic(&self, diagnostic: LocalDiagnostic, uses: &[Use]) -> Diagnostic {
        let (source, span) = self.locate(diagnostic.span);
        let here = |span| {
            let (other, place) = self.locate(span);
            Arc::ptr_eq(&other, &source).then_some(place)
        };
        let mut help = diagnostic.help.clone().map_spans(here);
        let note = diagnostic.note.clone().and_then(|(span, words)| {
            if let Some(place) = here(span) {
                return Some((place, words));
            }
            let place = self.describe_location(span);
            help = std::mem::take(&mut help).map_text(|help| {
                let gap = if help.is_empty() { "" } else { "; " };
                format!("{words}: {place}{gap}{help}")
            });
            None
        });
        Diagnostic {
            note,
            uses: uses.to_vec(),
            ..LocalDiagnostic { span, help, ..diagnostic }.into_diagnostic(&source)
        }
    }
}
