//! Test files. A test file names the graphs to test, the values of their parameters, and the tolerances of their outputs.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use maquette_graph::Expectation;
use maquette_graph::catalog::Catalog;
use maquette_syntax::error::{Diagnostic, Source, Span, code};
use maquette_syntax::paths::{MARKER, PathError, may_read, project_root};
use maquette_syntax::{
    Body, Help, Kind, LocalDiagnostic, ReadText, SourceMap, Tree, UncertainParts, Walk,
    duplicate_files, duplicate_keys, nearest_or_all, parse, read_tree,
};
use maquette_value::fs;
use schemars::JsonSchema;
use serde::Deserialize;

use super::compare::{Keep, Tolerance};
use super::recover::remove_faulty;

mod fields;

use fields::{Fields, POSITION_FIELDS, known_fields};

/// The extension of test files.
pub const EXTENSION: &str = ".test.ron";

/// A test file.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Test {
    /// Path of the graph to test, relative to this file. A `*` in the file name stands for any characters; then all matching graphs are
    /// tested.
    graph: String,
    /// Cases by name; `{"default": ()}` if omitted.
    #[serde(default)]
    cases: BTreeMap<String, Case>,
    /// Tolerance of each output, by its file name.
    #[serde(default)]
    compare: BTreeMap<String, Tolerance>,
    /// Expectations of each case, in addition to those of the graph.
    #[serde(default)]
    expect: Vec<Expectation>,
    /// Limits of time and memory of a case.
    #[serde(default)]
    budget: Budget,
}

/// One case of a test.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Case {
    /// Values of parameters (`name`) and fields (`node.field`), as with `--set`.
    set: BTreeMap<String, serde_json::Value>,
    /// Files with the values of the graph's inputs, relative to the folder of the test, as with `--input`.
    inputs: BTreeMap<String, String>,
    /// Reason for skipping the case. If omitted, the case runs.
    pub(crate) skip: Option<String>,
}

/// Limits of time and memory of a case.
#[derive(Clone, Copy, Debug, Default, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Budget {
    /// Maximum allowed time of all nodes together. Nodes whose results come from the cache take no time.
    #[schemars(range(min = 0.0), extend("unit" = "s"))]
    pub(crate) seconds: Option<f64>,
    /// Maximum allowed memory of all results together, cached or not. Memory that a node needs only while it runs is not counted.
    #[schemars(range(min = 0.0), extend("unit" = "MB"))]
    pub(crate) memory: Option<f64>,
}

/// A test file that has been read.
pub struct TestFile {
    pub(crate) source: Arc<Source>,
    /// The paths of the graphs to test.
    pub graphs: Vec<PathBuf>,
    pub(crate) cases: Vec<(String, TestCase)>,
    pub(crate) compare: Vec<OutputTolerance>,
    /// The expectations that the test adds to those of its graphs, each with its syntax tree.
    pub(crate) expect: Vec<(Expectation, Tree)>,
    pub(crate) budget: Budget,
    /// The parts of the file whose meaning is unclear because of syntax errors near them.
    pub(crate) uncertain_parts: UncertainParts,
}

pub(crate) struct TestCase {
    pub(crate) span: Span,
    pub(crate) set: Vec<(String, String)>,
    /// The files with the values of the graph's inputs, by the name of the input.
    pub(crate) inputs: Vec<(String, PathBuf)>,
    pub(crate) skip: Option<String>,
}

/// The tolerance of an output, as the test file states it.
pub(crate) struct OutputTolerance {
    pub(crate) output: String,
    /// The name of the value type, which the test file writes before the parentheses, as in `Mesh(max: 0.02)`.
    pub(crate) kind: String,
    pub(crate) kind_span: Span,
    pub(crate) span: Span,
    pub(crate) tolerance: Tolerance,
}

/// The value type that a test file names for an output.
struct OutputKind {
    output: String,
    kind: String,
    kind_span: Span,
    span: Span,
}

