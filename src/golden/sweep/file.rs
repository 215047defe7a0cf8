//! `Sweep(..)`: the file of a batch, read and checked.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use maquette_graph::catalog::Catalog;
use maquette_graph::{Checked, Files, Graph, Options};
use maquette_graph::{Word, words_of_choices, words_of_fields};
use maquette_syntax::error::{MOST_TOLD, Place, Problem, Severity, Source, Span, code};
use maquette_syntax::paths::{folder_of_new, project_root};
use maquette_syntax::spelling::one_file;
use maquette_syntax::{
    Body, Field, Finding, Help, Kind, Mistake, Name, ReadText, Sheet, Tree, Walk, nearest_or_all,
    parse, quoted, read_tree, twice,
};
use schemars::JsonSchema;
use serde::Deserialize;

use super::axis::{Axis, Reader, Row, Rows, Set};
use super::names::{Clash, Template, Wrong, clash};

/// How files of sweeps are called.
pub const ENDING: &str = ".sweep.ron";

/// A file of tasks as it is written.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct File {
    /// The graph, relative to this file.
    graph: String,
    /// What differs from task to task.
    over: Axis,
    /// Values that all tasks have, as with `--set`: of parameters (`name`) and fields (`node.field`).
    #[serde(default)]
    #[expect(dead_code, reason = "what is set is text, which is taken from the file")]
    #[schemars(with = "BTreeMap<String, serde_json::Value>", extend("propertyNames" = { "format": "target" }))]
    set: BTreeMap<String, serde::de::IgnoredAny>,
    /// The name of each task, which is the folder of its outputs: `"{scan}/{growth}"`. Without it all values, with `_` between them.
    #[serde(default)]
    out: String,
    /// What the contact sheet shows of each task.
    #[serde(default)]
    picture: Picture,
}

/// What the contact sheet shows of each task.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq)]
#[serde(default, deny_unknown_fields)]
pub struct Picture {
    /// The output. Without it the first one with faces, or else the first one that can be seen.
    #[schemars(extend("format" = "output"))]
    pub output: String,
    /// From how far to the right and above it is seen.
    #[schemars(extend("unit" = "deg"))]
    pub camera: (f64, f64),
    /// How much nearer than what just fits.
    #[schemars(range(min = 0.01, max = 100.0))]
    pub zoom: f64,
    /// Width and height.
    #[schemars(extend("unit" = "px"))]
    pub size: (Side, Side),
}

/// One side of a picture.
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

/// The tasks of one graph.
#[derive(Debug)]
pub struct Sweep {
    pub source: Arc<Source>,
    /// The graph's file.
    pub graph: PathBuf,
    /// What the values of tasks are called.
    pub names: Vec<String>,
    pub tasks: Vec<Task>,
    pub picture: Picture,
}

/// One evaluation of the graph.
#[derive(Clone, Debug)]
pub struct Task {
    /// The folder of its outputs.
    pub name: String,
    pub row: Row,
}

/// A sweep, if there are no errors, and all problems of it.
pub(crate) type Read = (Option<Sweep>, Vec<Problem>);

/// Reads the text of a sweep that stands, or will stand, in this file. Nothing is run, but each value is tried on the graph.
pub fn read_text(path: &Path, text: &str, catalog: &Catalog, options: &Options) -> Read {
    read(path, text, catalog, options, true)
}

/// The same without trying values, for who runs one of many tasks: what is wrong with its own is told by its record.
pub fn read_untried(path: &Path, text: &str, catalog: &Catalog, options: &Options) -> Read {
    read(path, text, catalog, options, false)
}

