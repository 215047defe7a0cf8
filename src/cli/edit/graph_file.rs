//! A graph file that a command edits: computes, checks and writes its edits.

use std::ops::Range;
use std::path::{Path, PathBuf};

use maquette_edit::{Edit, EditedText};
use maquette_engine::writing::{FolderLock, replace};
use maquette_graph::catalog::Catalog;
use maquette_graph::{Files, Graph, Options};
use maquette_syntax::error::{Diagnostic, Source};
use maquette_value::fs;

use crate::{DisplayPath, eprint, print, print_document, report};

/// A graph file that a command edits, with the options of the command.
#[derive(Clone, Copy)]
pub(crate) struct GraphFile<'a> {
    pub(crate) graph: &'a Path,
    pub(crate) roots: &'a [PathBuf],
    /// True if `set` changes the draft value in each `Draft(final: .., draft: ..)`, and not the final value.
    pub(crate) draft: bool,
    /// True if the edits are computed and checked but not written.
    pub(crate) dry_run: bool,
}

impl GraphFile<'_> {
    /// Applies edits. If that fails, prints the error and returns `None`.
    pub(crate) fn edit(&self, edits: &[Edit], catalog: &Catalog) -> Option<EditedText> {
        self.apply(edits, catalog).map_err(EditError::print).ok()
    }

    /// Applies edits and writes the file, except in a dry run. The file is locked, so that no edit of another process is overwritten.
    pub(crate) fn apply(&self, edits: &[Edit], catalog: &Catalog) -> Result<EditedText, EditError> {
        if self.dry_run {
            return self.compute(edits, catalog);
        }
        let _turn = self.acquire_lock()?;
        let edited = self.compute(edits, catalog)?;
        self.write(&edited)?;
        Ok(edited)
    }

    /// Locks the file. Other processes of this program cannot edit the file until the returned guard is dropped.
    pub(crate) fn acquire_lock(&self) -> Result<FolderLock, EditError> {
        FolderLock::acquire(self.graph)
            .map_err(|error| EditError::Write(self.graph.to_owned(), error))
    }

    /// Computes the text after some edits without writing it.
    pub(crate) fn compute(
        &self,
        edits: &[Edit],
        catalog: &Catalog,
    ) -> Result<EditedText, EditError> {
        let (text, options) = (self.text()?, self.options());
        maquette_edit::edit(self.graph, &text, edits, catalog, &options).map_err(EditError::Refused)
    }

    pub(crate) fn text(&self) -> Result<String, EditError> {
        fs::read_text(self.graph).map_err(|error| EditError::Read(self.graph.to_owned(), error))
    }

    pub(crate) fn options(&self) -> Options {
        let (roots, draft) = (self.roots.to_vec(), self.draft);
        Options { roots, draft, files: Files::Ignored, ..Options::default() }
    }

    /// Checks that the file still contains the text `before`. Otherwise writing would overwrite the change of another program.
    pub(crate) fn check_same_text(&self, before: &str) -> Result<(), EditError> {
        let is_same = self.text()? == before;
        if is_same { Ok(()) } else { Err(EditError::Changed(self.graph.to_owned())) }
    }

    /// Merges the changes of other programs into `text`. `theirs` contains the text before and after each of their changes.
    pub(crate) fn merge(
        &self,
        text: String,
        theirs: Vec<[String; 2]>,
        catalog: &Catalog,
    ) -> Result<String, EditError> {
        // Join consecutive changes, so that a change and its undo cancel each other.
        let mut changes: Vec<[String; 2]> = Vec::new();
        for [before, after] in theirs {
            match changes.last_mut() {
                Some(last) if last[1] == before => last[1] = after,
                _ => changes.push([before, after]),
            }
        }
        let mut text = text;
        for [before, after] in changes {
            if before == after {
                continue;
            }
            let [base, ours, theirs] =
                [before, text, after].map(|text| Source { name: self.graph.to_owned(), text });
            let merge = maquette_edit::merge(self.graph, [&base, &ours, &theirs], catalog);
            if !merge.conflicts.is_empty() {
                return Err(EditError::Conflict(merge.conflicts));
            }
            if !merge.diagnostics.is_empty() {
                return Err(EditError::Refused(merge.diagnostics));
            }
            text = merge.text;
        }
        Ok(text)
    }

    /// Prints the differences between the graph before and after an edit. In a dry run, prints the changed lines of the file instead.
    pub(crate) fn print_changes(&self, edited: EditedText, catalog: &Catalog) {
        if self.dry_run {
            return print_document(&changed_lines(&edited.before, &edited.text));
        }
        fn source(text: String, graph: &Path) -> Source {
            Source { name: graph.to_owned(), text }
        }
        let found = Graph::differences(
            &source(edited.before, self.graph),
            &source(edited.text, self.graph),
            catalog,
        );
        // An error is impossible, because both texts have already been parsed.
        found.unwrap_or_default().iter().for_each(|found| print(&format!("{found}\n")));
    }

    /// Writes the edited text to the file.
    pub(crate) fn write(&self, edited: &EditedText) -> Result<(), EditError> {
        if edited.text == edited.before {
            return Ok(());
        }
        replace(self.graph, &edited.before, &edited.text)
            .map_err(|error| EditError::Write(self.graph.to_owned(), error))
    }
}