/// Reads a test file, or returns all of its errors. The catalog provides the value types, on which the possible tolerances depend.
pub(crate) fn read(path: &Path, catalog: &Catalog) -> Result<TestFile, Vec<Diagnostic>> {
    require_no_diagnostics(read_with(path, fs::read_text_no_follow(path), &known_fields(catalog)))
}

/// Parses the text of a test file. Returns the test without its faulty parts (`None` if nothing is left), and all errors.
pub fn read_text(
    path: &Path,
    text: String,
    catalog: &Catalog,
) -> (Option<TestFile>, Vec<Diagnostic>) {
    read_with(path, Ok(text), &known_fields(catalog))
}

fn require_no_diagnostics(
    (test, diagnostics): (Option<TestFile>, Vec<Diagnostic>),
) -> Result<TestFile, Vec<Diagnostic>> {
    test.filter(|_| diagnostics.is_empty()).ok_or(diagnostics)
}

/// Reads a test file without checking its tolerances against the value types. Returns `None` if the file has errors.
pub fn skim(path: &Path) -> Option<TestFile> {
    require_no_diagnostics(read_with(path, fs::read_text_no_follow(path), &|_| {
        Ok(&POSITION_FIELDS)
    }))
    .ok()
}

fn read_with(
    path: &Path,
    text: std::io::Result<String>,
    fields: &Fields<'_>,
) -> (Option<TestFile>, Vec<Diagnostic>) {
    let (text, unread) = match text {
        Ok(text) => (text, None),
        Err(error) => (String::new(), Some(format!("cannot read the test: {error}"))),
    };
    let source = Arc::new(Source { name: path.to_owned(), text });
    let mut diagnostics = Vec::new();
    let test = match unread {
        Some(message) => {
            diagnostics.push(diagnostic(code::MISSING_FILE, Span::default(), message, ""));
            None
        }
        None => read_source(path, &source, fields, &mut diagnostics),
    };
    diagnostics.sort_by_key(|it| it.span);
    (test, diagnostics.into_iter().map(|it| it.into_diagnostic(&source)).collect())
}

fn diagnostic(
    code: &'static str,
    span: Span,
    message: String,
    help: impl Into<Help>,
) -> LocalDiagnostic {
    LocalDiagnostic { code, span, message, help: help.into(), note: None }
}

/// Parses as much of a test file as possible. Faulty parts are left out.
fn read_source(
    path: &Path,
    source: &Arc<Source>,
    fields: &Fields<'_>,
    diagnostics: &mut Vec<LocalDiagnostic>,
) -> Option<TestFile> {
    let parsed = parse(&source.text);
    let is_empty = parsed.0.is_broken();
    let begin = "begin with `Test(graph: \"name.ron\")`";
    let sheet = SourceMap::new(source.clone(), PathBuf::new());
    let ReadText { tree, errors, uncertain_parts } = ReadText::new(&sheet, parsed, &["Test"]);
    diagnostics.extend(errors.into_iter().map(|error: maquette_syntax::SyntaxError| {
        match error.span.start {
            // If the text is empty, report only this error.
            0 if is_empty => diagnostic(code::SYNTAX, error.span, error.message, begin),
            _ => diagnostic(code::SYNTAX, error.span, error.message, error.help),
        }
    }));
    let mut test = test_of(path, source, tree?, fields, diagnostics);
    if let Some(uncertain_parts) = uncertain_parts {
        diagnostics.retain(|it| !uncertain_parts.covers(it.code, (source, it.span), &it.message));
        if let Some(test) = &mut test {
            test.cases
                .iter_mut()
                .for_each(|(_, case)| case.set.retain(|(_, text)| parse(text).1.is_empty()));
            test.uncertain_parts = uncertain_parts;
        }
    }
    test
}

