//! What differs from task to task: values and files, one with the other or each with each.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use maquette_syntax::error::{Span, code};
use maquette_syntax::paths::{PathProblem, may_read};
use maquette_syntax::{Body, Finding, Help, Kind, Tree};
use schemars::JsonSchema;
use serde::Deserialize;

use super::files::Meant;
use super::table::{self};

/// What differs from task to task.
#[derive(Deserialize, JsonSchema)]
pub(super) enum Axis {
    /// Each with each: the last one changes fastest. `Product([Values("growth", [5, 12]), Values("levels", [0, 1])])` is four tasks.
    Product(Vec<Self>),
    /// The first with the first, the second with the second: all have equally many. `Zip([Values("growth", [5, 12]), Values("levels", [0, 1])])`
    /// is two tasks.
    Zip(Vec<Self>),
    /// Values of a parameter (`name`) or of a field (`node.field`), as with `--set`: `Values("growth", [5, 12, 20])`.
    Values(
        #[schemars(extend("format" = "target"))] String,
        #[expect(dead_code, reason = "what is set is text, which is taken from the file")]
        #[schemars(with = "Vec<serde_json::Value>")]
        Vec<serde::de::IgnoredAny>,
    ),
    /// Equally spaced values from one to another, both included: `Range("growth", 5, 20, 4)` is 5, 10, 15 and 20.
    Range(
        #[schemars(extend("format" = "target"))] String,
        f64,
        f64,
        #[schemars(range(min = 2, max = 1_000_000))] u32,
    ),
    /// The rows of a table, a task each: `Table("values.csv")`. Its columns are named as in `Values`, in the first line of a CSV file, or as the
    /// keys of the objects in a list of JSON.
    Table(String),
    /// Files, a task each: `Files("scans/*/range.pcd", set: "scan.range")`.
    Files {
        /// Which files, relative to this one: `*` stands for any letters, `?` for one. Folders may be meant, too.
        pattern: String,
        /// The parameter or field that names the file, as with `--set`. If it is left out, and so is `input`, each file that the graph
        /// reads is replaced: by one of the same name in the folder, or by the file itself if it has the same ending.
        #[serde(default)]
        #[schemars(extend("format" = "target"))]
        set: String,
        /// The input of the graph that the file is for, as with `--input`.
        #[serde(default)]
        #[schemars(extend("format" = "input"))]
        input: String,
        /// Files beside it, by what names them: `{"scan.color": "color.png"}`.
        #[serde(default)]
        #[schemars(extend("propertyNames" = { "format": "target" }))]
        beside: BTreeMap<String, String>,
        /// What it is called in `out` and on the contact sheet: what stands for the `*`. `file` if it is left out.
        #[serde(default)]
        name: String,
    },
}

/// The values of a task, or of one axis.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Row {
    /// As they are shown, one for each name.
    pub values: Vec<String>,
    pub set: Vec<Set>,
    /// The files at inputs, as with `--input`.
    pub inputs: Vec<(String, PathBuf)>,
}

/// A value that a task sets, as with `--set`.
#[derive(Clone, Debug, PartialEq)]
pub struct Set {
    pub target: String,
    pub text: String,
    /// Where it stands in the sweep.
    pub(crate) span: Span,
    /// Where it is said what is set.
    pub(crate) of: Span,
}

impl Row {
    fn and(&self, other: &Self) -> Self {
        Self {
            values: [&self.values[..], &other.values].concat(),
            set: [&self.set[..], &other.set].concat(),
            inputs: [&self.inputs[..], &other.inputs].concat(),
        }
    }
}

/// The rows of an axis.
#[derive(Default)]
pub(super) struct Rows {
    /// What the values are called, and where that stands.
    pub(super) names: Vec<(String, Span)>,
    pub(super) rows: Vec<Row>,
}

/// More tasks than anybody means.
const MOST: usize = 1_000_000;

/// Reads axes.
pub(super) struct Reader<'a> {
    pub(super) text: &'a str,
    /// The folder of the sweep.
    pub(super) folder: &'a Path,
    /// The folder of the graph, that paths which are set are relative to.
    pub(super) graph_folder: &'a Path,
    /// The folders that files may lie in.
    pub(super) roots: &'a [PathBuf],
    /// What names the files of the graph, by their names and endings.
    pub(super) reads: &'a dyn Fn() -> Vec<(String, PathBuf)>,
    pub(super) findings: Vec<Finding>,
    pub(super) warnings: Vec<Finding>,
}

