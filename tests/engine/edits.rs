//! Edits of graphs: each is refused with a reason, or does what it says and nothing else.
//!
//! Some are random: `LAW_EDITS` says how many are tried on each graph, `PROPTEST_RNG_SEED` which.

use std::collections::{BTreeMap, HashSet};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, OnceLock};

use expect_test::{Expect, expect};
use maquette::{Catalog, Change, Difference, Edit, Edited, Files, Graph, Options, Problem, Source};
use proptest::prelude::*;
use proptest::sample::Index;
use proptest::test_runner::{Config, RngAlgorithm, TestCaseError, TestRng, TestRunner};
use rayon::prelude::*;

mod sketch;

use crate::beside::beside;
use sketch::Sketch;

/// How many edits are tried on each graph, unless `LAW_EDITS` says otherwise.
const EDITS: u32 = 40;

/// So many follow each other before the next ones begin with the graph as it is.
const WALK: usize = 8;

fn catalog() -> &'static Catalog {
    static CATALOG: OnceLock<Catalog> = OnceLock::new();
    CATALOG.get_or_init(|| Catalog::new(maquette_nodes::PACKS))
}

/// All graphs of the project, and those of the folder beside it if it is there.
fn graphs() -> Vec<(PathBuf, String)> {
    let mut files = Vec::new();
    let own = Path::new(env!("CARGO_MANIFEST_DIR")).join("graphs");
    [own].into_iter().chain(beside("graphs")).for_each(|folder| collect(&folder, &mut files));
    files.sort();
    let read = |path: PathBuf| {
        let text = std::fs::read_to_string(&path).unwrap();
        (path, text)
    };
    let graphs = files.into_iter().map(read).filter(|(_, text)| text.contains("Graph("));
    graphs.collect()
}

fn collect(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            collect(&path, files);
        } else if path.extension().is_some_and(|ending| ending == "ron") {
            files.push(path);
        }
    }
}

fn edit(path: &Path, text: &str, edits: &[Edit]) -> Result<Edited, Vec<Problem>> {
    Graph::edit(path, text, edits, catalog(), &Options::default())
}

fn problems(path: &Path, text: &str) -> Vec<(&'static str, String)> {
    let options = Options { files: Files::Ignored, ..Options::default() };
    let problems = Graph::load_text(path, text.to_owned(), catalog(), &options).problems;
    problems.into_iter().map(|problem| (problem.code, problem.message)).collect()
}

fn differences(path: &Path, old: &str, new: &str) -> Vec<Difference> {
    let source = |text: &str| Source { name: path.to_owned(), text: text.to_owned() };
    Graph::differences(&source(old), &source(new), catalog()).unwrap()
}

/// An edit of a graph; many are wrong.
fn random_edit(sketch: &Sketch, kind: usize, dice: &[Index; 4]) -> Edit {
    const NEW: [&str; 6] = ["new", "zz-top", "b-2", "nose", "grow", "Wrong"];
    let [a, b, c, d] = dice;
    let nodes = Vec::from_iter(sketch.nodes.iter().map(|node| node.name.clone()));
    let name = |from: &[String], dice: &Index| match from {
        [] => "nothing".to_owned(),
        from => dice.get(from).clone(),
    };
    let link = |dice: &Index| match (sketch.links.is_empty(), dice.index(4)) {
        (false, 0..3) => dice.get(&sketch.links).1.clone(),
        _ => name(&nodes, dice),
    };
    let output = |dice: &Index| match (sketch.outputs.is_empty(), dice.index(2)) {
        (false, 0) => dice.get(&sketch.outputs).clone(),
        _ => dice.get(&["new.ply", "new.png", "x.json", "mesh", "../x.ply"]).to_string(),
    };
    match kind {
        0 => {
            let node = (!sketch.nodes.is_empty()).then(|| a.get(&sketch.nodes));
            let mut fields = node.map_or_else(Vec::new, |node| node.fields.clone());
            if d.index(3) == 0 && !fields.is_empty() {
                fields.remove(d.index(fields.len()));
            }
            Edit::Add {
                name: b.get(&NEW).to_string(),
                node: node.map_or("ReadMesh".to_owned(), |node| node.kind.clone()),
                fields,
                after: (c.index(2) == 0).then(|| name(&nodes, c)),
            }
        }
        1 => Edit::Remove { name: name(&sketch.names, a), and_links: b.index(3) > 0 },
        2 => {
            let to = match b.index(8) {
                0 => name(&sketch.names, c),
                _ => c.get(&NEW).to_string(),
            };
            Edit::Rename { from: name(&sketch.names, a), to }
        }
        3 | 4 if sketch.links.is_empty() => Edit::Unlink { port: "nothing.at-all".into() },
        3 => {
            let (port, _) = a.get(&sketch.links);
            // Most ports are of the same type as those of the same name.
            let field = |port: &str| port.split('.').nth(1).map(str::to_owned);
            let alike = sketch.links.iter().filter(|(other, _)| field(other) == field(port));
            let alike = Vec::from_iter(alike.map(|(_, link)| link.clone()));
            let to = if b.index(2) == 0 { name(&alike, c) } else { link(c) };
            Edit::Link { port: port.clone(), to }
        }
        4 => Edit::Unlink { port: a.get(&sketch.links).0.clone() },
        5 if sketch.fields.is_empty() => Edit::Set { target: "nothing".into(), value: "1".into() },
        5 => {
            let (target, old) = a.get(&sketch.fields);
            let alike = match &old[..] {
                "true" => "false",
                "false" => "true",
                // A parameter has a declaration.
                old if old.parse::<f64>().is_ok() || old.contains("default:") => {
                    c.get(&["1", "2", "5"])
                }
                old => old,
            };
            let any = ["2.5", "\"#123456\"", "None", "(1, 2, 3)", "Param(\"levels\")"];
            let value = if d.index(3) > 0 { alike } else { b.get(&any) };
            Edit::Set { target: target.clone(), value: value.to_owned() }
        }
        _ => Edit::Output { name: output(a), to: (b.index(3) > 0).then(|| link(c)) },
    }
}

