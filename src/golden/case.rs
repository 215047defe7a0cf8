//! Test files: which graphs, with which parameters, and how much their outputs may differ from what they were.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use maquette_graph::Expectation;
use maquette_graph::catalog::Catalog;
use maquette_syntax::error::{Problem, Source, Span, code};
use maquette_syntax::paths::{MARKER, PathProblem, may_read, project_root};
use maquette_syntax::{
    Body, Doubts, Finding, Help, Kind, ReadText, Sheet, Tree, Walk, nearest_or_all, one_file_twice,
    parse, read_tree, twice,
};
use maquette_value::plain;
use schemars::JsonSchema;
use serde::Deserialize;

use super::compare::{Keep, Tolerance};
use super::sound::keep_sound;

mod fields;

use fields::{Fields, OF_PLACES, known_fields};

/// The ending of a test file's name.
pub const ENDING: &str = ".test.ron";

/// A test file as it is written.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Test {
    /// The graph, relative to this file. A `*` in its name stands for anything: then each graph is tested.
    graph: String,
    /// What is tested, by name; `{"default": ()}` if left out.
    #[serde(default)]
    cases: BTreeMap<String, Case>,
    /// How much each output may differ, by its file name.
    #[serde(default)]
    compare: BTreeMap<String, Tolerance>,
    /// What must hold of each case, beside what the graph itself expects.
    #[serde(default)]
    expect: Vec<Expectation>,
    /// How much a case may use.
    #[serde(default)]
    budget: Budget,
}

/// One case of a test.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Case {
    /// Values of parameters (`name`) and fields (`node.field`), as with `--set`.
    set: BTreeMap<String, serde_json::Value>,
    /// Files with the values of the graph's inputs, relative to the test's folder, as with `--input`.
    inputs: BTreeMap<String, String>,
    /// The reason why it is not run now; it runs if this is left out.
    pub(crate) skip: Option<String>,
}

/// How much a case may use.
#[derive(Clone, Copy, Debug, Default, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Budget {
    /// The time of all nodes together. Nodes whose results come from the cache take none.
    #[schemars(range(min = 0.0), extend("unit" = "s"))]
    pub(crate) seconds: Option<f64>,
    /// The memory of all nodes' results together, cached or not: what is held while a graph is worked on. What a node needs only
    /// while it runs is not counted.
    #[schemars(range(min = 0.0), extend("unit" = "MB"))]
    pub(crate) memory: Option<f64>,
}

/// The file of a test, read.
pub struct TestFile {
    pub(crate) source: Arc<Source>,
    /// The graphs that it is about.
    pub graphs: Vec<PathBuf>,
    pub(crate) cases: Vec<(String, TestCase)>,
    pub(crate) compare: Vec<Allowed>,
    /// What must hold, and where that stands.
    pub(crate) expect: Vec<(Expectation, Tree)>,
    pub(crate) budget: Budget,
    /// What cannot be read for sure, because of syntax errors.
    pub(crate) doubts: Doubts,
}

pub(crate) struct TestCase {
    pub(crate) span: Span,
    pub(crate) set: Vec<(String, String)>,
    /// The files of inputs, by their names.
    pub(crate) inputs: Vec<(String, PathBuf)>,
    pub(crate) skip: Option<String>,
}

/// How much an output may differ.
pub(crate) struct Allowed {
    pub(crate) output: String,
    /// The type of value that is written before the parentheses, with its place.
    pub(crate) kind: String,
    pub(crate) kind_span: Span,
    pub(crate) span: Span,
    pub(crate) tolerance: Tolerance,
}

/// The test of a test file, or every problem of it; the catalog knows the types of values.
pub(crate) fn read(path: &Path, catalog: &Catalog) -> Result<TestFile, Vec<Problem>> {
    whole(read_with(path, plain::read_own_text(path), &known_fields(catalog)))
}

/// The same for a text that stands, or will stand, in the file: every problem, and what is left of the test without what is wrong.
pub fn read_text(path: &Path, text: String, catalog: &Catalog) -> (Option<TestFile>, Vec<Problem>) {
    read_with(path, Ok(text), &known_fields(catalog))
}