fn test_of(
    path: &Path,
    source: &Arc<Source>,
    mut tree: Tree,
    fields: &Fields<'_>,
    diagnostics: &mut Vec<LocalDiagnostic>,
) -> Option<TestFile> {
    if tree.name().is_none_or(|name| name.text != "Test") {
        let message = format!("expected Test(..), found {}", tree.describe());
        let begin = "begin with `Test(graph: \"name.ron\")`";
        diagnostics.push(diagnostic(code::SYNTAX, tree.span, message, begin));
        return None;
    }
    let kinds = take_kinds(&mut tree, fields, diagnostics);
    let mut wrong = Vec::new();
    if let Kind::Call { body: Body::Fields(fields), .. } = &mut tree.kind
        && let Some(expect) = fields.iter_mut().find(|field| field.name.text == "expect")
    {
        let (plain, misfits) = Expectation::in_plain_numbers(&expect.value);
        expect.value = plain;
        wrong.extend(misfits);
    }
    let schema = serde_json::to_value(schemars::schema_for!(Test)).unwrap_or_default();
    let mut walk = Walk {
        node: "Test",
        root: &schema,
        source_map: None,
        diagnostics: Vec::new(),
        links: Vec::new(),
        files: Vec::new(),
    };
    walk.node(&tree);
    wrong.append(&mut walk.diagnostics);
    wrong.extend(duplicates(&tree));
    diagnostics.extend(invalid_case_names(&tree));
    remove_faulty(&mut tree, &wrong);
    diagnostics.append(&mut wrong);
    let test: Test = match read_tree(&tree) {
        Ok(test) => test,
        // This error comes from a missing field, which is already reported above.
        Err(_) if !diagnostics.is_empty() => return None,
        Err(error) => {
            let span = error.span.unwrap_or(tree.span);
            diagnostics.push(diagnostic(code::WRONG_VALUE, span, error.message, ""));
            return None;
        }
    };
    let folder = path.parent().unwrap_or(Path::new(""));
    let graphs = graphs(folder, &test.graph).unwrap_or_else(|problem| {
        let span = field(&tree, "graph").map_or(tree.span, |tree| tree.span);
        diagnostics.push(match problem {
            PathError::Outside { message, .. } => {
                let help =
                    format!("move it into the project, or put a {MARKER} into a folder above both");
                diagnostic(code::OUTSIDE, span, message, help)
            }
            PathError::Missing { message, help } => {
                diagnostic(code::MISSING_FILE, span, message, help)
            }
        });
        Vec::new()
    });
    let mut cases = cases(&tree, &test, &source.text, folder);
    diagnostics.extend(missing_inputs(&tree, folder));
    diagnostics.extend(skips_without_reason(&tree));
    if cases.is_empty() {
        let span = tree.span;
        cases.push((
            "default".to_owned(),
            TestCase { span, set: Vec::new(), inputs: Vec::new(), skip: None },
        ));
    }
    let items = match field(&tree, "expect").map(|tree| &tree.kind) {
        Some(Kind::List(items)) => items.clone(),
        _ => Vec::new(),
    };
    let compare = test.compare;
    for OutputKind { output, span, .. } in &kinds {
        if compare.get(output).is_some_and(|most| most.remeshed && most.keep != Keep::Whole) {
            let message = format!("`{output}` is compared as a surface, which needs all entries");
            let help = "remove `remeshed` or `keep`";
            diagnostics.push(diagnostic(code::WRONG_VALUE, *span, message, help));
        }
        if let Some((message, help)) = compare.get(output).and_then(Tolerance::contradiction) {
            diagnostics.push(diagnostic(code::WRONG_VALUE, *span, message, help));
        }
    }
    let allowed = kinds.into_iter().filter_map(|OutputKind { output, kind, kind_span, span }| {
        let tolerance = compare.get(&output)?.clone();
        Some(OutputTolerance { output, kind, kind_span, span, tolerance })
    });
    Some(TestFile {
        source: source.clone(),
        graphs,
        cases,
        compare: allowed.collect(),
        expect: test.expect.into_iter().zip(items).collect(),
        budget: test.budget,
        uncertain_parts: UncertainParts::default(),
    })
}

