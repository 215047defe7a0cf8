//! `Sweep(..)`: reads and checks the file that describes a batch of tasks.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use maquette_graph::catalog::Catalog;
use maquette_graph::{CheckedGraph, Files, Graph, Options};
use maquette_graph::{Word, words_of_choices, words_of_fields};
use maquette_syntax::error::{Diagnostic, MAX_REPORTED, Position, Severity, Source, Span, code};
use maquette_syntax::paths::{folder_of_new, project_root};
use maquette_syntax::spelling::same_file_message;
use maquette_syntax::{
    Body, Field, Help, Kind, LocalDiagnostic, Name, ReadText, SourceMap, SyntaxError, Tree, Walk,
    duplicate_keys, nearest_or_all, parse, quote, read_tree,
};
use schemars::JsonSchema;
use serde::Deserialize;

use super::axis::{Axis, Reader, Row, Rows, Set};
use super::names::{Clash, Template, TemplateError, find_clash};

/// The extension of sweep files.
pub const EXTENSION: &str = ".sweep.ron";

/// A sweep file.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct File {
    /// Path of the graph, relative to this file.
    graph: String,
    /// Values or files that differ between tasks.
    over: Axis,
    /// Values that all tasks share, as with `--set`: of parameters (`name`) and fields (`node.field`).
    #[serde(default)]
    #[expect(dead_code, reason = "what is set is text, which is taken from the file")]
    #[schemars(with = "BTreeMap<String, serde_json::Value>", extend("propertyNames" = { "format": "target" }))]
    set: BTreeMap<String, serde::de::IgnoredAny>,
    /// Name of each task, which is the folder of its outputs: `"{scan}/{growth}"`. If omitted, all values joined by `_`.
    #[serde(default)]
    out: String,
    /// Picture of each task on the contact sheet.
    #[serde(default)]
    picture: Picture,
}

/// The picture of each task on the contact sheet.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq)]
#[serde(default, deny_unknown_fields)]
pub struct Picture {
    /// Output to show. If omitted, the first output with faces, or else the first one that can be shown.
    #[schemars(extend("format" = "output"))]
    pub output: String,
    /// Angles by which the camera is turned to the right and upward.
    #[schemars(extend("unit" = "deg"))]
    pub camera: (f64, f64),
    /// Magnification relative to a view into which the value just fits.
    #[schemars(range(min = 0.01, max = 100.0))]
    pub zoom: f64,
    /// Width and height of the picture.
    #[schemars(extend("unit" = "px"))]
    pub size: (Side, Side),
}