fn read(path: &Path, text: &str, catalog: &Catalog, options: &Options, tries: bool) -> Read {
    let source = Arc::new(Source { name: path.to_owned(), text: text.to_owned() });
    let sheet = Sheet::new(source.clone(), PathBuf::new());
    let ReadText { tree, mistakes, doubts } = ReadText::new(&sheet, parse(text), &["Sweep"]);
    let is_whole = doubts.is_none();
    let mut checker = Checker { source, catalog, options, tries, is_whole, problems: Vec::new() };
    let sweep = tree.and_then(|mut tree| {
        with_names(&mut tree);
        checker.sweep(&tree)
    });
    let mut problems = checker.problems;
    if let Some(doubts) = doubts {
        problems.retain(|problem| !doubts.cover_problem(problem));
        for Mistake { span, message, help } in mistakes {
            let note = None;
            problems
                .push(Finding { code: code::SYNTAX, span, message, help, note }.at(&sheet.source));
        }
    }
    problems.sort_by_key(|problem| problem.span);
    let has_error = problems.iter().any(|problem| problem.severity == Severity::Error);
    (sweep.filter(|_| !has_error), problems)
}

/// Gives fields to what needs no names where nothing else stands: `Files("scans/*")`, `picture: "model.glb"`.
fn with_names(tree: &mut Tree) {
    let Kind::Call { body: Body::Fields(fields), .. } = &mut tree.kind else { return };
    for field in fields {
        match &field.name.text[..] {
            "picture" => with_name(&mut field.value, "output"),
            "over" => of_axis(&mut field.value),
            _ => {}
        }
    }
}

fn of_axis(tree: &mut Tree) {
    match &mut tree.kind {
        Kind::Call { name: Some(name), .. } if name.text == "Files" => with_name(tree, "pattern"),
        Kind::Call { body: Body::Items(items), .. } => {
            for item in items {
                if let Kind::List(axes) = &mut item.kind {
                    axes.iter_mut().for_each(of_axis);
                }
            }
        }
        _ => {}
    }
}

/// Makes a field of a text that stands alone.
fn with_name(tree: &mut Tree, field: &str) {
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
    /// Whether each value is tried on the graph.
    tries: bool,
    /// Whether there are no syntax errors.
    is_whole: bool,
    problems: Vec<Problem>,
}