fn whole((test, problems): (Option<TestFile>, Vec<Problem>)) -> Result<TestFile, Vec<Problem>> {
    test.filter(|_| problems.is_empty()).ok_or(problems)
}

/// The same without judging which tolerances make sense: to know what it is about.
pub fn skim(path: &Path) -> Option<TestFile> {
    whole(read_with(path, plain::read_own_text(path), &|_| Ok(&OF_PLACES))).ok()
}

fn read_with(
    path: &Path,
    text: std::io::Result<String>,
    fields: &Fields<'_>,
) -> (Option<TestFile>, Vec<Problem>) {
    let (text, unread) = match text {
        Ok(text) => (text, None),
        Err(error) => (String::new(), Some(format!("cannot read the test: {error}"))),
    };
    let source = Arc::new(Source { name: path.to_owned(), text });
    let mut findings = Vec::new();
    let test = match unread {
        Some(message) => {
            findings.push(finding(code::MISSING_FILE, Span::default(), message, ""));
            None
        }
        None => read_source(path, &source, fields, &mut findings),
    };
    findings.sort_by_key(|finding| finding.span);
    (test, findings.into_iter().map(|finding| finding.at(&source)).collect())
}

fn finding(code: &'static str, span: Span, message: String, help: impl Into<Help>) -> Finding {
    Finding { code, span, message, help: help.into(), note: None }
}

/// What can be read of a test, without what is found to be wrong.
fn read_source(
    path: &Path,
    source: &Arc<Source>,
    fields: &Fields<'_>,
    findings: &mut Vec<Finding>,
) -> Option<TestFile> {
    let parsed = parse(&source.text);
    let is_empty = parsed.0.is_broken();
    let begin = "begin with `Test(graph: \"name.ron\")`";
    let sheet = Sheet::new(source.clone(), PathBuf::new());
    let ReadText { tree, mistakes, doubts } = ReadText::new(&sheet, parsed, &["Test"]);
    findings.extend(mistakes.into_iter().map(|m: maquette_syntax::Mistake| match m.span.start {
        // The only mistake of a text with nothing in it.
        0 if is_empty => finding(code::SYNTAX, m.span, m.message, begin),
        _ => finding(code::SYNTAX, m.span, m.message, m.help),
    }));
    let mut test = test_of(path, source, tree?, fields, findings);
    if let Some(doubts) = doubts {
        findings.retain(|it| !doubts.cover(it.code, (source, it.span), &it.message));
        if let Some(test) = &mut test {
            test.cases
                .iter_mut()
                .for_each(|(_, case)| case.set.retain(|(_, text)| parse(text).1.is_empty()));
            test.doubts = doubts;
        }
    }
    test
}

fn test_of(
    path: &Path,
    source: &Arc<Source>,
    mut tree: Tree,
    fields: &Fields<'_>,
    findings: &mut Vec<Finding>,
) -> Option<TestFile> {
    if tree.name().is_none_or(|name| name.text != "Test") {
        let message = format!("a test file holds Test(..), not {}", tree.in_words());
        let begin = "begin with `Test(graph: \"name.ron\")`";
        findings.push(finding(code::SYNTAX, tree.span, message, begin));
        return None;
    }
    let kinds = take_kinds(&mut tree, fields, findings);
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
        sheet: None,
        findings: Vec::new(),
        links: Vec::new(),
        files: Vec::new(),
    };
    walk.node(&tree);
    wrong.append(&mut walk.findings);
    wrong.extend(duplicates(&tree));
    findings.extend(no_names(&tree));
    keep_sound(&mut tree, &wrong);
    findings.append(&mut wrong);
    let test: Test = match read_tree(&tree) {
        Ok(test) => test,
        // What is missing then has been told.
        Err(_) if !findings.is_empty() => return None,
        Err(error) => {
            let span = error.span.unwrap_or(tree.span);
            findings.push(finding(code::WRONG_VALUE, span, error.message, ""));
            return None;
        }
    };
    let folder = path.parent().unwrap_or(Path::new(""));
    let graphs = graphs(folder, &test.graph).unwrap_or_else(|problem| {
        let span = field(&tree, "graph").map_or(tree.span, |tree| tree.span);
        findings.push(match problem {
            PathProblem::Outside { message, .. } => {
                let help =
                    format!("move it into the project, or put a {MARKER} into a folder above both");
                finding(code::OUTSIDE, span, message, help)
            }
            PathProblem::Missing { message, help } => {
                finding(code::MISSING_FILE, span, message, help)
            }
        });
        Vec::new()
    });
    let mut cases = cases(&tree, &test, &source.text, folder);
    findings.extend(missing_inputs(&tree, folder));
    findings.extend(skips_without_reason(&tree));
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
    for (output, _, _, span) in &kinds {
        if compare.get(output).is_some_and(|most| most.remeshed && most.keep != Keep::Whole) {
            let message = format!(
                "`{output}` is to be compared as a surface, of which some entries tell nothing"
            );
            let help = "leave `remeshed` or `keep` out";
            findings.push(finding(code::WRONG_VALUE, *span, message, help));
        }
        if let Some((message, help)) = compare.get(output).and_then(Tolerance::contradiction) {
            findings.push(finding(code::WRONG_VALUE, *span, message, help));
        }
    }
    let allowed = kinds.into_iter().filter_map(|(output, kind, kind_span, span)| {
        let tolerance = compare.get(&output)?.clone();
        Some(Allowed { output, kind, kind_span, span, tolerance })
    });
    Some(TestFile {
        source: source.clone(),
        graphs,
        cases,
        compare: allowed.collect(),
        expect: test.expect.into_iter().zip(items).collect(),
        budget: test.budget,
        doubts: Doubts::default(),
    })
}