/// Width or height of a picture.
#[derive(Clone, Copy, Debug, Deserialize, JsonSchema, PartialEq)]
#[serde(transparent)]
#[schemars(transparent)]
pub struct Side(#[schemars(range(min = 16, max = 2048))] pub u32);

impl Default for Picture {
    fn default() -> Self {
        Self {
            output: String::new(),
            camera: (30.0, 15.0),
            zoom: 1.0,
            size: (Side(320), Side(240)),
        }
    }
}

/// The tasks of a sweep file. They all evaluate one graph, with different values.
#[derive(Debug)]
pub struct Sweep {
    pub source: Arc<Source>,
    /// The path of the graph file.
    pub graph: PathBuf,
    /// The names of the values that differ between tasks.
    pub names: Vec<String>,
    pub tasks: Vec<Task>,
    pub picture: Picture,
}

/// A task of a sweep: one evaluation of the graph.
#[derive(Clone, Debug)]
pub struct Task {
    /// The name of the task, which is also the name of the folder for its outputs.
    pub name: String,
    pub row: Row,
}

/// The sweep (`None` if its file has errors), and all errors and warnings.
pub(crate) type ReadResult = (Option<Sweep>, Vec<Diagnostic>);

/// Parses the text of a sweep file. Each value is also set in the graph to check that it is valid. No node is run.
pub fn read_text(path: &Path, text: &str, catalog: &Catalog, options: &Options) -> ReadResult {
    read(path, text, catalog, options, true)
}

/// Parses the text of a sweep file without checking its values in the graph. For running a single task, whose record reports errors in its
/// values.
pub fn read_without_trying(
    path: &Path,
    text: &str,
    catalog: &Catalog,
    options: &Options,
) -> ReadResult {
    read(path, text, catalog, options, false)
}

fn read(
    path: &Path,
    text: &str,
    catalog: &Catalog,
    options: &Options,
    tries_values: bool,
) -> ReadResult {
    let source = Arc::new(Source { name: path.to_owned(), text: text.to_owned() });
    let sheet = SourceMap::new(source.clone(), PathBuf::new());
    let ReadText { tree, errors, uncertain_parts } = ReadText::new(&sheet, parse(text), &["Sweep"]);
    let is_whole = uncertain_parts.is_none();
    let mut checker = Checker {
        source,
        catalog,
        options,
        tries: tries_values,
        is_whole,
        diagnostics: Vec::new(),
    };
    let sweep = tree.and_then(|mut tree| {
        name_fields(&mut tree);
        checker.sweep(&tree)
    });
    let mut diagnostics = checker.diagnostics;
    if let Some(uncertain_parts) = uncertain_parts {
        diagnostics.retain(|diagnostic| !uncertain_parts.covers_diagnostic(diagnostic));
        for SyntaxError { span, message, help } in errors {
            let note = None;
            diagnostics.push(
                LocalDiagnostic { code: code::SYNTAX, span, message, help, note }
                    .into_diagnostic(&sheet.source),
            );
        }
    }
    diagnostics.sort_by_key(|diagnostic| diagnostic.span);
    let has_error = diagnostics.iter().any(|diagnostic| diagnostic.severity == Severity::Error);
    (sweep.filter(|_| !has_error), diagnostics)
}

/// Inserts field names that may be omitted in the file, as in `Files("scans/*")` or `picture: "model.glb"`.
fn name_fields(tree: &mut Tree) {
    let Kind::Call { body: Body::Fields(fields), .. } = &mut tree.kind else { return };
    for field in fields {
        match &field.name.text[..] {
            "picture" => name_field(&mut field.value, "output"),
            "over" => name_axis_fields(&mut field.value),
            _ => {}
        }
    }
}

fn name_axis_fields(tree: &mut Tree) {
    match &mut tree.kind {
        Kind::Call { name: Some(name), .. } if name.text == "Files" => name_field(tree, "pattern"),
        Kind::Call { body: Body::Items(items), .. } => {
            for item in items {
                if let Kind::List(axes) = &mut item.kind {
                    axes.iter_mut().for_each(name_axis_fields);
                }
            }
        }
        _ => {}
    }
}

/// If `tree` is a text, converts it to a call that has the text as the value of the field `field`.
fn name_field(tree: &mut Tree, field: &str) {
    fn fields(value: Tree, field: &str) -> Body {
        let span = Span { start: value.span.start, end: value.span.start };
        Body::Fields(vec![Field { name: Name { text: field.to_owned(), span }, value }])
    }
    match &mut tree.kind {
        Kind::Text(_) => {
            let body = fields(tree.clone(), field);
            tree.kind = Kind::Call { name: None, body };
        }
        Kind::Call { body, .. } => {
            if let Body::Items(items) = body
                && let [item] = &items[..]
                && item.text().is_some()
            {
                *body = fields(item.clone(), field);
            }
        }
        _ => {}
    }
}

struct Checker<'a> {
    source: Arc<Source>,
    catalog: &'a Catalog,
    options: &'a Options,
    /// True if each value is set in the graph to check that it is valid. Otherwise only the sweep file is checked.
    tries: bool,
    /// True if the sweep file has no syntax errors.
    is_whole: bool,
    diagnostics: Vec<Diagnostic>,
}

