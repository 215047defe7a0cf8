//! Axes of a sweep: lists of values or files that differ between tasks. Axes are combined pairwise or as a product.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use maquette_syntax::error::{Span, code};
use maquette_syntax::paths::{PathError, may_read};
use maquette_syntax::{Body, Help, Kind, LocalDiagnostic, Tree};
use schemars::JsonSchema;
use serde::Deserialize;

use super::files::FilesAxis;
use super::table::{self};

/// Values or files that differ between tasks.
#[derive(Deserialize, JsonSchema)]
pub(super) enum Axis {
    /// All combinations; the last axis changes fastest. `Product([Values("growth", [5, 12]), Values("levels", [0, 1])])` is four tasks.
    Product(Vec<Self>),
    /// Pairs: the first values together, then the second ones. All axes have the same length. `Zip([Values("growth", [5, 12]),
    /// Values("levels", [0, 1])])` is two tasks.
    Zip(Vec<Self>),
    /// Values of a parameter (`name`) or of a field (`node.field`), as with `--set`: `Values("growth", [5, 12, 20])`.
    Values(
        #[schemars(extend("format" = "target"))] String,
        #[expect(dead_code, reason = "what is set is text, which is taken from the file")]
        #[schemars(with = "Vec<serde_json::Value>")]
        Vec<serde::de::IgnoredAny>,
    ),
    /// Equally spaced values between two values, both included: `Range("growth", 5, 20, 4)` is 5, 10, 15 and 20.
    Range(
        #[schemars(extend("format" = "target"))] String,
        f64,
        f64,
        #[schemars(range(min = 2, max = 1_000_000))] u32,
    ),
    /// Rows of a table, one task per row: `Table("values.csv")`. The names of its columns, as in `Values`, are the first line of a CSV file
    /// or the keys of the objects in a JSON list.
    Table(String),
    /// Files, one task per file: `Files("scans/*/range.pcd", set: "scan.range")`.
    Files {
        /// Pattern of paths, relative to this file: `*` stands for any characters, `?` for one. Folders match, too.
        pattern: String,
        /// Parameter or field that gets the path, as with `--set`. If this and `input` are omitted, each file that the graph reads is
        /// replaced: by the file of the same name in a matching folder, or by a matching file with the same extension.
        #[serde(default)]
        #[schemars(extend("format" = "target"))]
        set: String,
        /// Input of the graph that gets the file, as with `--input`.
        #[serde(default)]
        #[schemars(extend("format" = "input"))]
        input: String,
        /// Files in the same folder, by the parameter or field that gets each: `{"scan.color": "color.png"}`.
        #[serde(default)]
        #[schemars(extend("propertyNames" = { "format": "target" }))]
        beside: BTreeMap<String, String>,
        /// Name of the swept value in `out` and on the contact sheet. The value is the text that matches the `*` of the path. By default
        /// the name is `file`.
        #[serde(default)]
        name: String,
    },
}

/// Values that a task sets in the graph: all of its values, or only those that come from one axis.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Row {
    /// The values as text for display, in the order of the names of the swept values.
    pub values: Vec<String>,
    pub set: Vec<Set>,
    /// The files that are given to the graph's inputs, by the name of the input.
    pub inputs: Vec<(String, PathBuf)>,
}

/// A value that a task sets in the graph, like the option `--set`.
#[derive(Clone, Debug, PartialEq)]
pub struct Set {
    pub target: String,
    pub text: String,
    /// The position of the value in the sweep file.
    pub(crate) span: Span,
    /// The position of the target (the name of the parameter or field) in the sweep file.
    pub(crate) target_span: Span,
}

impl Row {
    /// Returns true if the row sets the parameter or field `target`.
    pub(super) fn sets(&self, target: &str) -> bool {
        self.set.iter().any(|set| set.target == target)
    }

    /// Returns a row that contains the values of both rows.
    fn join(&self, other: &Self) -> Self {
        Self {
            values: [&self.values[..], &other.values].concat(),
            set: [&self.set[..], &other.set].concat(),
            inputs: [&self.inputs[..], &other.inputs].concat(),
        }
    }
}

/// The rows that an axis describes.
#[derive(Default)]
pub(super) struct Rows {
    /// The names of the values in each row, with their positions in the sweep file.
    pub(super) names: Vec<(String, Span)>,
    pub(super) rows: Vec<Row>,
}

/// The maximum number of tasks of a sweep.
const MAX_TASKS: usize = 1_000_000;