/// Returns an error for each input file that is missing or outside of the project.
fn missing_inputs(tree: &Tree, folder: &Path) -> Vec<LocalDiagnostic> {
    let here = canonical_folder(folder);
    let roots = [project_root(&here)];
    let cases = entries(tree, "cases");
    let inputs = cases.iter().flat_map(|(_, case)| entries(case, "inputs"));
    let wrong = inputs.filter_map(|(name, file)| {
        let given = file.text()?;
        let (code, message, help) = match may_read(given, &here.join(given), &roots).err()? {
            PathError::Outside { message, help } => (code::OUTSIDE, message, help),
            PathError::Missing { message, help } => (code::MISSING_FILE, message, help),
        };
        let message = format!("input `{}`: {message}", name.text()?);
        Some(diagnostic(code, file.span, message, help))
    });
    wrong.collect()
}

/// Returns an error for each case that is skipped without a reason.
fn skips_without_reason(tree: &Tree) -> Vec<LocalDiagnostic> {
    let cases = entries(tree, "cases");
    let skips = cases.iter().filter_map(|(_, case)| field(case, "skip"));
    let empty = skips.filter(|skip| skip.text().is_some_and(|why| why.trim().is_empty()));
    let wrong = empty.map(|skip| {
        let message = "expected a reason for skipping the case, found an empty text".into();
        let help = "add a reason, such as `skip: \"takes an hour\"`, or remove `skip`";
        diagnostic(code::WRONG_VALUE, skip.span, message, help)
    });
    wrong.collect()
}

/// Returns the keys and values of the map in the field `name` of a test or case.
fn entries(tree: &Tree, name: &str) -> Vec<(Tree, Tree)> {
    match field(tree, name).map(|tree| &tree.kind) {
        Some(Kind::Map(entries)) => entries.clone(),
        _ => Vec::new(),
    }
}

fn field<'t>(tree: &'t Tree, name: &str) -> Option<&'t Tree> {
    tree.fields()?.iter().find(|field| field.name.text == name).map(|field| &field.value)
}

/// Removes the value type from each tolerance: `Mesh(max: 0.02)` becomes `(max: 0.02)`, which can be parsed as a tolerance. Returns the
/// removed value types.
fn take_kinds(
    tree: &mut Tree,
    fields: &Fields<'_>,
    diagnostics: &mut Vec<LocalDiagnostic>,
) -> Vec<OutputKind> {
    let Kind::Call { body: Body::Fields(all), .. } = &mut tree.kind else { return Vec::new() };
    let compare = all.iter_mut().find(|field| field.name.text == "compare");
    let Some(Kind::Map(entries)) = compare.map(|field| &mut field.value.kind) else {
        return Vec::new();
    };
    let mut kinds = Vec::new();
    for (key, value) in entries {
        let Some(output) = key.text().map(str::to_owned) else { continue };
        let Some(name) = value.name() else {
            let message =
                format!("expected a tolerance for `{output}`, found {}", value.describe());
            let help = "write the type of the value: `Mesh(max: 0.01)`";
            diagnostics.push(diagnostic(code::WRONG_VALUE, value.span, message, help));
            continue;
        };
        let fields = match fields(&name.text) {
            Ok(fields) => fields,
            Err(known) => {
                value.kind = Kind::Broken;
                let message = format!("values of the type `{}` have no tolerance", name.text);
                let help = nearest_or_all(&name.text, "the types that have some", &known);
                diagnostics.push(diagnostic(code::WRONG_TYPE, name.span, message, help));
                continue;
            }
        };
        for given in value.fields().unwrap_or_default() {
            if !fields.contains(&&given.name.text[..]) {
                let message = format!("{} has no tolerance `{}`", name.text, given.name.text);
                let help = nearest_or_all(&given.name.text, "its tolerances", fields);
                diagnostics.push(diagnostic(code::UNKNOWN_FIELD, given.name.span, message, help));
            }
        }
        if let Kind::Call { name, body: Body::Fields(given) } = &mut value.kind {
            *name = None;
            given.retain(|given| fields.contains(&&given.name.text[..]));
        } else {
            value.kind = Kind::Call { name: None, body: Body::Empty };
        }
        kinds.push(OutputKind { output, kind: name.text, kind_span: name.span, span: key.span });
    }
    kinds
}