impl Checker<'_> {
    fn report(&mut self, code: &'static str, span: Span, message: String, help: impl Into<Help>) {
        let diagnostic = LocalDiagnostic { code, span, message, help: help.into(), note: None };
        self.diagnostics.push(diagnostic.into_diagnostic(&self.source));
    }

    fn sweep(&mut self, tree: &Tree) -> Option<Sweep> {
        if tree.name().is_none_or(|name| name.text != "Sweep") {
            let message = format!("expected Sweep(..), found {}", tree.describe());
            let help = "begin with `Sweep(graph: \"name.ron\", over: Values(\"name\", [1, 2]))`";
            self.report(code::SYNTAX, tree.span, message, help);
            return None;
        }
        let schema = schema();
        let mut walk = Walk {
            node: "Sweep",
            root: &schema,
            source_map: None,
            diagnostics: Vec::new(),
            links: Vec::new(),
            files: Vec::new(),
        };
        walk.node(tree);
        let mut diagnostics = walk.diagnostics;
        diagnostics.extend(duplicate_keys(entries(tree, "set"), "value"));
        self.diagnostics.extend(
            diagnostics.into_iter().map(|diagnostic| diagnostic.into_diagnostic(&self.source)),
        );
        if !self.diagnostics.is_empty() {
            return None;
        }
        let file: File = match read_tree(tree) {
            Ok(file) => file,
            Err(error) => {
                let span = error.span.unwrap_or(tree.span);
                self.report(code::WRONG_VALUE, span, error.message, "");
                return None;
            }
        };
        let folder = self.source.name.parent().unwrap_or(Path::new("")).to_owned();
        let graph = folder.join(&file.graph);
        if !graph.is_file() && !self.options.has_text(&graph) {
            let message = format!("there is no graph `{}`", file.graph);
            let span = field(tree, "graph").map_or(tree.span, |field| field.span);
            self.report(code::MISSING_FILE, span, message, "the path is relative to this file");
            return None;
        }
        let text = self.source.text.clone();
        let all: Vec<_> = entries(tree, "set")
            .iter()
            .filter_map(|(key, value)| {
                let text = text[value.span.start..value.span.end].to_owned();
                Some(Set {
                    target: key.text()?.to_owned(),
                    text,
                    span: value.span,
                    target_span: key.span,
                })
            })
            .collect();
        let rows = self.rows(&file, tree, &folder, &graph)?;
        self.warn_of_unused(&all, &rows);
        let mut sweep = self.name_tasks(&file, tree, &graph, &all, rows)?;
        if !self.is_whole {
            sweep
                .tasks
                .iter_mut()
                .for_each(|task| task.row.set.retain(|set| parse(&set.text).1.is_empty()));
        }
        if self.tries {
            self.try_values(&sweep);
        }
        Some(sweep)
    }

    /// Returns the rows of the file's axis: for each task, the values that differ between tasks.
    fn rows(&mut self, file: &File, tree: &Tree, folder: &Path, graph: &Path) -> Option<Rows> {
        let (over, graph_folder) = (field(tree, "over")?, folder_of_new(graph));
        let roots = self.options.roots.iter().filter_map(|root| std::fs::canonicalize(root).ok());
        let roots = Vec::from_iter([project_root(&graph_folder)].into_iter().chain(roots));
        // Ignore missing files, because each task may replace them by others.
        let options = Options { files: Files::Ignored, ..self.options.clone() };
        let here = folder_of_new(&folder.join("sweep"));
        let mut reader = Reader {
            text: &self.source.text,
            folder: &here,
            graph_folder: &graph_folder,
            roots: &roots,
            reads: &|| files_read(&Graph::load(graph, self.catalog, &options)),
            diagnostics: Vec::new(),
            warnings: Vec::new(),
        };
        let rows = reader.rows(&file.over, over);
        let (mut diagnostics, warnings) = (reader.diagnostics, reader.warnings);
        diagnostics.truncate(MAX_REPORTED);
        let mut known = BTreeSet::new();
        for (name, span) in &rows.names {
            if !known.insert(name) {
                let message = format!("`{name}` is swept twice");
                let help = "rename or remove one of them";
                let (span, help) = (*span, help.into());
                diagnostics.push(LocalDiagnostic {
                    code: code::BAD_NAME,
                    span,
                    message,
                    help,
                    note: None,
                });
            }
        }
        let is_right = diagnostics.is_empty();
        self.diagnostics.extend(
            diagnostics.into_iter().map(|diagnostic| diagnostic.into_diagnostic(&self.source)),
        );
        warnings.into_iter().take(MAX_REPORTED).for_each(|warning| self.warn(warning));
        is_right.then_some(rows)
    }

    /// Warns of values in `set` that have no effect because every task sets another value.
    fn warn_of_unused(&mut self, all: &[Set], rows: &Rows) {
        /// If all rows set the parameter or field `target`, returns the position of its name in `over`.
        fn overriding_span(target: &str, rows: &[Row]) -> Option<Span> {
            let first = rows.first()?.set.iter().find(|set| set.target == target)?;
            rows.iter().all(|row| row.sets(target)).then_some(first.target_span)
        }
        let in_file = all.iter().filter(|set| overriding_span(&set.target, &rows.rows).is_some());
        let in_file = in_file.map(|set| (set.target_span, format!("`{}`", set.target)));
        let given = self.options.set.iter().filter_map(|(target, text)| {
            Some((overriding_span(target, &rows.rows)?, format!("`--set {target}={text}`")))
        });
        for (span, what) in in_file.chain(given).collect::<Vec<_>>() {
            let message = format!("{what} has no effect: each task has its own value from `over`");
            let diagnostic = LocalDiagnostic {
                code: code::UNUSED,
                span,
                message,
                help: "remove it".into(),
                note: None,
            };
            self.warn(diagnostic);
        }
    }

    fn warn(&mut self, diagnostic: LocalDiagnostic) {
        let diagnostic = diagnostic.into_diagnostic(&self.source);
        self.diagnostics.push(Diagnostic { severity: Severity::Warning, ..diagnostic });
    }

    /// Creates a task from each row, and names the tasks.
    fn name_tasks(
        &mut self,
        file: &File,
        tree: &Tree,
        graph: &Path,
        all: &[Set],
        rows: Rows,
    ) -> Option<Sweep> {
        let names: Vec<_> = rows.names.iter().map(|(name, _)| name.clone()).collect();
        let out = field(tree, "out");
        let template = match out {
            None => Template::of_all(names.len()),
            Some(out) => {
                match Template::read(
                    &file.out,
                    &names.iter().map(String::as_str).collect::<Vec<_>>(),
                ) {
                    Ok(template) => template,
                    Err(wrong) => {
                        self.report_template(&wrong, out, &names);
                        return None;
                    }
                }
            }
        };
        let named: Vec<_> = rows
            .rows
            .iter()
            .enumerate()
            .map(|(index, row)| template.name(index, &row.values))
            .collect();
        let span = out.map_or(tree.span, |out| out.span);
        let (message, help): (_, Help) = match find_clash(&named) {
            None => {
                let tasks = named
                    .into_iter()
                    .zip(rows.rows)
                    .map(|(name, mut row): (String, Row)| {
                        // The values of a row take precedence over those in `set`, which all tasks share.
                        let mut set: Vec<_> = all
                            .iter()
                            .filter(|set| row.set.iter().all(|own| own.target != set.target))
                            .cloned()
                            .collect();
                        set.append(&mut row.set);
                        Task { name, row: Row { set, ..row } }
                    })
                    .collect();
                let (source, graph) = (self.source.clone(), graph.to_owned());
                return Some(Sweep { source, graph, names, tasks, picture: file.picture.clone() });
            }
            Some(Clash::Same(first, second)) => (
                format!(
                    "{}: {} and {}",
                    match named[first] == named[second] {
                        true => format!("two tasks have the name `{}`", named[second]),
                        false => same_file_message("tasks", &named[first], &named[second]),
                    },
                    values_in_words(&names, &rows.rows[first].values),
                    values_in_words(&names, &rows.rows[second].values)
                ),
                distinguishing_help(&rows, &template, &file.out, [first, second]).into(),
            ),
            Some(Clash::Inside(outer, inner)) => (
                format!(
                    "the folder `{}` of one task is inside `{}`, the folder of another task",
                    named[inner], named[outer]
                ),
                "use the same number of folders for all tasks".into(),
            ),
            Some(Clash::Reserved(index)) => (
                format!(
                    "`{}` cannot name a task: the batch writes its records and its contact sheet there",
                    named[index]
                ),
                "add a word before it: `out: \"of-{a}\"`".into(),
            ),
        };
        self.report(code::BAD_NAME, span, message, help);
        None
    }

    fn report_template(&mut self, wrong: &TemplateError, out: &Tree, names: &[String]) {
        // The position, in the sweep file, of an error in the template `out`. It is inexact if the template contains escape sequences.
        let start = out.span.start + 1 + wrong.at;
        let text = &self.source.text[out.span.start..out.span.end];
        let is_plain = !text.contains('\\') && text.starts_with('"');
        let span = if is_plain { Span { start, end: out.span.end - 1 } } else { out.span };
        let known: Vec<_> = names.iter().map(String::as_str).collect();
        let help: Help = match &wrong.unknown {
            Some(unknown) => String::from(nearest_or_all(unknown, "the names", &known)).into(),
            None => "use `{name}` for a value and `/` between folders".into(),
        };
        self.report(code::BAD_NAME, span, wrong.message.clone(), help);
    }

    /// Sets each value in the graph, together with the other values of the first task, and checks the graph. An error is reported at the
    /// value that causes it.
    fn try_values(&mut self, sweep: &Sweep) {
        let Some(Task { row: first, .. }) = sweep.tasks.first() else { return };
        let checked = self.graph_with(sweep, &first.set);
        self.report_unknown_names(sweep, checked.graph.as_ref());
        let own = self.graph_with(sweep, &[]).diagnostics;
        for diagnostic in &checked.diagnostics {
            let is_own = own.contains(diagnostic);
            let by = if is_own {
                None
            } else {
                first.set.iter().find(|set| {
                    self.graph_with(sweep, std::slice::from_ref(set))
                        .diagnostics
                        .contains(diagnostic)
                })
            };
            self.report_graph_diagnostic(diagnostic, &first.set, by.map(|set| set.target_span));
        }
        fn pair(set: &Set) -> (String, String) {
            (set.target.clone(), set.text.clone())
        }
        let mut tried: BTreeSet<_> = first.set.iter().map(pair).collect();
        for task in &sweep.tasks {
            let new = task.row.set.iter().filter(|set| tried.insert(pair(set))).cloned();
            let new = Vec::from_iter(new);
            let Some(Set { span, .. }) = new.first() else { continue };
            let with = first
                .set
                .iter()
                .filter(|set| new.iter().all(|new| new.target != set.target))
                .chain(&new)
                .cloned();
            for diagnostic in self.graph_with(sweep, &Vec::from_iter(with)).diagnostics {
                if !checked.diagnostics.contains(&diagnostic)
                    && self.diagnostics.len() < MAX_REPORTED
                {
                    self.report_graph_diagnostic(&diagnostic, &new, Some(*span));
                }
            }
        }
    }

    /// Reports an error of the graph at the value that the error is about. If the error is not about a value of the sweep, reports it at
    /// the value that caused it.
    fn report_graph_diagnostic(&mut self, diagnostic: &Diagnostic, set: &[Set], new: Option<Span>) {
        fn words(set: &Set) -> String {
            format!("--set {}={}", set.target, set.text)
        }
        let (span, message) = match (
            set.iter().find(|set| {
                let words = words(set);
                let note = diagnostic.note.as_ref().is_some_and(|(_, note)| note.contains(&words));
                note || diagnostic.message.contains(&words)
            }),
            new,
        ) {
            (Some(set), _) => {
                // Report an unknown name only once, although every value of the axis causes the error.
                let is_unknown =
                    [code::UNKNOWN_LINK, code::UNKNOWN_FIELD].contains(&diagnostic.code);
                let span = if is_unknown { set.target_span } else { set.span };
                (span, diagnostic.message.replace(&format!("{}: ", words(set)), ""))
            }
            (None, Some(span)) => {
                (span, format!("{}: {}", format_position(diagnostic), diagnostic.message))
            }
            (None, None) => return self.diagnostics.push(diagnostic.clone()),
        };
        let source = (self.source.clone(), span);
        let reported = Diagnostic::new(diagnostic.severity, diagnostic.code, source, message);
        let reported = Diagnostic { help: diagnostic.help.clone(), ..reported };
        if !self.diagnostics.contains(&reported) {
            self.diagnostics.push(reported);
        }
    }

    /// Reports names in the sweep that the graph does not have: those of inputs, and that of the output in the picture.
    fn report_unknown_names(&mut self, sweep: &Sweep, graph: Option<&Graph>) {
        let Some(graph) = graph else { return };
        let known: Vec<_> = graph.inputs().iter().map(|input| &input.name[..]).collect();
        let inputs =
            sweep.tasks[0].row.inputs.iter().filter(|(name, _)| !known.contains(&&name[..]));
        for (name, _) in inputs {
            let help = match known.is_empty() {
                true => "it has no inputs; use `set` to put files into fields".into(),
                false => nearest_or_all(name, "its inputs", &known),
            };
            let message = format!("the graph has no input `{name}`");
            self.report(code::UNKNOWN_FIELD, self.text_at(name), message, help);
        }
        let picture = &sweep.picture.output;
        let outputs: Vec<_> = graph.results().map(|(name, _)| name).collect();
        fn is_there(outputs: &[&str], picture: &str, graph: &Graph) -> bool {
            outputs.contains(&picture) || graph.find_value(picture).is_some()
        }
        if !picture.is_empty() && !is_there(&outputs, picture, graph) {
            let message = format!("the graph has no output `{picture}`");
            let help = nearest_or_all(picture, "its outputs", &outputs);
            self.report(code::UNKNOWN_LINK, self.text_at(picture), message, help);
        }
    }

    /// Returns the position of the quoted text `text` in the file.
    fn text_at(&self, text: &str) -> Span {
        let quoted = quote(text);
        let start = self.source.text.find(&quoted);
        start.map_or_else(Span::default, |start| Span { start, end: start + quoted.len() })
    }

    fn graph_with(&self, sweep: &Sweep, set: &[Set]) -> CheckedGraph {
        Graph::load(&sweep.graph, self.catalog, &options_with(set, self.options))
    }
}

