//! The axis `Files(..)`: files that differ between tasks, and the files of the graph that they replace.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use maquette_syntax::error::{Span, code};
use maquette_syntax::paths::{PathError, may_read, path_between};
use maquette_syntax::{LocalDiagnostic, Tree, quote};

use super::axis::{Reader, Row, Rows, Set};
use super::pattern::{MatchedPath, matches};

/// The fields of an axis `Files(..)`.
pub(super) struct FilesAxis<'a> {
    pub(super) pattern: &'a str,
    pub(super) set: &'a str,
    pub(super) input: &'a str,
    pub(super) files_in_folder: &'a BTreeMap<String, String>,
    pub(super) name: &'a str,
    pub(super) tree: &'a Tree,
}

impl FilesAxis<'_> {
    /// Returns the position of the field `wanted` in the sweep file.
    fn span_of(&self, wanted: &str) -> Span {
        let mut fields = self.tree.fields().unwrap_or_default().iter();
        let field = fields.find(|field| field.name.text == wanted);
        field.map_or(self.tree.span, |field| field.value.span)
    }
}

impl Reader<'_> {
    /// Returns a row for each file or folder that matches the pattern.
    pub(super) fn files(&mut self, meant: &FilesAxis<'_>) -> Rows {
        let (pattern, span) = (meant.pattern, meant.span_of("pattern"));
        let found = matches(self.folder, pattern).unwrap_or_else(|message| {
            self.report(code::WRONG_VALUE, span, message, "");
            Vec::new()
        });
        if found.is_empty() && self.diagnostics.is_empty() {
            let help = "the pattern is relative to the sweep file; `*` does not match `/`";
            self.report(code::MISSING_FILE, span, format!("no file matches `{pattern}`"), help);
        }
        if !meant.set.is_empty() && !meant.input.is_empty() {
            let message = "expected either `set` or `input`, found both";
            self.report(code::WRONG_VALUE, meant.span_of("input"), message, "remove one of them");
        }
        // Without `set` and `input`, each row replaces files that the graph reads. These do not depend on the row, so determine them only
        // once.
        let is_said = !meant.set.is_empty() || !meant.input.is_empty();
        let own = if is_said { Vec::new() } else { (self.reads)() };
        let named = match meant.name {
            "" => ("file".to_owned(), span),
            name => (name.to_owned(), meant.span_of("name")),
        };
        let (mut fitting, mut rows, mut others) = (Vec::new(), Vec::new(), Vec::new());
        for MatchedPath { path, name } in found {
            match self.file(&path, name, meant, &own) {
                Some(row) => {
                    fitting.push(path);
                    rows.push(row);
                }
                None => others.push(path),
            }
        }
        self.report_unmatched(&own, &others, rows.is_empty(), span);
        if self.diagnostics.is_empty() {
            self.warn_of_missing_files(&own, &fitting, &rows, span);
        }
        Rows { names: vec![named], rows }
    }

    /// Reports matching files and folders that replace no file of the graph, and leaves them out. If no other match remains, that is an
    /// error.
    fn report_unmatched(
        &mut self,
        own: &[(String, PathBuf)],
        paths: &[PathBuf],
        is_all: bool,
        at: Span,
    ) {
        for path in paths.iter().take(if is_all { 1 } else { paths.len() }) {
            let shown = path_between(self.folder, path);
            let what = match path.is_dir() && !own.is_empty() {
                true => {
                    let read = own.iter().filter_map(|(_, read)| read.file_name());
                    let read = read.map(|name| format!("`{}`", name.display()));
                    let read = Vec::from_iter(BTreeSet::from_iter(read)).join(", ");
                    format!("`{shown}` has none of the files that the graph reads ({read})")
                }
                false => format!("the graph reads no file that `{shown}` could replace"),
            };
            let (code, note) = (code::MISSING_FIELD, None);
            let help = "add `set: \"node.field\"` or `input: \"name\"`".into();
            match is_all {
                true => self.report(code, at, what, help),
                false => {
                    let message = format!("{what}; it is ignored");
                    self.warnings.push(LocalDiagnostic { code, span: at, message, help, note });
                }
            }
        }
    }

    /// Warns of folders in which a file is missing that other matching folders contain. The tasks of such folders use the graph's own file,
    /// which probably belongs to another scan.
    fn warn_of_missing_files(
        &mut self,
        own: &[(String, PathBuf)],
        folders: &[PathBuf],
        rows: &[Row],
        at: Span,
    ) {
        for (target, read) in own {
            if !rows.iter().any(|row| row.sets(target)) {
                continue;
            }
            let without = folders.iter().zip(rows).filter(|(_, row)| !row.sets(target));
            for (folder, _) in without.filter(|(folder, _)| folder.is_dir()) {
                let file = read.file_name().unwrap_or_default().display();
                let [folder, read] = [folder, read].map(|path| path_between(self.folder, path));
                let message = format!("`{folder}` has no `{file}`: its task uses `{read}`");
                let help = "add the file, or set the files of a task by `set` and `beside`".into();
                let code = code::MISSING_FILE;
                self.warnings.push(LocalDiagnostic { code, span: at, message, help, note: None });
            }
        }
    }

    /// Returns the row for a matching file or folder. `own` are the files that the graph reads, each with its field. Returns `None` if the
    /// match replaces none of these files.
    fn file(
        &mut self,
        path: &Path,
        name: String,
        meant: &FilesAxis<'_>,
        own: &[(String, PathBuf)],
    ) -> Option<Row> {
        let mut row = Row { values: vec![name], ..Row::default() };
        let is_folder = path.is_dir();
        let folder = if is_folder { path.to_owned() } else { path.with_file_name("") };
        let mut files: Vec<(String, PathBuf)> = meant
            .files_in_folder
            .iter()
            .map(|(target, file)| (target.clone(), folder.join(file)))
            .collect();
        if !meant.input.is_empty() {
            row.inputs.push((meant.input.to_owned(), path.to_owned()));
        } else if !meant.set.is_empty() {
            files.push((meant.set.to_owned(), path.to_owned()));
        } else {
            let before = files.len();
            files.extend(own.iter().filter_map(|(target, read)| {
                let file = if is_folder { path.join(read.file_name()?) } else { path.to_owned() };
                let fits =
                    if is_folder { file.is_file() } else { have_same_extension(&file, read) };
                fits.then(|| (target.clone(), file))
            }));
            if files.len() == before && meant.files_in_folder.is_empty() {
                return None;
            }
        }
        let of = if meant.set.is_empty() { meant.tree.span } else { meant.span_of("set") };
        for (target, file) in files {
            let given = path_between(self.graph_folder, &file);
            if let Err(problem) = may_read(&given, &self.graph_folder.join(&given), self.roots) {
                let (code, message, help) = match problem {
                    PathError::Outside { message, help } => (code::OUTSIDE, message, help),
                    PathError::Missing { message, help } => (code::MISSING_FILE, message, help),
                };
                self.report(code, meant.span_of("pattern"), message, help);
            }
            let span = meant.span_of("pattern");
            row.set.push(Set { target, text: quote(&given), span, target_span: of });
        }
        Some(row)
    }
}

fn have_same_extension(file: &Path, other: &Path) -> bool {
    file.extension() == other.extension()
}
