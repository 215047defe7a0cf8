//! Files that tasks differ by, and what of the graph they take the place of.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use maquette_syntax::error::{Span, code};
use maquette_syntax::paths::{PathProblem, may_read, path_between};
use maquette_syntax::{Finding, Tree, quoted};

use super::axis::{Reader, Row, Rows, Set};
use super::pattern::{Found, matches};

/// `Files(..)` as it is written.
pub(super) struct Meant<'a> {
    pub(super) pattern: &'a str,
    pub(super) set: &'a str,
    pub(super) input: &'a str,
    pub(super) beside: &'a BTreeMap<String, String>,
    pub(super) name: &'a str,
    pub(super) tree: &'a Tree,
}

impl Meant<'_> {
    /// Where a field stands.
    fn place(&self, wanted: &str) -> Span {
        let mut fields = self.tree.fields().unwrap_or_default().iter();
        let field = fields.find(|field| field.name.text == wanted);
        field.map_or(self.tree.span, |field| field.value.span)
    }
}

impl Reader<'_> {
    /// A row for each file.
    pub(super) fn files(&mut self, meant: &Meant<'_>) -> Rows {
        let (pattern, span) = (meant.pattern, meant.place("pattern"));
        let found = matches(self.folder, pattern).unwrap_or_else(|message| {
            self.find(code::WRONG_VALUE, span, message, "");
            Vec::new()
        });
        if found.is_empty() && self.findings.is_empty() {
            let help = "the pattern is relative to the sweep's file; `*` does not stand for `/`";
            self.find(code::MISSING_FILE, span, format!("no file fits `{pattern}`"), help);
        }
        if !meant.set.is_empty() && !meant.input.is_empty() {
            let message = "a file is for a field or for an input";
            self.find(code::WRONG_VALUE, meant.place("input"), message, "leave one of them out");
        }
        // What each takes the place of is the same for all.
        let is_said = !meant.set.is_empty() || !meant.input.is_empty();
        let own = if is_said { Vec::new() } else { (self.reads)() };
        let named = match meant.name {
            "" => ("file".to_owned(), span),
            name => (name.to_owned(), meant.place("name")),
        };
        let (mut fitting, mut rows, mut others) = (Vec::new(), Vec::new(), Vec::new());
        for Found { path, name } in found {
            match self.file(&path, name, meant, &own) {
                Some(row) => {
                    fitting.push(path);
                    rows.push(row);
                }
                None => others.push(path),
            }
        }
        self.unfit(&own, &others, rows.is_empty(), span);
        if self.findings.is_empty() {
            self.mixed(&own, &fitting, &rows, span);
        }
        Rows { names: vec![named], rows }
    }

    /// Tells of files and folders that stand for nothing that the graph reads: they are left out, unless that would leave none.
    fn unfit(&mut self, own: &[(String, PathBuf)], paths: &[PathBuf], is_all: bool, at: Span) {
        for path in paths.iter().take(if is_all { 1 } else { paths.len() }) {
            let shown = path_between(self.folder, path);
            let what = match path.is_dir() && !own.is_empty() {
                true => {
                    let read = own.iter().filter_map(|(_, read)| read.file_name());
                    let read = read.map(|name| format!("`{}`", name.display()));
                    let read = Vec::from_iter(BTreeSet::from_iter(read)).join(", ");
                    format!("`{shown}` has none of the files that the graph reads ({read})")
                }
                false => format!("the graph reads no file that `{shown}` could stand for"),
            };
            let (code, note) = (code::MISSING_FIELD, None);
            let help = "say which: `set: \"node.field\"` or `input: \"name\"`".into();
            match is_all {
                true => self.find(code, at, what, help),
                false => {
                    let message = format!("{what}: it is left out");
                    self.warnings.push(Finding { code, span: at, message, help, note });
                }
            }
        }
    }

    /// Warns of folders without a file that others have: with theirs goes that of the graph, which most likely is of another scan.
    fn mixed(&mut self, own: &[(String, PathBuf)], folders: &[PathBuf], rows: &[Row], at: Span) {
        for (target, read) in own {
            let has = |row: &Row| row.set.iter().any(|set| set.target == *target);
            if !rows.iter().any(has) {
                continue;
            }
            let without = folders.iter().zip(rows).filter(|(_, row)| !has(row));
            for (folder, _) in without.filter(|(folder, _)| folder.is_dir()) {
                let file = read.file_name().unwrap_or_default().display();
                let [folder, read] = [folder, read].map(|path| path_between(self.folder, path));
                let message = format!("`{folder}` has no `{file}`: its task takes `{read}`");
                let help = "put it there, or say which files a task has: `set`, `beside`".into();
                let code = code::MISSING_FILE;
                self.warnings.push(Finding { code, span: at, message, help, note: None });
            }
        }
    }

    /// A file, or a folder of files; `own` are those that the graph reads, by what names them. None if it stands for none of them.
    fn file(
        &mut self,
        path: &Path,
        name: String,
        meant: &Meant<'_>,
        own: &[(String, PathBuf)],
    ) -> Option<Row> {
        let mut row = Row { values: vec![name], ..Row::default() };
        let is_folder = path.is_dir();
        let folder = if is_folder { path.to_owned() } else { path.with_file_name("") };
        let mut files: Vec<(String, PathBuf)> =
            meant.beside.iter().map(|(target, file)| (target.clone(), folder.join(file))).collect();
        if !meant.input.is_empty() {
            row.inputs.push((meant.input.to_owned(), path.to_owned()));
        } else if !meant.set.is_empty() {
            files.push((meant.set.to_owned(), path.to_owned()));
        } else {
            let before = files.len();
            files.extend(own.iter().filter_map(|(target, read)| {
                let file = if is_folder { path.join(read.file_name()?) } else { path.to_owned() };
                let fits = if is_folder { file.is_file() } else { has_ending(&file, read) };
                fits.then(|| (target.clone(), file))
            }));
            if files.len() == before && meant.beside.is_empty() {
                return None;
            }
        }
        let of = if meant.set.is_empty() { meant.tree.span } else { meant.place("set") };
        for (target, file) in files {
            let given = path_between(self.graph_folder, &file);
            if let Err(problem) = may_read(&given, &self.graph_folder.join(&given), self.roots) {
                let (code, message, help) = match problem {
                    PathProblem::Outside { message, help } => (code::OUTSIDE, message, help),
                    PathProblem::Missing { message, help } => (code::MISSING_FILE, message, help),
                };
                self.find(code, meant.place("pattern"), message, help);
            }
            let span = meant.place("pattern");
            row.set.push(Set { target, text: quoted(&given), span, of });
        }
        Some(row)
    }
}

fn has_ending(file: &Path, other: &Path) -> bool {
    file.extension() == other.extension()
}