/// Returns options for loading a graph that also set the values of a task.
pub fn options_with(set: &[Set], options: &Options) -> Options {
    let own = set.iter().map(|set| (set.target.clone(), set.text.clone()));
    let set = options.set.iter().cloned().chain(own).collect();
    Options { set, ..options.clone() }
}

/// Returns the files that the graph's own nodes read, each with the field that contains its path. Nodes of used graphs are not included.
fn files_read(checked: &CheckedGraph) -> Vec<(String, PathBuf)> {
    let graph = checked.graph.as_ref().or(checked.partial.as_ref());
    let own =
        graph.into_iter().flat_map(|graph| graph.nodes().iter()).filter(|it| it.uses.is_empty());
    own.flat_map(|node| {
        let files = node.recipe.files().into_iter();
        files.map(|(field, path)| (format!("{}.{field}", node.name), path)).collect::<Vec<_>>()
    })
    .collect()
}

/// Formats the position of a diagnostic, such as `doll.ron:12:3`.
fn format_position(diagnostic: &Diagnostic) -> String {
    let Position { line, column } =
        Position::from_offset(&diagnostic.source.text, diagnostic.span.start);
    format!("{}:{line}:{column}", diagnostic.source.name.display())
}

/// Formats the values of a task, such as `growth = 5, levels = 0`.
pub(crate) fn values_in_words(names: &[String], values: &[String]) -> String {
    let each = names.iter().zip(values).map(|(name, value)| format!("{name} = {value}"));
    Vec::from_iter(each).join(", ")
}