/// Reads the axes of a sweep.
pub(super) struct Reader<'a> {
    pub(super) text: &'a str,
    /// The folder of the sweep file.
    pub(super) folder: &'a Path,
    /// The folder of the graph. Paths in values are relative to this folder.
    pub(super) graph_folder: &'a Path,
    /// The folders that must contain the files of the sweep.
    pub(super) roots: &'a [PathBuf],
    /// Returns the files that the graph reads, each with the field that contains its path.
    pub(super) reads: &'a dyn Fn() -> Vec<(String, PathBuf)>,
    pub(super) diagnostics: Vec<LocalDiagnostic>,
    pub(super) warnings: Vec<LocalDiagnostic>,
}

/// Returns a lower bound for the number of tasks that an axis describes, without creating them.
fn count(axis: &Tree) -> usize {
    let name = axis.name().map_or_else(String::new, |name| name.text);
    /// Returns the items of the list that is the argument number `index` of an axis. Returns no items if the argument is not a list.
    fn list(axis: &Tree, index: usize) -> &[Tree] {
        match &axis.kind {
            Kind::Call { body: Body::Items(items), .. } => {
                match items.get(index).map(|it| &it.kind) {
                    Some(Kind::List(items)) => &items[..],
                    _ => &[],
                }
            }
            _ => &[],
        }
    }
    match &name[..] {
        "Product" => list(axis, 0).iter().map(count).fold(1, usize::saturating_mul),
        "Zip" => list(axis, 0).iter().map(count).max().unwrap_or(1),
        "Values" => list(axis, 1).len().max(1),
        "Range" => match &axis.kind {
            Kind::Call { body: Body::Items(items), .. } => {
                match items.get(3).map(|item| &item.kind) {
                    Some(Kind::Number { value, .. }) => *value as usize,
                    _ => 1,
                }
            }
            _ => 1,
        },
        _ => 1,
    }
}