const KINDS: [&str; 7] = ["add", "remove", "rename", "link", "unlink", "set", "output"];

/// Whether all of `part` stands in `whole`, in order.
fn is_within(part: &str, whole: &str) -> bool {
    let mut whole = whole.bytes();
    part.bytes().all(|byte| whole.any(|other| other == byte))
}

/// The bytes at the beginning and the end that two texts have in common, at most as many as the shorter one has.
fn in_common(old: &str, new: &str) -> usize {
    let start = old.bytes().zip(new.bytes()).take_while(|(a, b)| a == b).count();
    let end = old.bytes().rev().zip(new.bytes().rev()).take_while(|(a, b)| a == b).count();
    (start + end).min(old.len()).min(new.len())
}

/// The text with all literals empty.
fn skeleton(text: &str) -> String {
    let pieces = text.split('"').enumerate();
    let outside = pieces.filter(|(index, _)| index % 2 == 0);
    Vec::from_iter(outside.map(|(_, piece)| piece)).join("\"\"")
}

macro_rules! holds {
    ($what:expr, $($words:tt)*) => {
        if !$what {
            return Err(TestCaseError::fail(format!($($words)*)));
        }
    };
}

/// What must be true of an edit that was done.
fn judge(path: &Path, old: &str, edit: &Edit, edited: &Edited) -> Result<(), TestCaseError> {
    let new = &edited.text;
    holds!(edited.before == old, "the old text is another one");
    let known = problems(path, old);
    let found = problems(path, new);
    // The same may be said of another name.
    let renames = matches!(edit, Edit::Rename { .. }) && found.len() <= known.len();
    let is_known = |(code, message): &(&str, String)| {
        known.iter().any(|known| known.0 == *code && (renames || known.1 == *message))
    };
    holds!(found.iter().all(is_known), "new problems: {found:?}\n{new}");
    let comments = (sketch::comments(old), sketch::comments(new));
    match edit {
        Edit::Remove { .. } | Edit::Unlink { .. } | Edit::Output { to: None, .. } => {
            holds!(is_within(new, old), "more than taken away:\n{new}");
            let kept = HashSet::<&str>::from_iter(comments.1);
            let lines = HashSet::<&str>::from_iter(new.lines());
            for gone in comments.0.iter().filter(|comment| !kept.contains(*comment)) {
                let whole = old.lines().any(|line| line.trim() == *gone && lines.contains(line));
                let own = old.lines().any(|line| line.trim() == *gone);
                let is_inside = matches!(edit, Edit::Remove { .. });
                holds!(!whole && (is_inside || !own), "a comment is gone: {gone}\n{new}");
            }
        }
        Edit::Rename { .. } => {
            holds!(skeleton(old) == skeleton(new), "more than names:\n{new}");
        }
        Edit::Add { .. } | Edit::Output { .. } | Edit::Link { .. } | Edit::Set { .. } => {
            holds!(comments.0 == comments.1, "other comments:\n{new}");
            let is_new = matches!(edit, Edit::Add { .. });
            if is_new {
                let common = in_common(old, new);
                // A comma before a comment, and the entry behind it.
                let comma = || is_within(old, new) && in_common(&old[common..], new) > 0;
                holds!(common == old.len() || comma(), "more than added:\n{new}");
            }
        }
    }
    // What stands on lines of its own stays in the canonical form.
    let form = |text: &str| Graph::formatted(path, text).ok();
    let of_nodes = match edit {
        Edit::Add { .. } => true,
        Edit::Remove { and_links, .. } => !and_links,
        _ => false,
    };
    if of_nodes && form(old).as_deref() == Some(old) && !old.contains("params: { ") {
        holds!(form(new).as_deref() == Some(new), "no longer canonical:\n{new}");
    }
    judge_meaning(edit, old, &differences(path, old, new))
}