/// Returns the cases in the order of the file. The values that a case sets are kept as text, like the argument of the option `--set`.
fn cases(tree: &Tree, test: &Test, text: &str, folder: &Path) -> Vec<(String, TestCase)> {
    let Some(Kind::Map(entries)) = field(tree, "cases").map(|tree| &tree.kind) else {
        return Vec::new();
    };
    let mut cases = Vec::new();
    for (key, value) in entries {
        let Some(name) = key.text() else { continue };
        let inputs = test.cases.get(name).map(|case| &case.inputs).into_iter().flatten();
        let inputs = inputs.map(|(name, file)| (name.clone(), folder.join(file))).collect();
        let set = match field(value, "set").map(|tree| &tree.kind) {
            Some(Kind::Map(entries)) => entries
                .iter()
                .filter_map(|(key, value)| {
                    Some((
                        key.text()?.to_owned(),
                        text[value.span.start..value.span.end].to_owned(),
                    ))
                })
                .collect(),
            _ => Vec::new(),
        };
        let skip = test.cases.get(name).and_then(|case| case.skip.clone());
        cases.push((name.to_owned(), TestCase { span: key.span, set, inputs, skip }));
    }
    cases
}

/// Returns an error for each case whose name cannot be the name of a folder. The goldens of a case are stored in a folder with its name.
fn invalid_case_names(tree: &Tree) -> Vec<LocalDiagnostic> {
    let Some(Kind::Map(entries)) = field(tree, "cases").map(|tree| &tree.kind) else {
        return Vec::new();
    };
    fn is_plain(name: &str) -> bool {
        !name.is_empty()
            && !name.starts_with('.')
            && !name.contains(|c: char| c.is_control() || matches!(c, '/' | '\\' | ':'))
    }
    let names = entries.iter().filter_map(|(key, _)| Some((key.text()?, key.span)));
    let wrong = names.filter(|(name, _)| !is_plain(name));
    let wrong = wrong.map(|(name, span)| {
        let message = format!("`{name}` cannot name a case");
        let help =
            "its goldens are in a folder of this name: use no `/`, `\\`, `:`, and no leading dot";
        diagnostic(code::BAD_NAME, span, message, help)
    });
    wrong.collect()
}

/// Returns the absolute path of a folder, so that the folders above it can be searched for the root of the project.
fn canonical_folder(folder: &Path) -> PathBuf {
    let here = if folder == Path::new("") { Path::new(".") } else { folder };
    std::fs::canonicalize(here).unwrap_or_else(|_| here.to_owned())
}

/// Returns an error for each key that occurs twice in a map. Duplicate fields are reported elsewhere.
fn duplicates(tree: &Tree) -> Vec<LocalDiagnostic> {
    let cases = entries(tree, "cases");
    let of_cases = cases.iter().flat_map(|(_, case)| {
        [
            duplicate_keys(&entries(case, "set"), "value"),
            duplicate_keys(&entries(case, "inputs"), "input"),
        ]
        .concat()
    });
    let compared = duplicate_keys(&entries(tree, "compare"), "output");
    let one_file = duplicate_files(&cases, "cases");
    duplicate_keys(&cases, "case")
        .into_iter()
        .chain(one_file)
        .chain(of_cases)
        .chain(compared)
        .collect()
}