/// The reason why a graph file cannot be edited.
#[derive(Debug, thiserror::Error)]
pub(crate) enum EditError {
    #[error("cannot read {}: {}", .0.for_display(), .1)]
    Read(PathBuf, std::io::Error),
    #[error("cannot write {}: {}", .0.for_display(), .1)]
    Write(PathBuf, std::io::Error),
    #[error("{} has been changed meanwhile; load it again", .0.for_display())]
    Changed(PathBuf),
    /// Another program changed the same items in another way. Contains the names of these items.
    #[error("another change also edited {}; the file was not changed", join_names(.0))]
    Conflict(Vec<String>),
    /// The edits would leave errors in the graph. Contains these errors.
    #[error("{}", join_messages(.0))]
    Refused(Vec<Diagnostic>),
}

impl EditError {
    pub(crate) fn print(self) {
        match self {
            Self::Refused(diagnostics) => report(&diagnostics),
            error => eprint(&format!("error: {error}\n")),
        }
    }
}

/// Formats the names of edited items as a list for a message.
fn join_names(places: &[String]) -> String {
    places
        .iter()
        .map(|place| if place.is_empty() { "the same lines".into() } else { format!("`{place}`") })
        .collect::<Vec<_>>()
        .join(", ")
}

fn join_messages(diagnostics: &[Diagnostic]) -> String {
    diagnostics.iter().map(|diagnostic| &diagnostic.message[..]).collect::<Vec<_>>().join("; ")
}

/// Returns the lines that differ between two texts, as a unified diff without context lines.
pub(crate) fn changed_lines(old: &str, new: &str) -> String {
    let (old, new) = (old.lines().collect::<Vec<_>>(), new.lines().collect::<Vec<_>>());
    let start = old.iter().zip(&new).take_while(|(old, new)| old == new).count();
    let rest = old[start..].iter().rev().zip(new[start..].iter().rev());
    let end = rest.take_while(|(old, new)| old == new).count();
    let (old, new) = (&old[start..old.len() - end], &new[start..new.len() - end]);
    let mut text = String::new();
    for hunk in find_hunks(old, new) {
        /// Formats a range of lines as in the header of a unified diff. `start` is the number of lines before the first line of the text.
        fn range(lines: &Range<usize>, start: usize) -> String {
            match lines.len() {
                0 => format!("{},0", start + lines.start),
                1 => format!("{}", start + lines.start + 1),
                count => format!("{},{count}", start + lines.start + 1),
            }
        }
        text += &format!("@@ -{} +{} @@\n", range(&hunk.old, start), range(&hunk.new, start));
        old[hunk.old].iter().for_each(|line| text += &format!("-{line}\n"));
        new[hunk.new].iter().for_each(|line| text += &format!("+{line}\n"));
    }
    text
}

/// A range of lines that differs between two texts.
struct Hunk {
    old: Range<usize>,
    new: Range<usize>,
}

/// Returns the ranges in which two lists of lines differ.
fn find_hunks(old: &[&str], new: &[&str]) -> Vec<Hunk> {
    let (mut hunks, mut a, mut b) = (Vec::new(), 0, 0);
    while a < old.len() || b < new.len() {
        if old.get(a) == new.get(b) {
            (a, b) = (a + 1, b + 1);
            continue;
        }
        // Find the nearest position at which both lists have an equal line again.
        let ends = (old.len(), new.len());
        let rest = (old.len() - a) + (new.len() - b);
        let (to_a, to_b) = (1..=rest)
            .find_map(|skipped: usize| {
                let mut positions = (0..=skipped).map(|k| (a + k, b + skipped - k));
                positions.find(|&(a, b)| {
                    (a, b) == ends || old.get(a).is_some_and(|line| new.get(b) == Some(line))
                })
            })
            .unwrap_or(ends);
        hunks.push(Hunk { old: a..to_a, new: b..to_b });
        (a, b) = (to_a, to_b);
    }
    hunks
}