impl Checker<'_> {
    fn find(&mut self, code: &'static str, span: Span, message: String, help: impl Into<Help>) {
        let finding = Finding { code, span, message, help: help.into(), note: None };
        self.problems.push(finding.at(&self.source));
    }

    fn sweep(&mut self, tree: &Tree) -> Option<Sweep> {
        if tree.name().is_none_or(|name| name.text != "Sweep") {
            let message = format!("a sweep is Sweep(..), not {}", tree.in_words());
            let help = "begin with `Sweep(graph: \"name.ron\", over: Values(\"name\", [1, 2]))`";
            self.find(code::SYNTAX, tree.span, message, help);
            return None;
        }
        let schema = schema();
        let mut walk = Walk {
            node: "Sweep",
            root: &schema,
            sheet: None,
            findings: Vec::new(),
            links: Vec::new(),
            files: Vec::new(),
        };
        walk.node(tree);
        let mut findings = walk.findings;
        findings.extend(twice(entries(tree, "set"), "value"));
        self.problems.extend(findings.into_iter().map(|finding| finding.at(&self.source)));
        if !self.problems.is_empty() {
            return None;
        }
        let file: File = match read_tree(tree) {
            Ok(file) => file,
            Err(error) => {
                let span = error.span.unwrap_or(tree.span);
                self.find(code::WRONG_VALUE, span, error.message, "");
                return None;
            }
        };
        let folder = self.source.name.parent().unwrap_or(Path::new("")).to_owned();
        let graph = folder.join(&file.graph);
        if !graph.is_file() && !self.options.has_text(&graph) {
            let message = format!("there is no graph `{}`", file.graph);
            let span = field(tree, "graph").map_or(tree.span, |field| field.span);
            self.find(code::MISSING_FILE, span, message, "the path is relative to this file");
            return None;
        }
        let text = self.source.text.clone();
        let all: Vec<_> = entries(tree, "set")
            .iter()
            .filter_map(|(key, value)| {
                let text = text[value.span.start..value.span.end].to_owned();
                Some(Set { target: key.text()?.to_owned(), text, span: value.span, of: key.span })
            })
            .collect();
        let rows = self.rows(&file, tree, &folder, &graph)?;
        self.idle(&all, &rows);
        let mut sweep = self.named(&file, tree, &graph, &all, rows)?;
        if !self.is_whole {
            sweep
                .tasks
                .iter_mut()
                .for_each(|task| task.row.set.retain(|set| parse(&set.text).1.is_empty()));
        }
        if self.tries {
            self.tried(&sweep);
        }
        Some(sweep)
    }

    /// What differs from task to task.
    fn rows(&mut self, file: &File, tree: &Tree, folder: &Path, graph: &Path) -> Option<Rows> {
        let (over, graph_folder) = (field(tree, "over")?, folder_of_new(graph));
        let roots = self.options.roots.iter().filter_map(|root| std::fs::canonicalize(root).ok());
        let roots = Vec::from_iter([project_root(&graph_folder)].into_iter().chain(roots));
        // What each task replaces need not be there.
        let options = Options { files: Files::Ignored, ..self.options.clone() };
        let reads = || reads(&Graph::load(graph, self.catalog, &options));
        let here = folder_of_new(&folder.join("sweep"));
        let mut reader = Reader {
            text: &self.source.text,
            folder: &here,
            graph_folder: &graph_folder,
            roots: &roots,
            reads: &reads,
            findings: Vec::new(),
            warnings: Vec::new(),
        };
        let rows = reader.rows(&file.over, over);
        let (mut findings, warnings) = (reader.findings, reader.warnings);
        findings.truncate(MOST_TOLD);
        let mut known = BTreeSet::new();
        for (name, span) in &rows.names {
            if !known.insert(name) {
                let message = format!("`{name}` is swept twice");
                let help = "give one of them another name, or leave it out";
                let (span, help) = (*span, help.into());
                findings.push(Finding { code: code::BAD_NAME, span, message, help, note: None });
            }
        }
        let is_right = findings.is_empty();
        self.problems.extend(findings.into_iter().map(|finding| finding.at(&self.source)));
        warnings.into_iter().take(MOST_TOLD).for_each(|warning| self.warn(warning));
        is_right.then_some(rows)
    }

    /// Warns of values for all tasks that count for none, since each task has one of its own.
    fn idle(&mut self, all: &[Set], rows: &Rows) {
        fn own(target: &str, rows_rows: &[Row]) -> Option<Span> {
            let first = rows_rows.first()?.set.iter().find(|set| set.target == target)?;
            rows_rows
                .iter()
                .all(|row| row.set.iter().any(|set| set.target == target))
                .then_some(first.of)
        }
        let in_file = all.iter().filter(|set| own(&set.target, &rows.rows).is_some());
        let in_file = in_file.map(|set| (set.of, format!("`{}`", set.target)));
        let given = self.options.set.iter().filter_map(|(target, text)| {
            Some((own(target, &rows.rows)?, format!("`--set {target}={text}`")))
        });
        for (span, what) in in_file.chain(given).collect::<Vec<_>>() {
            let message =
                format!("{what} counts for no task: each has a value of its own from `over`");
            let finding = Finding {
                code: code::UNUSED,
                span,
                message,
                help: "leave it out".into(),
                note: None,
            };
            self.warn(finding);
        }
    }

    fn warn(&mut self, finding: Finding) {
        let told = finding.at(&self.source);
        self.problems.push(Problem { severity: Severity::Warning, ..told });
    }

    /// The tasks with their names.
    fn named(
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
                        self.wrong(&wrong, out, &names);
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
        fn told(index: usize, names: &[String], rows_rows: &[Row]) -> String {
            values_in_words(names, &rows_rows[index].values)
        }
        let (message, help): (_, Help) = match clash(&named) {
            None => {
                let tasks = named
                    .into_iter()
                    .zip(rows.rows)
                    .map(|(name, mut row): (String, Row)| {
                        // What a task sets itself counts.
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
                        false => one_file("tasks", &named[first], &named[second]),
                    },
                    told(first, &names, &rows.rows),
                    told(second, &names, &rows.rows)
                ),
                telling_apart(&rows, &template, &file.out, [first, second]).into(),
            ),
            Some(Clash::Inside(outer, inner)) => (
                format!(
                    "the folder `{}` of one task lies in `{}`, which is that of another",
                    named[inner], named[outer]
                ),
                "give all tasks equally many folders".into(),
            ),
            Some(Clash::Own(index)) => (
                format!(
                    "no task can have the name `{}`: the batch has its records and its contact sheet there",
                    named[index]
                ),
                "put a word before it: `out: \"of-{a}\"`".into(),
            ),
        };
        self.find(code::BAD_NAME, span, message, help);
        None
    }

    fn wrong(&mut self, wrong: &Wrong, out: &Tree, names: &[String]) {
        // Where it stands, unless escapes are before it.
        let start = out.span.start + 1 + wrong.at;
        let text = &self.source.text[out.span.start..out.span.end];
        let is_plain = !text.contains('\\') && text.starts_with('"');
        let span = if is_plain { Span { start, end: out.span.end - 1 } } else { out.span };
        let known: Vec<_> = names.iter().map(String::as_str).collect();
        let help: Help = match &wrong.unknown {
            Some(unknown) => String::from(nearest_or_all(unknown, "the names", &known)).into(),
            None => "`{name}` stands for a value, `/` divides folders".into(),
        };
        self.find(code::BAD_NAME, span, wrong.message.clone(), help);
    }

    /// Tries each value on the graph, with those of the first task for the others. What is wrong with one is told at its place.
    fn tried(&mut self, sweep: &Sweep) {
        let Some(Task { row: first, .. }) = sweep.tasks.first() else { return };
        let checked = self.graph_with(sweep, &first.set);
        self.unfit(sweep, checked.graph.as_ref());
        let own = self.graph_with(sweep, &[]).problems;
        for problem in &checked.problems {
            let is_own = own.contains(problem);
            let by = if is_own {
                None
            } else {
                first.set.iter().find(|set| {
                    self.graph_with(sweep, std::slice::from_ref(set)).problems.contains(problem)
                })
            };
            self.tell(problem, &first.set, by.map(|set| set.of));
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
            for problem in self.graph_with(sweep, &Vec::from_iter(with)).problems {
                if !checked.problems.contains(&problem) && self.problems.len() < MOST_TOLD {
                    self.tell(&problem, &new, Some(*span));
                }
            }
        }
    }

    /// Tells a problem of the graph: at the value that it is about, or at the one with which it came.
    fn tell(&mut self, problem: &Problem, set: &[Set], new: Option<Span>) {
        fn words(set: &Set) -> String {
            format!("--set {}={}", set.target, set.text)
        }
        let (span, message) = match (
            set.iter().find(|set| {
                let words = words(set);
                let note = problem.note.as_ref().is_some_and(|(_, note)| note.contains(&words));
                note || problem.message.contains(&words)
            }),
            new,
        ) {
            (Some(set), _) => {
                // What is not there is told once, and not for each value.
                let is_unknown = [code::UNKNOWN_LINK, code::UNKNOWN_FIELD].contains(&problem.code);
                let span = if is_unknown { set.of } else { set.span };
                (span, problem.message.replace(&format!("{}: ", words(set)), ""))
            }
            (None, Some(span)) => (span, format!("{}: {}", place(problem), problem.message)),
            (None, None) => return self.problems.push(problem.clone()),
        };
        let source = (self.source.clone(), span);
        let told = Problem::new(problem.severity, problem.code, source, message);
        let told = Problem { help: problem.help.clone(), ..told };
        if !self.problems.contains(&told) {
            self.problems.push(told);
        }
    }

    /// What the sweep names and the graph does not have: inputs, and the output that is shown.
    fn unfit(&mut self, sweep: &Sweep, graph: Option<&Graph>) {
        let Some(graph) = graph else { return };
        let known: Vec<_> = graph.inputs().iter().map(|input| &input.name[..]).collect();
        let inputs =
            sweep.tasks[0].row.inputs.iter().filter(|(name, _)| !known.contains(&&name[..]));
        for (name, _) in inputs {
            let help = match known.is_empty() {
                true => "it has no inputs at all: `set` puts files into fields".into(),
                false => nearest_or_all(name, "its inputs", &known),
            };
            let message = format!("the graph has no input `{name}`");
            self.find(code::UNKNOWN_FIELD, self.text_at(name), message, help);
        }
        let picture = &sweep.picture.output;
        let outputs: Vec<_> = graph.results().map(|(name, _)| name).collect();
        fn is_there(outputs: &[&str], picture: &str, graph: &Graph) -> bool {
            outputs.contains(&&picture[..]) || graph.value_named(picture).is_some()
        }
        if !picture.is_empty() && !is_there(&outputs, picture, graph) {
            let message = format!("the graph has no output `{picture}`");
            let help = nearest_or_all(picture, "its outputs", &outputs);
            self.find(code::UNKNOWN_LINK, self.text_at(picture), message, help);
        }
    }

    /// Where a text stands in the file.
    fn text_at(&self, text: &str) -> Span {
        let quoted = quoted(text);
        let start = self.source.text.find(&quoted);
        start.map_or_else(Span::default, |start| Span { start, end: start + quoted.len() })
    }

    fn graph_with(&self, sweep: &Sweep, set: &[Set]) -> Checked {
        Graph::load(&sweep.graph, self.catalog, &with(set, self.options))
    }
}