/// What the edit changes of what the graph says.
fn judge_meaning(edit: &Edit, old: &str, found: &[Difference]) -> Result<(), TestCaseError> {
    let told = Vec::from_iter(found.iter().map(ToString::to_string)).join("\n");
    let plain = |name: &str| name.rsplit('.').next().unwrap_or_default().to_owned();
    // Expectations are compared as texts, which name what they speak of.
    let is_expected = |found: &&Difference| found.field == "expect" && old.contains("expect:");
    let found = Vec::from_iter(found.iter().filter(|found| !is_expected(found)));
    let is_one = |change: Change, name: &str| match &found[..] {
        [one] => one.change == change && one.name == name,
        _ => false,
    };
    let is_right = match edit {
        Edit::Add { name, .. } => is_one(Change::Added, name) && found[0].what == "node",
        Edit::Remove { name, and_links } => {
            let name = plain(name);
            let (own, others): (Vec<_>, Vec<_>) = found
                .iter()
                .partition(|f| f.what != "output" && f.change == Change::Removed && f.name == name);
            let go_along = |f: &&&&Difference| {
                f.change == Change::Rewired || (f.what, f.change) == ("output", Change::Removed)
            };
            let others_go = others.iter().filter(go_along).count() == others.len();
            own.len() == 1 && if *and_links { others_go } else { others.is_empty() }
        }
        Edit::Rename { from, to } => {
            plain(from) == *to && found.is_empty() || is_one(Change::Renamed, to)
        }
        Edit::Link { port, .. } | Edit::Unlink { port } => {
            let (node, field) = port.split_once('.').unwrap_or_default();
            let field = field.split('.').next().unwrap_or_default();
            found.is_empty() && matches!(edit, Edit::Link { .. })
                || is_one(Change::Rewired, node) && found[0].field.contains(field)
        }
        Edit::Set { target, .. } => {
            let (node, field) = target.split_once('.').unwrap_or((target, "default"));
            let field = field.split('.').next().unwrap_or_default();
            let is_own = |f: &&Difference| f.name == node && f.field.starts_with(field);
            found.iter().all(is_own)
        }
        Edit::Output { name, .. } => {
            found.is_empty()
                || found.len() == 1 && found[0].what == "output" && found[0].name == *name
        }
    };
    holds!(is_right, "the graph says something else:\n{told}");
    Ok(())
}

/// Follows some edits of a graph, each of what the one before has made.
fn follow(
    path: &Path,
    text: &str,
    steps: &[(usize, [Index; 4])],
    counts: &Mutex<BTreeMap<(&str, bool), usize>>,
) -> Result<(), TestCaseError> {
    let mut text = text.to_owned();
    for (kind, dice) in steps {
        let next = random_edit(&Sketch::of(&text), *kind, dice);
        let told = |error: TestCaseError| {
            TestCaseError::fail(format!("{next:?} of {}: {error}\n--- was\n{text}", path.display()))
        };
        let done = edit(path, &text, std::slice::from_ref(&next));
        *counts.lock().unwrap().entry((KINDS[*kind], done.is_ok())).or_default() += 1;
        match done {
            Ok(edited) => {
                judge(path, &text, &next, &edited).map_err(told)?;
                text = edited.text;
            }
            Err(problems) => {
                let has_reason = |problem: &Problem| {
                    !problem.message.is_empty()
                        && problem.code.starts_with('G')
                        && problem.span.end <= problem.source.text.len()
                };
                let all = !problems.is_empty() && problems.iter().all(has_reason);
                if !all {
                    return Err(told(TestCaseError::fail(format!("no reason: {problems:?}"))));
                }
            }
        }
    }
    Ok(())
}