/// How many tasks an axis makes at least, by its values.
fn count(axis: &Tree) -> usize {
    let name = axis.name().map_or_else(String::new, |name| name.text);
    fn list(place: usize, axis_kind: &Kind) -> &[Tree] {
        match axis_kind {
            Kind::Call { body: Body::Items(items), .. } => {
                match items.get(place).map(|it| &it.kind) {
                    Some(Kind::List(items)) => &items[..],
                    _ => &[],
                }
            }
            _ => &[],
        }
    }
    match &name[..] {
        "Product" => list(0, &axis.kind).iter().map(count).fold(1, usize::saturating_mul),
        "Zip" => list(0, &axis.kind).iter().map(count).max().unwrap_or(1),
        "Values" => list(1, &axis.kind).len().max(1),
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
    pub(super) fn find(
        &mut self,
        code: &'static str,
        span: Span,
        message: impl Into<String>,
        help: impl Into<Help>,
    ) {
        let (message, help) = (message.into(), help.into());
        self.findings.push(Finding { code, span, message, help, note: None });
    }

    /// The rows of an axis that fits its schema.
    pub(super) fn rows(&mut self, axis: &Axis, tree: &Tree) -> Rows {
        let items: &[Tree] = match &tree.kind {
            Kind::Call { body: Body::Items(items), .. } => items,
            _ => &[],
        };
        let inner = |items: &'_ [Tree]| match items.first().map(|list| &list.kind) {
            Some(Kind::List(trees)) => trees.clone(),
            _ => Vec::new(),
        };
        match axis {
            Axis::Product(axes) => {
                // Before any of them is made: files count as one.
                if MOST < count(tree) {
                    return self.too_many(tree.span);
                }
                let all = self.all(axes, &inner(items), tree.span);
                let counts = all.iter().map(|rows| rows.rows.len());
                if MOST < counts.fold(1, usize::saturating_mul) {
                    return self.too_many(tree.span);
                }
                let mut product = Rows { rows: vec![Row::default()], ..Rows::default() };
                for Rows { names, rows } in all {
                    product.names.extend(names);
                    let each = product.rows.iter().flat_map(|a| rows.iter().map(|b| a.and(b)));
                    product.rows = each.collect();
                }
                product
            }
            Axis::Zip(axes) => {
                let trees = inner(items);
                let all = self.all(axes, &trees, tree.span);
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
                    let help = "what is zipped has equally many; `Product` takes each with each";
                    self.find(code::WRONG_VALUE, trees[few].span, message, help);
                    return Rows::default();
                }
                let mut zipped = Rows { rows: vec![Row::default(); most], ..Rows::default() };
                for Rows { names, rows } in all.into_iter().filter(|rows| !rows.rows.is_empty()) {
                    zipped.names.extend(names);
                    let each = zipped.rows.iter().zip(&rows).map(|(a, b)| a.and(b));
                    zipped.rows = each.collect();
                }
                zipped
            }
            Axis::Values(name, _) => self.values(name, items),
            Axis::Range(name, from, to, count) => self.range(name, (*from, *to, *count), items),
            Axis::Table(path) => self.table(path, tree.span),
            Axis::Files { pattern, set, input, beside, name } => {
                self.files(&Meant { pattern, set, input, beside, name, tree })
            }
        }
    }

    fn too_many(&mut self, span: Span) -> Rows {
        let help = "sweep over less, or divide the sweep into several";
        self.find(code::WRONG_VALUE, span, format!("this is more than {MOST} tasks"), help);
        Rows::default()
    }

    fn all(&mut self, axes: &[Axis], trees: &[Tree], span: Span) -> Vec<Rows> {
        if axes.is_empty() {
            self.find(
                code::WRONG_VALUE,
                span,
                "there is nothing in the list",
                "write Values(..) or Files(..) into it",
            );
        }
        axes.iter().zip(trees).map(|(axis, tree)| self.rows(axis, tree)).collect()
    }

    fn values(&mut self, name: &str, items: &[Tree]) -> Rows {
        let [target, list] = items else { return Rows::default() };
        let Kind::List(values) = &list.kind else { return Rows::default() };
        if values.is_empty() {
            self.find(
                code::WRONG_VALUE,
                list.span,
                format!("`{name}` has no values"),
                "write some: [5, 12, 20]",
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
                    of: target.span,
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
        let row = |index: u32| {
            // The ends are exact, and so are the values between whole numbers that are whole.
            let step = f64::from(index);
            let value = if index == count - 1 { to } else { from + (to - from) * step / last };
            let text = value.to_string();
            let set = Set {
                target: name.to_owned(),
                text: text.clone(),
                span: first.span,
                of: target.span,
            };
            Row { values: vec![text], set: vec![set], inputs: Vec::new() }
        };
        let rows = (0..count).map(row).collect();
        Rows { names: vec![(name.to_owned(), target.span)], rows }
    }

    fn table(&mut self, path: &str, span: Span) -> Rows {
        let file = self.folder.join(path);
        if let Err(problem) = may_read(path, &file, self.roots) {
            let (code, message, help) = match problem {
                PathProblem::Outside { message, help } => (code::OUTSIDE, message, help),
                PathProblem::Missing { message, help } => (code::MISSING_FILE, message, help),
            };
            self.find(code, span, message, help);
            return Rows::default();
        }
        let read = maquette_value::plain::read_text(&file);
        let read = read.map_err(|error| format!("cannot read it: {error}"));
        let table = match read.and_then(|text| table::read(path, &text)) {
            Ok(table) => table,
            Err(why) => {
                self.find(code::WRONG_VALUE, span, format!("{path}: {why}"), "");
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
                    of: span,
                });
                let values = cells.iter().map(|cell| cell.shown.clone()).collect();
                Row { values, set: set.collect(), inputs: Vec::new() }
            })
            .collect();
        Rows { names: table.names.iter().map(|name| (name.clone(), span)).collect(), rows }
    }
}