/// Returns the graphs whose paths match a pattern, sorted. The pattern may contain one `*`, in its last part. Returns an error if no graph
/// matches, or if a matching graph is outside of the project.
fn graphs(folder: &Path, pattern: &str) -> Result<Vec<PathBuf>, PathError> {
    let here = canonical_folder(folder);
    let roots = [project_root(&here)];
    fn may_be_read(given: &str, here: &Path, roots: &[PathBuf; 1]) -> Result<(), PathError> {
        may_read(given, &here.join(given), roots)
    }
    fn missing(pattern: &str) -> PathError {
        PathError::Missing {
            message: format!("there is no graph `{pattern}`"),
            help: "the path is relative to the test".into(),
        }
    }
    let path = folder.join(pattern);
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let Some((start, end)) = name.split_once('*') else {
        return match may_be_read(pattern, &here, &roots) {
            Ok(()) => Ok(vec![path]),
            Err(PathError::Missing { .. }) if !path.exists() => Err(missing(pattern)),
            Err(problem) => Err(problem),
        };
    };
    if let Err(outside @ PathError::Outside { .. }) = may_be_read(pattern, &here, &roots) {
        return Err(outside);
    }
    let beside = path.parent().filter(|beside| *beside != Path::new(""));
    let files = std::fs::read_dir(beside.unwrap_or(Path::new("."))).into_iter().flatten().flatten();
    let files = files.map(|file| path.with_file_name(file.file_name()));
    let mut graphs: Vec<PathBuf> = files
        .filter(|path| {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            let long = start.len() + end.len() <= name.len();
            long && name.starts_with(start) && name.ends_with(end) && !name.ends_with(EXTENSION)
        })
        .collect();
    graphs.sort();
    for graph in &graphs {
        may_be_read(&graph.strip_prefix(folder).unwrap_or(graph).to_string_lossy(), &here, &roots)?;
    }
    if graphs.is_empty() { Err(missing(pattern)) } else { Ok(graphs) }
}

/// Returns all test files in a folder and its subfolders, sorted. If the path is not a folder, returns the path itself. Links to folders
/// are not followed, because they may form a cycle.
pub fn find(path: &Path) -> Vec<PathBuf> {
    if !path.is_dir() {
        return vec![path.to_owned()];
    }
    let mut found = Vec::new();
    for entry in std::fs::read_dir(path).into_iter().flatten().flatten() {
        let (path, name) = (entry.path(), entry.file_name().to_string_lossy().into_owned());
        let is_folder = entry.file_type().is_ok_and(|kind| kind.is_dir());
        if is_folder && !name.starts_with('.') && name != "target" && name != "out" {
            found.extend(find(&path));
        } else if !is_folder && name.ends_with(EXTENSION) {
            found.push(path);
        }
    }
    found.sort();
    found
}

/// Returns the test files that are directly in a folder, sorted.
pub(crate) fn test_files_in(folder: &Path) -> Vec<PathBuf> {
    let here = if folder == Path::new("") { Path::new(".") } else { folder };
    let files = std::fs::read_dir(here).into_iter().flatten().flatten();
    let files = files.map(|file| folder.join(file.file_name()));
    let mut tests: Vec<_> =
        files.filter(|path| path.to_string_lossy().ends_with(EXTENSION)).collect();
    tests.sort();
    tests
}

/// Returns the test files that test a graph. They are in the folder of the graph or, if that has no test files, in the nearest folder above
/// it that has some.
pub fn tests_of(graph: &Path) -> Vec<PathBuf> {
    let Ok(wanted) = graph.canonicalize() else { return Vec::new() };
    for folder in graph.ancestors().skip(1) {
        let tests: Vec<_> = test_files_in(folder)
            .into_iter()
            .filter(|path| {
                skim(path).is_some_and(|test: TestFile| {
                    test.graphs.iter().any(|graph| is_same(graph, &wanted))
                })
            })
            .collect();
        if !tests.is_empty() {
            return tests;
        }
    }
    Vec::new()
}