/// Files of inputs that are not there, or out of the project.
fn missing_inputs(tree: &Tree, folder: &Path) -> Vec<Finding> {
    let here = real(folder);
    let roots = [project_root(&here)];
    let cases = entries(tree, "cases");
    let inputs = cases.iter().flat_map(|(_, case)| entries(case, "inputs"));
    let wrong = inputs.filter_map(|(name, file)| {
        let given = file.text()?;
        let (code, message, help) = match may_read(given, &here.join(given), &roots).err()? {
            PathProblem::Outside { message, help } => (code::OUTSIDE, message, help),
            PathProblem::Missing { message, help } => (code::MISSING_FILE, message, help),
        };
        let message = format!("input `{}`: {message}", name.text()?);
        Some(finding(code, file.span, message, help))
    });
    wrong.collect()
}

/// Cases that are skipped for no reason: nobody would know when to run them again.
fn skips_without_reason(tree: &Tree) -> Vec<Finding> {
    let cases = entries(tree, "cases");
    let skips = cases.iter().filter_map(|(_, case)| field(case, "skip"));
    let empty = skips.filter(|skip| skip.text().is_some_and(|why| why.trim().is_empty()));
    let wrong = empty.map(|skip| {
        let message = "expected the reason why the case is skipped, found an empty text".into();
        let help = "say why, as `skip: \"takes an hour\"`, or leave `skip` out";
        finding(code::WRONG_VALUE, skip.span, message, help)
    });
    wrong.collect()
}

/// What stands in a map of a test or case.
fn entries(tree: &Tree, name: &str) -> Vec<(Tree, Tree)> {
    match field(tree, name).map(|tree| &tree.kind) {
        Some(Kind::Map(entries)) => entries.clone(),
        _ => Vec::new(),
    }
}

fn field<'t>(tree: &'t Tree, name: &str) -> Option<&'t Tree> {
    tree.fields()?.iter().find(|field| field.name.text == name).map(|field| &field.value)
}