/// Returns a help text for two tasks with equal names. It suggests adding to the template the values that differ between the tasks and are
/// missing in the template.
fn distinguishing_help(
    rows: &Rows,
    by: &Template,
    out: &str,
    [first, second]: [usize; 2],
) -> String {
    if rows.rows[first].values == rows.rows[second].values {
        return "remove one of the two equal sets of values".into();
    }
    let missing = (0..rows.names.len()).filter(|&index| {
        let mut values = rows.rows.iter().map(|row| &row.values[index]);
        let first = values.next();
        !by.contains(index) && values.any(|value| Some(value) != first)
    });
    match String::from_iter(missing.map(|index| format!("_{{{}}}", rows.names[index].0))) {
        missing if missing.is_empty() => {
            "use values that differ in more than the case of letters; characters other than letters, digits, `.`, `_`, `+` and `-` are written as `-`".into()
        }
        missing => {
            format!("add the values that differ: `out: {}`", quote(&format!("{out}{missing}")))
        }
    }
}

fn field<'t>(tree: &'t Tree, name: &str) -> Option<&'t Tree> {
    tree.fields()?.iter().find(|field| field.name.text == name).map(|field| &field.value)
}

fn entries<'t>(tree: &'t Tree, name: &str) -> &'t [(Tree, Tree)] {
    match field(tree, name).map(|tree| &tree.kind) {
        Some(Kind::Map(entries)) => entries,
        _ => &[],
    }
}

/// Returns the JSON schema of sweep files.
pub fn schema() -> serde_json::Value {
    schemars::schema_for!(File).into()
}

/// Returns the keywords of sweep files, with their documentation.
pub fn words() -> Vec<Word> {
    fn field_words(within: &str, schema: schemars::Schema) -> Vec<Word> {
        words_of_fields("sweep", within, &schema.into())
    }
    let axes: serde_json::Value = schemars::schema_for!(Axis).into();
    let mut words = field_words("Sweep", schemars::schema_for!(File));
    words.extend(field_words("picture", schemars::schema_for!(Picture)));
    words.extend(words_of_choices("sweep", "over", &axes));
    words
}