#[test]
fn a_random_edit_does_what_it_says_and_nothing_else_or_is_refused() {
    let number = |name: &str| std::env::var(name).ok()?.parse::<u64>().ok();
    let edits = number("LAW_EDITS").unwrap_or(EDITS.into());
    let seed = number("PROPTEST_RNG_SEED").unwrap_or(20_070_115);
    let graphs = graphs();
    assert!(graphs.len() > 80, "{}", graphs.len());
    let counts = Mutex::new(BTreeMap::new());
    let failures = graphs.par_iter().enumerate().filter_map(|(index, (path, text))| {
        let mut bytes = [0; 32];
        bytes[..8].copy_from_slice(&(seed + index as u64).to_le_bytes());
        let rng = TestRng::from_seed(RngAlgorithm::ChaCha, &bytes);
        let cases = edits.div_ceil(WALK as u64) as u32;
        let config = Config { cases, failure_persistence: None, ..Config::default() };
        let step = (0..KINDS.len(), any::<[Index; 4]>());
        let walk = prop::collection::vec(step, WALK);
        let mut runner = TestRunner::new_with_rng(config, rng);
        runner.run(&walk, |steps| follow(path, text, &steps, &counts)).err()
    });
    // The last edit tells all; those before it have only led to the text.
    let told = |failure: String| failure.split("minimal failing").next().map(str::to_owned);
    let failures: Vec<String> = failures.filter_map(|failure| told(failure.to_string())).collect();
    assert!(failures.is_empty(), "{} graphs:\n{}", failures.len(), failures.join("\n"));
    let counts = counts.into_inner().unwrap();
    for kind in KINDS {
        let [done, refused] =
            [true, false].map(|done| counts.get(&(kind, done)).copied().unwrap_or(0));
        assert!(done > graphs.len() / 8 && refused > 0, "{kind}: {done} done, {refused} refused");
    }
}

const DOLL: &str = include_str!("../../graphs/doll.ron");

fn add(name: &str, node: &str, fields: &[(&str, &str)], after: Option<&str>) -> Edit {
    let fields = fields.iter().map(|&(field, value)| (field.to_owned(), value.to_owned()));
    let (name, node) = (name.to_owned(), node.to_owned());
    Edit::Add { name, node, fields: fields.collect(), after: after.map(str::to_owned) }
}

fn remove(name: &str, and_links: bool) -> Edit {
    Edit::Remove { name: name.to_owned(), and_links }
}

fn rename(from: &str, to: &str) -> Edit {
    Edit::Rename { from: from.to_owned(), to: to.to_owned() }
}

fn link(port: &str, to: &str) -> Edit {
    Edit::Link { port: port.to_owned(), to: to.to_owned() }
}

fn unlink(port: &str) -> Edit {
    Edit::Unlink { port: port.to_owned() }
}

fn output(name: &str, to: Option<&str>) -> Edit {
    Edit::Output { name: name.to_owned(), to: to.map(str::to_owned) }
}

fn edited(text: &str, edits: &[Edit]) -> Result<String, String> {
    let told = |problem: &Problem| {
        let place = maquette::Place::of(&problem.source.text, problem.span.start);
        let Problem { code, message, help, .. } = problem;
        format!("{code} {}:{} {message} ({help})", place.line, place.column)
    };
    let edited = edit(Path::new("nowhere/graph.ron"), text, edits).map(|edited| edited.text);
    edited.map_err(|problems| Vec::from_iter(problems.iter().map(told)).join("\n"))
}

/// That an edit replaces these parts of a text, in order, and no others.
#[track_caller]
fn check_edit(text: &str, edit: Edit, replaced: &[(&str, &str)]) {
    let mut expected = text.to_owned();
    for (old, new) in replaced {
        assert!(expected.contains(old), "{old}");
        expected = expected.replacen(old, new, 1);
    }
    assert_eq!(edited(text, &[edit]), Ok(expected));
}

#[track_caller]
fn check_refused(text: &str, edit: Edit, expected: Expect) {
    expected.assert_eq(&edited(text, &[edit]).unwrap_err());
}

#[test]
fn a_node_is_added_behind_another_one_as_its_neighbors_stand() {
    let spots = "        \"spots\": Label(mask: \"red\", connectivity: Eight),\n";
    let fields = [("image", "scan.color"), ("select", "Near( color:\"#236cba\" )")];
    let blue =
        "        \"blue\": Threshold(image: \"scan.color\", select: Near(color: \"#236cba\")),\n";
    let with_blue = [spots, blue].concat();
    check_edit(DOLL, add("blue", "Threshold", &fields, Some("spots")), &[(spots, &with_blue)]);
    let last = "        \"model\": Texture(mesh: \"skin\", image: \"scan.color\"),\n";
    check_edit(DOLL, add("blue", "Threshold", &fields, None), &[(last, &[last, blue].concat())]);
}