/// Options with values that a task sets.
pub fn with(set: &[Set], options: &Options) -> Options {
    let own = set.iter().map(|set| (set.target.clone(), set.text.clone()));
    let set = options.set.iter().cloned().chain(own).collect();
    Options { set, ..options.clone() }
}

/// What names the files that a graph reads in its own file, and these files.
fn reads(checked: &Checked) -> Vec<(String, PathBuf)> {
    let graph = checked.graph.as_ref().or(checked.partial.as_ref());
    let own =
        graph.into_iter().flat_map(|graph| graph.nodes().iter()).filter(|it| it.uses.is_empty());
    own.flat_map(|node| {
        let files = node.recipe.files().into_iter();
        files.map(|(field, path)| (format!("{}.{field}", node.name), path)).collect::<Vec<_>>()
    })
    .collect()
}

/// `doll.ron:12:3`.
fn place(problem: &Problem) -> String {
    let Place { line, column } = Place::of(&problem.source.text, problem.span.start);
    format!("{}:{line}:{column}", problem.source.name.display())
}

/// `growth = 5, levels = 0`.
pub(crate) fn values_in_words(names: &[String], values: &[String]) -> String {
    let each = names.iter().zip(values).map(|(name, value)| format!("{name} = {value}"));
    Vec::from_iter(each).join(", ")
}