/// Takes `Mesh` off `Mesh(max: 0.02)`, so that what is left reads as a tolerance; gives back output, type and both places.
fn take_kinds(
    tree: &mut Tree,
    fields: &Fields<'_>,
    findings: &mut Vec<Finding>,
) -> Vec<(String, String, Span, Span)> {
    let Kind::Call { body: Body::Fields(all), .. } = &mut tree.kind else { return Vec::new() };
    let compare = all.iter_mut().find(|field| field.name.text == "compare");
    let Some(Kind::Map(entries)) = compare.map(|field| &mut field.value.kind) else {
        return Vec::new();
    };
    let mut kinds = Vec::new();
    for (key, value) in entries {
        let Some(output) = key.text().map(str::to_owned) else { continue };
        let Some(name) = value.name() else {
            let message = format!("`{output}` is compared as {}", value.in_words());
            let help = "write the type of the value: `Mesh(max: 0.01)`";
            findings.push(finding(code::WRONG_VALUE, value.span, message, help));
            continue;
        };
        let fields = match fields(&name.text) {
            Ok(fields) => fields,
            Err(known) => {
                value.kind = Kind::Broken;
                let message = format!("values of the type `{}` have no tolerance", name.text);
                let help = nearest_or_all(&name.text, "those that have", &known);
                findings.push(finding(code::WRONG_TYPE, name.span, message, help));
                continue;
            }
        };
        for given in value.fields().unwrap_or_default() {
            if !fields.contains(&&given.name.text[..]) {
                let message = format!("{} has no tolerance `{}`", name.text, given.name.text);
                let help = nearest_or_all(&given.name.text, "its tolerances", fields);
                findings.push(finding(code::UNKNOWN_FIELD, given.name.span, message, help));
            }
        }
        if let Kind::Call { name, body: Body::Fields(given) } = &mut value.kind {
            *name = None;
            given.retain(|given| fields.contains(&&given.name.text[..]));
        } else {
            value.kind = Kind::Call { name: None, body: Body::Empty };
        }
        kinds.push((output, name.text, name.span, key.span));
    }
    kinds
}

/// The cases in the order of the file. What is set is taken as text, as `--set` takes it.
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

/// Names of cases that are no names of folders: goldens lie in folders of these names.
fn no_names(tree: &Tree) -> Vec<Finding> {
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
            "its goldens lie in a folder of this name: no `/`, `\\`, `:`, and no dot in front";
        finding(code::BAD_NAME, span, message, help)
    });
    wrong.collect()
}

/// A folder as it is reached from anywhere: only so a project is found above it.
fn real(folder: &Path) -> PathBuf {
    let here = if folder == Path::new("") { Path::new(".") } else { folder };
    std::fs::canonicalize(here).unwrap_or_else(|_| here.to_owned())
}

/// What stands twice where each name stands once; of fields this is known already.
fn duplicates(tree: &Tree) -> Vec<Finding> {
    let cases = entries(tree, "cases");
    let of_cases = cases.iter().flat_map(|(_, case)| {
        [twice(&entries(case, "set"), "value"), twice(&entries(case, "inputs"), "input")].concat()
    });
    let compared = twice(&entries(tree, "compare"), "output");
    let one_file = one_file_twice(&cases, "cases");
    twice(&cases, "case").into_iter().chain(one_file).chain(of_cases).chain(compared).collect()
}

/// The graphs that a name with at most one `*` in its last part stands for, sorted; where one lies out of the project, or there is
/// none, why.
fn graphs(folder: &Path, pattern: &str) -> Result<Vec<PathBuf>, PathProblem> {
    let here = real(folder);
    let roots = [project_root(&here)];
    fn may_be_read(given: &str, here: &Path, roots: &[PathBuf; 1]) -> Result<(), PathProblem> {
        may_read(given, &here.join(given), roots)
    }
    fn missing(pattern: &str) -> PathProblem {
        PathProblem::Missing {
            message: format!("there is no graph `{pattern}`"),
            help: "the path is relative to the test".into(),
        }
    }
    let path = folder.join(pattern);
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let Some((start, end)) = name.split_once('*') else {
        return match may_be_read(pattern, &here, &roots) {
            Ok(()) => Ok(vec![path]),
            Err(PathProblem::Missing { .. }) if !path.exists() => Err(missing(pattern)),
            Err(problem) => Err(problem),
        };
    };
    if let Err(outside @ PathProblem::Outside { .. }) = may_be_read(pattern, &here, &roots) {
        return Err(outside);
    }
    let beside = path.parent().filter(|beside| *beside != Path::new(""));
    let files = std::fs::read_dir(beside.unwrap_or(Path::new("."))).into_iter().flatten().flatten();
    let files = files.map(|file| path.with_file_name(file.file_name()));
    let mut graphs: Vec<PathBuf> = files
        .filter(|path| {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            let long = start.len() + end.len() <= name.len();
            long && name.starts_with(start) && name.ends_with(end) && !name.ends_with(ENDING)
        })
        .collect();
    graphs.sort();
    for graph in &graphs {
        may_be_read(&graph.strip_prefix(folder).unwrap_or(graph).to_string_lossy(), &here, &roots)?;
    }
    if graphs.is_empty() { Err(missing(pattern)) } else { Ok(graphs) }
}