/// Returns the paths by which a test file refers to the graph file `graph`. There may be several, for example through symbolic links.
pub fn graph_of(test: &Path, graph: &Path) -> Vec<PathBuf> {
    let (Some(test), Ok(wanted)) = (skim(test), graph.canonicalize()) else { return Vec::new() };
    test.graphs.into_iter().filter(|graph| is_same(graph, &wanted)).collect()
}

/// Returns true if two paths lead to the same file.
fn is_same(path: &Path, file: &Path) -> bool {
    path.canonicalize().is_ok_and(|path| path == file)
}

/// Returns the JSON schema of test files.
pub fn test_schema() -> serde_json::Value {
    schemars::schema_for!(Test).into()
}

/// Returns the keywords of test files, with their documentation.
pub fn words() -> Vec<maquette_graph::Word> {
    use maquette_graph::{words_of_choices, words_of_fields};
    fn fields(within: &str, schema: schemars::Schema) -> Vec<maquette_graph::Word> {
        words_of_fields("test", within, &schema.into())
    }
    let mut words = fields("Test", schemars::schema_for!(Test));
    words.extend(fields("cases", schemars::schema_for!(Case)));
    words.extend(fields("budget", schemars::schema_for!(Budget)));
    words.extend(fields("compare", schemars::schema_for!(Tolerance)));
    words.extend(words_of_choices("test", "keep", &schemars::schema_for!(Keep).into()));
    words
}

#[cfg(test)]
mod tests {
    use super::*;

    fn diagnostics(text: &str) -> Vec<String> {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("doll.ron"), "").unwrap();
        let path = folder.path().join("doll.test.ron");
        std::fs::write(&path, text).unwrap();
        let diagnostics = read(&path, &Catalog::new(&[])).err().unwrap_or_default();
        diagnostics
            .iter()
            .map(|problem| {
                let place = maquette_syntax::error::Position::from_offset(
                    &problem.source.text,
                    problem.span.start,
                );
                format!("{}:{} {} {}", place.line, place.column, problem.code, problem.message)
            })
            .collect()
    }

    #[test]
    fn a_complete_test_is_read() {
        let text = r#"Test(
            graph: "doll.ron",
            cases: {"default": (), "long": (set: {"growth": 25.0, "red.select": Near(color: "x")})},
            compare: {"model.ply": Mesh(max: 0.02, rms: 0.004, attributes: {"uv": 1e-4}), "a.png": Image(differing: 0.0)},
            expect: [Closed("skin"), Near(of: "skin", to: "grid", max: 2.0)],
            budget: (seconds: 2.0),
        )"#;
        assert_eq!(diagnostics(text), [""; 0]);
    }

    #[test]
    fn every_error_is_reported_at_its_position() {
        let text = "Test(\n graph: \"doll.ron\",\n case: {},\n compare: {\n  \"a.ply\": Mesh(maxx: 1.0),\n  \"b\": Image(rms: 1.0),\n  \"c\": Msh(max: 1.0),\n },\n expect: [Closd(\"x\")],\n)";
        assert_eq!(
            diagnostics(text),
            [
                "3:2 G004 Test has no field `case`",
                "5:17 G004 Mesh has no tolerance `maxx`",
                "6:14 G004 Image has no tolerance `rms`",
                "7:8 G012 values of the type `Msh` have no tolerance",
                "9:11 G009 field `expect` of Test has no choice `Closd`",
            ]
        );
        assert_eq!(
            diagnostics("Test(graph: \"dol.ron\")"),
            ["1:13 G013 there is no graph `dol.ron`"]
        );
        assert_eq!(diagnostics("Graph()"), ["1:1 G001 expected Test(..), found `Graph(..)`"]);
    }
}