/// What gives two tasks, which have one name by this template, names of their own: all values that differ somewhere and that it does not tell.
fn telling_apart(rows: &Rows, by: &Template, out: &str, [first, second]: [usize; 2]) -> String {
    fn values(row: usize, rows_rows: &[Row]) -> &Vec<String> {
        &rows_rows[row].values
    }
    if values(first, &rows.rows) == values(second, &rows.rows) {
        return "the same values stand there twice: leave one of them out".into();
    }
    fn differs(index: usize, rows_rows: &[Row]) -> bool {
        let values = rows_rows.iter().map(|row| &row.values[index]);
        values.collect::<BTreeSet<_>>().len() > 1
    }
    let untold =
        (0..rows.names.len()).filter(|&index| !by.tells(index) && differs(index, &rows.rows));
    match String::from_iter(untold.map(|index| format!("_{{{}}}", rows.names[index].0))) {
        all_told if all_told.is_empty() => {
            "in names capital letters do not count, and one `-` stands for all that is no letter, digit, `.`, `_`, `+` or `-`".into()
        }
        untold => format!("name what differs: `out: {}`", quoted(&format!("{out}{untold}"))),
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

/// The schema of a sweep.
pub fn schema() -> serde_json::Value {
    schemars::schema_for!(File).into()
}

/// The words of sweeps.
pub fn words() -> Vec<Word> {
    fn of(within: &str, schema: schemars::Schema) -> Vec<Word> {
        words_of_fields("sweep", within, &schema.into())
    }
    let axes: serde_json::Value = schemars::schema_for!(Axis).into();
    let mut words = of("Sweep", schemars::schema_for!(File));
    words.extend(of("picture", schemars::schema_for!(Picture)));
    words.extend(words_of_choices("sweep", "over", &axes));
    words
}