/// All test files in a folder and those inside of it, sorted; what is no folder as it is. Links to folders are not followed: they
/// may lead in a circle.
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
        } else if !is_folder && name.ends_with(ENDING) {
            found.push(path);
        }
    }
    found.sort();
    found
}

/// The test files in a folder itself, sorted.
pub(crate) fn in_folder(folder: &Path) -> Vec<PathBuf> {
    let here = if folder == Path::new("") { Path::new(".") } else { folder };
    let files = std::fs::read_dir(here).into_iter().flatten().flatten();
    let files = files.map(|file| folder.join(file.file_name()));
    let mut tests: Vec<_> = files.filter(|path| path.to_string_lossy().ends_with(ENDING)).collect();
    tests.sort();
    tests
}

/// The test files that test a graph: beside it, or else in the nearest folder above that has some.
pub fn tests_of(graph: &Path) -> Vec<PathBuf> {
    let Ok(wanted) = graph.canonicalize() else { return Vec::new() };
    for folder in graph.ancestors().skip(1) {
        let tests: Vec<_> = in_folder(folder)
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

/// A graph by the path that its test file gives it.
pub fn graph_of(test: &Path, graph: &Path) -> Vec<PathBuf> {
    let (Some(test), Ok(wanted)) = (skim(test), graph.canonicalize()) else { return Vec::new() };
    test.graphs.into_iter().filter(|graph| is_same(graph, &wanted)).collect()
}

/// Whether a path leads to this file.
fn is_same(path: &Path, file: &Path) -> bool {
    path.canonicalize().is_ok_and(|path| path == file)
}

/// The schema of a test file.
pub fn test_schema() -> serde_json::Value {
    schemars::schema_for!(Test).into()
}

/// The words of tests.
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

    fn problems(text: &str) -> Vec<String> {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("doll.ron"), "").unwrap();
        let path = folder.path().join("doll.test.ron");
        std::fs::write(&path, text).unwrap();
        let problems = read(&path, &Catalog::new(&[])).err().unwrap_or_default();
        problems
            .iter()
            .map(|problem| {
                let place =
                    maquette_syntax::error::Place::of(&problem.source.text, problem.span.start);
                format!("{}:{} {} {}", place.line, place.column, problem.code, problem.message)
            })
            .collect()
    }

    #[test]
    fn a_whole_test_is_read() {
        let text = r#"Test(
            graph: "doll.ron",
            cases: {"default": (), "long": (set: {"growth": 25.0, "red.select": Near(color: "x")})},
            compare: {"model.ply": Mesh(max: 0.02, rms: 0.004, attributes: {"uv": 1e-4}), "a.png": Image(differing: 0.0)},
            expect: [Closed("skin"), Near(of: "skin", to: "grid", max: 2.0)],
            budget: (seconds: 2.0),
        )"#;
        assert_eq!(problems(text), [""; 0]);
    }

    #[test]
    fn every_mistake_is_named_at_its_place() {
        let text = "Test(\n graph: \"doll.ron\",\n case: {},\n compare: {\n  \"a.ply\": Mesh(maxx: 1.0),\n  \"b\": Image(rms: 1.0),\n  \"c\": Msh(max: 1.0),\n },\n expect: [Closd(\"x\")],\n)";
        assert_eq!(
            problems(text),
            [
                "3:2 G004 Test has no field `case`",
                "5:17 G004 Mesh has no tolerance `maxx`",
                "6:14 G004 Image has no tolerance `rms`",
                "7:8 G012 values of the type `Msh` have no tolerance",
                "9:11 G009 field `expect` of Test has no choice `Closd`",
            ]
        );
        assert_eq!(problems("Test(graph: \"dol.ron\")"), ["1:13 G013 there is no graph `dol.ron`"]);
        assert_eq!(problems("Graph()"), ["1:1 G001 a test file holds Test(..), not `Graph(..)`"]);
    }
}