impl Reader<'_> {
    pub(super) fn report(
        &mut self,
        code: &'static str,
        span: Span,
        message: impl Into<String>,
        help: impl Into<Help>,
    ) {
        let (message, help) = (message.into(), help.into());
        self.diagnostics.push(LocalDiagnostic { code, span, message, help, note: None });
    }

    /// Returns the rows of an axis, which must be valid according to its schema.
    pub(super) fn rows(&mut self, axis: &Axis, tree: &Tree) -> Rows {
        let items: &[Tree] = match &tree.kind {
            Kind::Call { body: Body::Items(items), .. } => items,
            _ => &[],
        };
        let inner: &[Tree] = match items.first().map(|list| &list.kind) {
            Some(Kind::List(trees)) => trees,
            _ => &[],
        };
        match axis {
            Axis::Product(axes) => {
                // Check the number of tasks before creating any rows. A pattern of files counts as one task, because the number of files is
                // not known yet.
                if MAX_TASKS < count(tree) {
                    return self.too_many(tree.span);
                }
                let all = self.inner_rows(axes, inner, tree.span);
                let counts = all.iter().map(|rows| rows.rows.len());
                if MAX_TASKS < counts.fold(1, usize::saturating_mul) {
                    return self.too_many(tree.span);
                }
                let mut product = Rows { rows: vec![Row::default()], ..Rows::default() };
                for Rows { names, rows } in all {
                    product.names.extend(names);
                    let each = product.rows.iter().flat_map(|a| rows.iter().map(|b| a.join(b)));
                    product.rows = each.collect();
                }
                product
            }
            Axis::Zip(axes) => {
                let all = self.inner_rows(axes, inner, tree.span);
                let Some(most) = all.iter().map(|rows| rows.rows.len()).max() else {
                    return Rows::default();
                };
                let few =
                    all.iter().position(|rows| rows.rows.len() < most && !rows.rows.is_empty());
                if let Some(few) = few {
                    let longest = all.iter().position(|rows| rows.rows.len() == most).unwrap_or(0);
                    fn name(index: usize, all: &[Rows]) -> String {
                        let names = all[index].names.iter().map(|(name, _)| format!("`{name}`"));
                        Vec::from_iter(names).join(" with ")
                    }
                    let message = format!(
                        "{} has {} values, and {} has {most}",
                        name(few, &all),
                        all[few].rows.len(),
                        name(longest, &all)
                    );
                    let help = "use the same number of values in `Zip`, or use `Product` for all combinations";
                    self.report(code::WRONG_VALUE, inner[few].span, message, help);
                    return Rows::default();
                }
                let mut zipped = Rows { rows: vec![Row::default(); most], ..Rows::default() };
                for Rows { names, rows } in all.into_iter().filter(|rows| !rows.rows.is_empty()) {
                    zipped.names.extend(names);
                    let each = zipped.rows.iter().zip(&rows).map(|(a, b)| a.join(b));
                    zipped.rows = each.collect();
                }
                zipped
            }
            Axis::Values(name, _) => self.values(name, items),
            Axis::Range(name, from, to, count) => self.range(name, (*from, *to, *count), items),
            Axis::Table(path) => self.table(path, tree.span),
            Axis::Files { pattern, set, input, beside, name } => {
                self.files(&FilesAxis { pattern, set, input, files_in_folder: beside, name, tree })
            }
        }
    }

    fn too_many(&mut self, span: Span) -> Rows {
        let help = "use fewer values, or divide the sweep into several";
        self.report(
            code::WRONG_VALUE,
            span,
            format!("expected at most {MAX_TASKS} tasks, found more"),
            help,
        );
        Rows::default()
    }

    fn inner_rows(&mut self, axes: &[Axis], trees: &[Tree], span: Span) -> Vec<Rows> {
        if axes.is_empty() {
            self.report(
                code::WRONG_VALUE,
                span,
                "the list is empty",
                "add Values(..) or Files(..)",
            );
        }
        axes.iter().zip(trees).map(|(axis, tree)| self.rows(axis, tree)).collect()
    }

    fn values(&mut self, name: &str, items: &[Tree]) -> Rows {
        let [target, list] = items else { return Rows::default() };
        let Kind::List(values) = &list.kind else { return Rows::default() };
        if values.is_empty() {
            self.report(
                code::WRONG_VALUE,
                list.span,
                format!("`{name}` has no values"),
                "add some, such as [5, 12, 20]",
            );
        }
        let rows = values
            .iter()
            .map(|value| {
                let text = &self.text[value.span.start..value.span.end];
                let set = Set {
                    target: name.to_owned(),
                    text: text.to_owned(),
                    span: value.span,
                    target_span: target.span,
                };
                let values = vec![value.text().unwrap_or(text).to_owned()];
                Row { values, set: vec![set], inputs: Vec::new() }
            })
            .collect();
        Rows { names: vec![(name.to_owned(), target.span)], rows }
    }

    fn range(&mut self, name: &str, (from, to, count): (f64, f64, u32), items: &[Tree]) -> Rows {
        let [target, first, ..] = items else { return Rows::default() };
        let last = f64::from(count - 1);
        let rows = (0..count).map(|index| {
            // Values are exact at both ends. If both ends are whole numbers, values that are whole numbers are exact, too.
            let step = f64::from(index);
            let value = if index == count - 1 { to } else { from + (to - from) * step / last };
            let text = value.to_string();
            let set = Set {
                target: name.to_owned(),
                text: text.clone(),
                span: first.span,
                target_span: target.span,
            };
            Row { values: vec![text], set: vec![set], inputs: Vec::new() }
        });
        Rows { names: vec![(name.to_owned(), target.span)], rows: rows.collect() }
    }

    fn table(&mut self, path: &str, span: Span) -> Rows {
        let file = self.folder.join(path);
        if let Err(problem) = may_read(path, &file, self.roots) {
            let (code, message, help) = match problem {
                PathError::Outside { message, help } => (code::OUTSIDE, message, help),
                PathError::Missing { message, help } => (code::MISSING_FILE, message, help),
            };
            self.report(code, span, message, help);
            return Rows::default();
        }
        let read = maquette_value::fs::read_text(&file);
        let read = read.map_err(|error| format!("cannot read the table: {error}"));
        let table = match read.and_then(|text| table::read(path, &text)) {
            Ok(table) => table,
            Err(why) => {
                self.report(code::WRONG_VALUE, span, format!("{path}: {why}"), "");
                return Rows::default();
            }
        };
        let rows = table
            .rows
            .iter()
            .map(|cells| {
                let set = table.names.iter().zip(cells).map(|(name, cell)| Set {
                    target: name.clone(),
                    text: cell.text.clone(),
                    span,
                    target_span: span,
                });
                let values = cells.iter().map(|cell| cell.shown.clone()).collect();
                Row { values, set: set.collect(), inputs: Vec::new() }
            })
            .collect();
        Rows { names: table.names.iter().map(|name| (name.clone(), span)).collect(), rows }
    }
}