#[test]
fn a_word_is_meant_as_a_link_where_a_port_is() {
    let fields = [("labels", "spots"), ("range", "whole"), ("pick", "Smallest")];
    let text = edited(DOLL, &[add("other", "ExtractRegion", &fields, None)]).unwrap();
    let node =
        "\"other\": ExtractRegion(labels: \"spots\", range: \"whole\", pick: Smallest),\n    },";
    assert!(text.contains(node), "{text}");
}

#[test]
fn a_long_node_is_broken_as_fmt_breaks_it() {
    let points = format!("[{}]", ["[(0, 0, 0), (100, 0, 0), (200, 0, 0)]"; 3].join(", "));
    let text = edited(DOLL, &[add("points", "PointNet", &[("points", &points)], Some("red"))]);
    let text = text.unwrap();
    assert_eq!(Graph::formatted(Path::new("x"), &text).unwrap(), text);
    let tabs = edited(
        &DOLL.replace("    ", "\t").replace('\n', "\r\n"),
        &[add("points", "PointNet", &[("points", &points)], Some("red"))],
    );
    assert_eq!(tabs.unwrap(), text.replace("    ", "\t").replace('\n', "\r\n"));
}

#[test]
fn the_first_node_and_the_first_output_open_their_sections() {
    let empty = "Graph(\n    format: 1,\n    nodes: {},\n    outputs: {},\n)\n";
    let doll = add("doll", "ReadMesh", &[("path", "a.obj")], None);
    let text = edited(empty, &[doll, output("a.ply", Some("doll"))]).unwrap();
    expect![[r#"
        Graph(
            format: 1,
            nodes: {
                "doll": ReadMesh(path: "a.obj"),
            },
            outputs: { "a.ply": "doll" },
        )
    "#]]
    .assert_eq(&text);
    assert_eq!(edited(&text, &[output("a.ply", None), remove("doll", false)]).unwrap(), empty);
}

#[test]
fn what_cannot_be_added_is_refused() {
    let red = [("image", "scan.color")];
    check_refused(
        DOLL,
        add("red", "Threshold", &red, None),
        expect!["G006 32:9 there is already a node `red` (give one of them another name)"],
    );
    check_refused(
        DOLL,
        add("Red", "Threshold", &red, None),
        expect![
            "G006 1:1 `Red` cannot name a node (names begin with a lower-case letter; lower-case letters, digits and hyphens follow)"
        ],
    );
    check_refused(
        DOLL,
        add("blue", "Treshold", &red, None),
        expect!["G003 32:17 there is no node type `Treshold` (did you mean `Threshold`?)"],
    );
    check_refused(
        DOLL,
        add("blue", "Otsu(), \"x\": Label", &red, None),
        expect![[
            r#"G003 1:1 `Otsu(), "x": Label` cannot be the name of a node type (letters, digits and `_`, no digit first)"#
        ]],
    );
    check_refused(
        DOLL,
        add("blue", "Label", &[], None),
        expect![[
            r#"G005 32:17 Label needs a link at its port `mask` (write `mask: "node"` with a node that gives a Mask)"#
        ]],
    );
    check_refused(
        DOLL,
        add("blue", "Threshold", &red, Some("rde")),
        expect!["G007 1:1 the graph has no node `rde` (did you mean `red`?)"],
    );
}

#[test]
fn a_node_goes_with_its_lines_and_its_own_comments() {
    let knots = "        \"knots-u\": Knots(net: \"raised\", along: U, order: 3),\n";
    let text = DOLL.replace(", u: \"knots-u\"", "");
    check_edit(&text, remove("knots-u", false), &[(knots, "")]);
    let noted = text.replace("order: 3),\n", "order: 3), // along\n");
    check_edit(&noted, remove("knots-u", true), &[(&knots.replace(",\n", ", // along\n"), "")]);
    let lonely = "Graph(format: 1, nodes: { \"a\": ReadMesh(path: \"a.obj\"), \"b\": ReadMesh(path: \"b.obj\") }, outputs: {})";
    check_edit(lonely, remove("a", false), &[("\"a\": ReadMesh(path: \"a.obj\"), ", "")]);
    check_edit(lonely, remove("b", false), &[(", \"b\": ReadMesh(path: \"b.obj\")", "")]);
}

#[test]
fn no_blank_line_is_left_where_a_group_of_nodes_was() {
    let text = "Graph(\n    format: 1,\n    nodes: {\n        \"a\": ReadMesh(path: \"a.obj\"),\n\n        \"b\": ReadMesh(path: \"b.obj\"),\n\n        // Of c.\n        \"c\": ReadMesh(path: \"c.obj\") // c\n    },\n    outputs: {},\n)\n";
    check_edit(text, remove("a", false), &[("        \"a\": ReadMesh(path: \"a.obj\"),\n\n", "")]);
    check_edit(text, remove("b", false), &[("\n        \"b\": ReadMesh(path: \"b.obj\"),\n", "")]);
    let last = "        \"c\": ReadMesh(path: \"c.obj\") // c\n";
    check_edit(text, remove("c", false), &[(last, ""), ("b.obj\"),", "b.obj\")")]);
}

#[test]
fn what_something_hangs_on_is_not_removed() {
    check_refused(
        DOLL,
        remove("knots-u", false),
        expect![
            "G007 25:44 `knots-u` cannot be removed: port `u` of `surface` needs it (link it to something else, or let links go along that need not be (--and-links))"
        ],
    );
    check_refused(
        DOLL,
        remove("red", true),
        expect![
            "G005 16:30 port `mask` of `spots` cannot be left without a link (link it to something else)"
        ],
    );
    check_refused(
        DOLL,
        remove("growth", true),
        expect![
            "G011 22:84 `growth` cannot be removed: `raised` needs it (put a value in place of what names `growth`)"
        ],
    );
    check_refused(
        DOLL,
        remove("rde", true),
        expect!["G007 1:1 the graph has no node, input or parameter `rde` (did you mean `red`?)"],
    );
    let expects = DOLL.replace("    outputs: {", "    expect: [Closed(\"grid\")],\n    outputs: {");
    check_refused(
        &expects,
        remove("skin", false),
        expect![
            "G007 31:32 `skin` cannot be removed: port `mesh` of `model` needs it (link it to something else, or let links go along that need not be (--and-links))"
        ],
    );
    check_refused(
        &expects,
        output("model.glb", Some("nothing")),
        expect![
            "G007 35:22 there is no node `nothing` (the graph's nodes: scan, whole, red, spots, nose, normal, net, raised, knots-u, knots-v, surface, blended, grid, skin, model)"
        ],
    );
}

#[test]
fn links_that_need_not_be_go_along() {
    let knots = "        \"knots-u\": Knots(net: \"raised\", along: U, order: 3),\n";
    check_edit(DOLL, remove("knots-u", true), &[(knots, ""), (", u: \"knots-u\"", "")]);
    let model = "        \"model\": Texture(mesh: \"skin\", image: \"scan.color\"),\n";
    let outputs = "        \"model.glb\": \"model\",\n        \"model.ply\": \"model\",\n";
    let expects = "    expect: [Closed(\"model\"), Closed(\"skin\"), Manifold(\"model.ply\")],\n)";
    let text = DOLL.replace("    },\n)", &format!("    }},\n{expects}"));
    assert_ne!(text, DOLL);
    check_edit(
        &text,
        remove("model", true),
        &[
            (model, ""),
            (outputs, ""),
            ("Closed(\"model\"), ", ""),
            (", Manifold(\"model.ply\")", ""),
        ],
    );
    let beside = include_str!("../../graphs/nodes/Merge.ron");
    let node = "        \"beside\": Transform(mesh: \"doll\", translate: (100, 0, 0)),\n";
    check_edit(beside, remove("beside", true), &[(node, ""), (", \"beside\"", "")]);
}

#[test]
fn a_name_is_changed_wherever_it_is_named() {
    check_edit(
        DOLL,
        rename("scan", "capture"),
        &[
            ("\"scan\":", "\"capture\":"),
            ("\"scan.range\"", "\"capture.range\""),
            ("\"scan.color\"", "\"capture.color\""),
            ("\"scan.color\"", "\"capture.color\""),
        ],
    );
    let text = DOLL.replace("Param(\"growth\")", "Expr(\"growth*2-growth / 2\")");
    check_edit(
        &text,
        rename("growth", "grow-th"),
        &[("\"growth\"", "\"grow-th\""), ("growth*2-growth", "grow-th*2-grow-th")],
    );
    let face = include_str!("../../graphs/face.ron");
    check_refused(
        face,
        rename("nose", "noses"),
        expect![
            "G006 7:9 both a node and a parameter have the name `nose` (write `nodes.nose` or `params.nose`)"
        ],
    );
}

#[test]
fn the_names_in_uses_and_lists_and_choices_follow() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("graphs");
    let check = |file: &str, from: &str, to: &str, expected: &[(&str, &str)]| {
        let path = folder.join(file);
        let text = std::fs::read_to_string(&path).unwrap();
        let mut replaced = text.clone();
        for (old, new) in expected {
            assert!(replaced.contains(old), "{old}");
            replaced = replaced.replace(old, new);
        }
        assert_eq!(edit(&path, &text, &[rename(from, to)]).unwrap().text, replaced);
    };
    check(
        "face.ron",
        "nodes.nose",
        "first",
        &[("\"nose\": Feature", "\"first\": Feature"), ("\"nose.range\"", "\"first.range\"")],
    );
    check(
        "face.ron",
        "params.nose",
        "far",
        &[("\"nose\": Number", "\"far\": Number"), ("Param(\"nose\")", "Param(\"far\")")],
    );
    check(
        "face.ron",
        "nodes.eyes",
        "both",
        &[("\"eyes\": ForEach", "\"both\": ForEach"), ("\"eyes.range\"", "\"both.range\"")],
    );
    check("face.ron", "scan", "seen", &[("\"scan", "\"seen")]);
    check("crowd.ron", "smooth", "fine", &[("\"smooth\"", "\"fine\"")]);
    check(
        "crowd.ron",
        "doll",
        "one",
        &[("\"doll\": Switch", "\"one\": Switch"), ("(mesh: \"doll\")", "(mesh: \"one\")")],
    );
}

#[test]
fn an_expression_does_not_change_its_meaning_when_a_parameter_gets_another_name() {
    let text = DOLL.replace("Param(\"growth\")", "Expr(\"growth-levels\")");
    check_refused(
        &text,
        rename("levels", "a b"),
        expect![
            "G006 1:1 `a b` cannot name a parameter (names begin with a lower-case letter; lower-case letters, digits and hyphens follow)"
        ],
    );
    let three = text.replace(
        "    params: {\n",
        "    params: {\n        \"far\": Number(default: 1.0, doc: \"x\"),\n",
    );
    check_refused(
        &three,
        rename("far", "growth-levels"),
        expect![
            "G011 23:83 this expression would say something else with the name `growth-levels` (a hyphen with spaces around it is always a sign)"
        ],
    );
}

#[test]
fn ports_are_linked_and_left_free() {
    let u = ", u: \"knots-u\"";
    check_edit(DOLL, link("surface.u", "knots-v"), &[(u, ", u: \"knots-v\"")]);
    check_edit(DOLL, unlink("surface.u"), &[(u, "")]);
    let text = DOLL.replace(u, "");
    check_edit(
        &text,
        link("surface.u", "knots-u"),
        &[("\"knots-v\")", "\"knots-v\", u: \"knots-u\")")],
    );
    check_refused(
        DOLL,
        link("skin.mesh", "model"),
        expect![
            "G008 30:9 nodes hang on each other in a circle: skin <- model <- skin (a node cannot need its own result: break one of these links)"
        ],
    );
    check_refused(
        DOLL,
        link("skin.mesh", "scan.color"),
        expect![
            "G012 30:33 port `mesh` of Subdivide wants a Mesh, but `scan.color` is an Image ()"
        ],
    );
    check_refused(
        DOLL,
        link("skin.levels", "grid"),
        expect!["G004 30:17 `skin` has no port `levels` (its ports: mesh)"],
    );
    check_refused(
        DOLL,
        link("scan.color", "red"),
        expect!["G004 10:17 `scan` has no port `color` ()"],
    );
    check_refused(
        DOLL,
        link("skin.msh", "grid"),
        expect!["G004 30:17 `skin` has no port `msh` (did you mean `mesh`?)"],
    );
    check_refused(
        DOLL,
        link("skn.mesh", "grid"),
        expect!["G007 1:1 the graph has no node `skn` (did you mean `skin`?)"],
    );
    check_refused(
        DOLL,
        link("skin", "grid"),
        expect!["G004 1:1 `skin` is no port (write NODE.PORT)"],
    );
    check_refused(
        DOLL,
        unlink("skin.mesh"),
        expect![
            "G005 30:33 port `mesh` of `skin` cannot be left without a link (link it to something else)"
        ],
    );
    check_refused(
        DOLL,
        unlink("scan.color"),
        expect!["G004 10:36 port `color` of `scan` has no link ()"],
    );
    check_refused(
        DOLL,
        unlink("surface.order"),
        expect!["G004 25:20 port `order` of `surface` has no link ()"],
    );
}

#[test]
fn a_port_for_many_links_has_a_list() {
    let beside = include_str!("../../graphs/nodes/Merge.ron");
    let list = "[\"doll\", \"beside\"]";
    check_edit(beside, link("both.meshes", "doll"), &[(list, "[\"doll\", \"beside\", \"doll\"]")]);
    check_edit(
        beside,
        link("both.meshes.2", "doll"),
        &[(list, "[\"doll\", \"beside\", \"doll\"]")],
    );
    check_edit(beside, link("both.meshes.0", "beside"), &[(list, "[\"beside\", \"beside\"]")]);
    check_edit(beside, unlink("both.meshes.0"), &[(list, "[\"beside\"]")]);
    check_refused(
        beside,
        link("both.meshes.3", "doll"),
        expect!["G004 7:31 port `meshes` of `both` has no link 3 (the next one has the number 2)"],
    );
    check_refused(
        beside,
        unlink("both.meshes.2"),
        expect!["G004 7:31 there is no item `2` (its items are numbered from 0 to 1)"],
    );
    check_refused(
        beside,
        unlink("both.meshes"),
        expect![
            "G005 7:31 port `meshes` of `both` cannot be left without a link (link it to something else)"
        ],
    );
    let one = beside.replace(list, "\"doll\"");
    check_edit(
        &one,
        link("both.meshes", "beside"),
        &[("meshes: \"doll\"", "meshes: [\"doll\", \"beside\"]")],
    );
    check_edit(
        &one,
        link("both.meshes.0", "beside"),
        &[("meshes: \"doll\"", "meshes: \"beside\"")],
    );
}

#[test]
fn the_ports_of_repeated_nodes_and_choices_are_linked() {
    let crowd = include_str!("../../graphs/crowd.ron");
    check_edit(crowd, link("copies.mesh", "smooth"), &[("(mesh: \"doll\")", "(mesh: \"smooth\")")]);
    check_edit(
        crowd,
        link("doll.fine", "coarse"),
        &[("\"fine\": \"smooth\"", "\"fine\": \"coarse\"")],
    );
    check_edit(
        crowd,
        link("doll.third", "coarse"),
        &[("\"fine\": \"smooth\"", "\"fine\": \"smooth\", \"third\": \"coarse\"")],
    );
    check_refused(
        crowd,
        unlink("copies.mesh"),
        expect![
            "G005 17:27 port `mesh` of `copies` cannot be left without a link (link it to something else)"
        ],
    );
    check_refused(
        crowd,
        unlink("doll.fine"),
        expect![
            "G005 9:60 port `fine` of `doll` cannot be left without a link (link it to something else)"
        ],
    );
    check_refused(
        crowd,
        remove("smooth", true),
        expect![
            "G005 9:60 port `fine` of `doll` cannot be left without a link (link it to something else)"
        ],
    );
}

#[test]
fn outputs_are_added_changed_and_taken_away() {
    let last = "        \"nose-mask.png\": \"red\",\n";
    let edges = "        \"skin.ply\": \"skin\",\n";
    check_edit(DOLL, output("skin.ply", Some("skin")), &[(last, &[last, edges].concat())]);
    check_edit(
        DOLL,
        output("model.ply", Some("skin")),
        &[("\"model.ply\": \"model\"", "\"model.ply\": \"skin\"")],
    );
    check_edit(DOLL, output("nose-mask.png", None), &[(last, "")]);
    check_refused(
        DOLL,
        output("skin.png", Some("net")),
        expect![
            "G015 39:9 a ControlNet cannot be written to a `.png` file (a ControlNet can be written to: json, ply)"
        ],
    );
    check_refused(
        DOLL,
        output("skin", Some("skin")),
        expect![
            "G015 39:9 output `skin` has no ending that says how to write a Mesh (a Mesh can be written to: glb, obj, ply, png, stl)"
        ],
    );
    check_refused(
        DOLL,
        output("model.obj", None),
        expect!["G007 1:1 the graph has no output `model.obj` (did you mean `model.glb`?)"],
    );
}

#[test]
fn edits_that_are_right_together_are_done_together() {
    let fields = [("mask", "blue")];
    let select = [("image", "scan.color"), ("select", "Otsu")];
    let edits = [
        add("dots", "Label", &fields, None),
        add("blue", "Threshold", &select, Some("red")),
        output("dots.png", Some("dots")),
    ];
    assert!(edited(DOLL, &edits[..1]).is_err());
    let text = edited(DOLL, &edits).unwrap();
    let found = differences(Path::new("nowhere/graph.ron"), DOLL, &text);
    let found = Vec::from_iter(found.iter().map(ToString::to_string)).join("\n");
    expect![[r#"
        node blue: added: Threshold(image: "scan", select: Otsu())
        node dots: added: Label(mask: "blue")
        output dots.png: added: "dots""#]]
    .assert_eq(&found);
}

#[test]
fn a_patch_has_no_nodes_to_edit() {
    let patch = "Patch(format: 1, of: \"doll.ron\", params: { \"growth\": 3.0 })";
    check_refused(
        patch,
        rename("growth", "far"),
        expect![
            "G001 1:1 a patch has values of nodes, but no nodes of its own (edit the graph that it is `of`; values of a patch can be set)"
        ],
    );
}
