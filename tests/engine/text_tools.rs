//! Tools that change the texts of graphs. They must make the requested changes and change nothing else.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use expect_test::{Expect, expect};
use maquette::rng::Random;
use maquette::{Catalog, Diagnostic, Graph, Options, Source};
use proptest::prelude::*;
use proptest::test_runner::{Config, RngAlgorithm, TestRng, TestRunner};
use ron::Value;

use crate::beside::shared_folder;
use crate::ron_files::ron_files;

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");

fn catalog() -> &'static Catalog {
    static CATALOG: OnceLock<Catalog> = OnceLock::new();
    CATALOG.get_or_init(|| Catalog::new(maquette_nodes::PACKS))
}

/// Returns all graphs of the project. Also returns those in the folder `../shared/graphs` next to the project, if it exists.
fn corpus() -> Vec<(PathBuf, String)> {
    let root = Path::new(ROOT);
    let own = ["graphs", "tests/third_party/graphs"].map(|folder| root.join(folder));
    let folders = own.into_iter().chain(shared_folder("graphs"));
    let mut files: Vec<_> = folders.flat_map(|folder| ron_files(&folder)).collect();
    files.retain(|path| !path.to_string_lossy().ends_with(".lock.ron"));
    assert!(files.len() > 30);
    files.sort();
    files
        .into_iter()
        .map(|path: PathBuf| {
            let text = std::fs::read_to_string(&path).unwrap();
            (path, text)
        })
        .collect()
}

/// Returns the text with random damage: some bytes are removed, duplicated, or replaced by fragments of graphs.
fn spoil(text: &str, dice: &mut Random) -> String {
    const PIECES: [&str; 18] = [
        "(", ")", "[", "]", "{", "}", ",", ":", "\"", "\\", "// a\n", "/* b", "*/", "\r\n", "\n\n",
        "ä", "#", "-1.",
    ];
    let mut bytes = text.as_bytes().to_vec();
    for _ in 0..=dice.next_below(4) {
        let at = dice.next_below(bytes.len().max(1)).min(bytes.len());
        let end = (at + dice.next_below(12)).min(bytes.len());
        match dice.next_below(3) {
            0 => drop(bytes.drain(at..end)),
            1 => {
                let piece = PIECES[dice.next_below(PIECES.len())];
                drop(bytes.splice(at..at, piece.bytes()));
            }
            _ => {
                let copy = bytes[at..end].to_vec();
                drop(bytes.splice(at..at, copy));
            }
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

fn comments(text: &str) -> Vec<&str> {
    let found = text.lines().filter_map(|line| line.find("// ").map(|at| line[at..].trim_end()));
    let mut found: Vec<&str> = found.collect();
    found.sort_unstable();
    found
}

fn format_text(text: &str) -> Option<String> {
    let form = maquette::edit::format_text(Path::new("graph.ron"), text);
    let is_fault = |problem: &Diagnostic| problem.message.contains("canonical form");
    assert!(!form.as_ref().is_err_and(|problems| problems.iter().any(is_fault)), "{text}");
    form.ok()
}

fn differences(old: &str, new: &str) -> Vec<String> {
    fn source(text: &str) -> Source {
        Source { name: "graph.ron".into(), text: text.to_owned() }
    }
    let found = Graph::differences(&source(old), &source(new), catalog()).unwrap();
    found.iter().map(ToString::to_string).collect()
}

/// Checks that printing a parsed text reproduces it. Also checks that formatting twice has the same effect as formatting once, and keeps
/// the meaning.
fn check_text(text: &str, what: &str) {
    assert_eq!(maquette::edit::reprint(text), text, "{what}");
    let Some(form) = format_text(text) else { return };
    assert_eq!(format_text(&form).as_deref(), Some(&form[..]), "{what}: not idempotent");
    assert_eq!(differences(text, &form), [""; 0], "{what}");
    assert_eq!(to_ron(text), to_ron(&form), "{what}");
}

/// Parses a text with the `ron` crate, the reference implementation of the grammar. The text must be valid for our parser.
fn to_ron(text: &str) -> Value {
    // Add a field name before the path of a used graph, which the `ron` crate requires.
    let mut pieces = text.split("Graph(");
    let mut text = pieces.next().unwrap_or_default().to_owned();
    for piece in pieces {
        let has_path = piece.trim_start().starts_with('"');
        text += if has_path { "Graph(path: " } else { "Graph(" };
        text += piece;
    }
    ron::from_str(&text).unwrap_or_else(|error| panic!("{error}: {text}"))
}

#[test]
fn every_graph_is_printed_as_it_stands_and_keeps_its_meaning_and_comments_when_formatted() {
    for (path, text) in corpus() {
        check_text(&text, &path.display().to_string());
        let Some(form) = format_text(&text) else { continue };
        assert_eq!(comments(&text), comments(&form), "{}", path.display());
    }
}

#[test]
fn the_graphs_of_the_project_are_in_their_canonical_form() {
    for (path, text) in corpus() {
        if path.starts_with(Path::new(ROOT).join("graphs")) {
            assert_eq!(format_text(&text).as_ref(), Some(&text), "{}", path.display());
        }
    }
}

#[test]
fn spoiled_graphs_are_printed_as_they_stand_and_those_that_can_be_read_are_formatted() {
    let mut dice = Random(6);
    for (path, text) in corpus() {
        for round in 0..100 {
            check_text(&spoil(&text, &mut dice), &format!("{} {round}", path.display()));
        }
    }
}

#[test]
fn the_form_does_not_hang_on_how_lines_are_broken() {
    let mut dice = Random(7);
    for (path, text) in corpus() {
        let Some(form) = format_text(&text) else { continue };
        // Skip graphs with line comments or blank lines. Their line breaks cannot be replaced at random: a line comment ends at the line
        // break, and formatting keeps blank lines.
        if text.contains("//") || text.contains("\n\n") {
            continue;
        }
        for _ in 0..4 {
            let mut mixed = String::new();
            let mut in_text = false;
            for c in form.chars() {
                in_text ^= c == '"';
                let is_edge = "()[]{}:,".contains(c) && !in_text;
                match c {
                    ' ' | '\n' if !in_text => {}
                    _ if is_edge => {
                        mixed.push_str(["", " ", "\n", "\t"][dice.next_below(4)]);
                        mixed.push(c);
                        mixed.push_str(["", "  ", "\r", ""][dice.next_below(4)]);
                    }
                    _ => mixed.push(c),
                }
            }
            // Replace all line endings before the comparison. By chance all of them in `mixed` may be CR LF, or all CR, which formatting
            // keeps.
            let found = format_text(&mixed);
            let found = found.map(|form| form.replace("\r\n", "\n").replace('\r', "\n"));
            assert_eq!(found.as_ref(), Some(&form), "{}", path.display());
        }
    }
}

fn check_form(text: &str, expected: Expect) {
    let form = format_text(text).expect("the text can be read");
    assert_eq!(format_text(&form).as_ref(), Some(&form), "not idempotent");
    expected.assert_eq(&form);
}

#[test]
fn comments_stay_with_what_they_are_about() {
    check_form(
        "// first\n\n\n// second\nGraph( format:1, // the format\n/* inline */ doc:\"x\" // the doc\n,nodes:{ // of nodes\n\
         \"a\":A(x:1 /* one */,y:2), // behind a\n\n\n// above b\n\n\"b\":B( // in b\n), \"c\": C(x: // why\n 1, y: [\n// row\n1,2, // end\n3\n// last\n])\n// of nodes, too\n}) // end\n// after\n",
        expect![[r#"
            // first

            // second
            Graph(
                format: 1, // the format
                /* inline */ doc: "x", // the doc
                nodes: {
                    // of nodes
                    "a": A(x: 1 /* one */, y: 2), // behind a

                    // above b

                    "b": B(
                        // in b
                    ),
                    "c": C(
                        // why
                        x: 1,
                        y: [
                            // row
                            1, 2, // end
                            3,
                            // last
                        ],
                    ),
                    // of nodes, too
                },
            ) // end
            // after
        "#]],
    );
}

#[test]
fn long_lists_and_calls_are_broken() {
    let numbers = (0..60).map(|k| k.to_string()).collect::<Vec<_>>().join(", ");
    let long = "abcdefghij".repeat(12);
    check_form(
        &format!(
            "Graph(format: 1, nodes: {{\"a\": A(x: 1, list: [{numbers}]), \"b\": B(text: \"{long}\", other: \"{long}\"), \
             \"c\": C(rows: [[1, 2], [3, 4]]), \"d\": D(rows: [[1, 2]], at: (0, 0)), \"e\": E()}}, outputs: {{\"a.ply\": \"a\"}})"
        ),
        expect![[r#"
            Graph(
                format: 1,
                nodes: {
                    "a": A(x: 1, list: [
                        0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21, 22, 23, 24, 25, 26, 27, 28, 29, 30, 31, 32, 33, 34, 35, 36,
                        37, 38, 39, 40, 41, 42, 43, 44, 45, 46, 47, 48, 49, 50, 51, 52, 53, 54, 55, 56, 57, 58, 59,
                    ]),
                    "b": B(
                        text: "abcdefghijabcdefghijabcdefghijabcdefghijabcdefghijabcdefghijabcdefghijabcdefghijabcdefghijabcdefghijabcdefghijabcdefghij",
                        other: "abcdefghijabcdefghijabcdefghijabcdefghijabcdefghijabcdefghijabcdefghijabcdefghijabcdefghijabcdefghijabcdefghijabcdefghij",
                    ),
                    "c": C(rows: [
                        [1, 2],
                        [3, 4],
                    ]),
                    "d": D(rows: [[1, 2]], at: (0, 0)),
                    "e": E(),
                },
                outputs: { "a.ply": "a" },
            )
        "#]],
    );
}

#[test]
fn a_file_with_mistakes_has_no_form() {
    for broken in
        ["Graph(format: 1,", "Graph(format 1)", "(a: 1,, b: 2)", "[1 2]", "[, 1]", "{ : 1 }"]
    {
        assert_eq!(format_text(broken), None, "{broken}");
    }
    assert_eq!(format_text(""), None);
}

const DOLL: &str = include_str!("../../graphs/doll.ron");

fn set(text: &str, values: &[(&str, &str)]) -> Result<String, String> {
    let values: Vec<(String, String)> =
        values.iter().map(|&(target, value)| (target.to_owned(), value.to_owned())).collect();
    let path = Path::new("nowhere/graph.ron");
    let edited = maquette::edit::set_values(path, text, &values, catalog(), &Options::default());
    edited.map(|edited| edited.text).map_err(|problems| {
        let problem = &problems[0];
        format!("{} {} ({})", problem.code, problem.message, problem.help)
    })
}

#[test]
fn a_value_that_is_set_is_all_that_changes() {
    fn check(target: &str, value: &str, old: &str, new: &str) {
        assert_eq!(set(DOLL, &[(target, value)]), Ok(DOLL.replacen(old, new, 1)), "{target}");
    }
    check("red.select.distance", "25.5", "distance: 30.0", "distance: 25.5");
    check("red.select.Near.distance", "25.5", "distance: 30.0", "distance: 25.5");
    check("growth", "20", "default: 12.0", "default: 20");
    check("nose.pick", "Rank(2)", "pick: Largest", "pick: Rank(2)");
    check("red.select.color", "#123456", "#c33923", "#123456");
    check("blended.region", "nose", "\"nose\", surface", "\"nose\", surface");
    check(
        "raised.steps.0.distance",
        "Expr(\"growth / 2\")",
        "Param(\"growth\")",
        "Expr(\"growth / 2\")",
    );
}

#[test]
fn a_field_that_is_not_there_is_added_as_its_author_writes_fields() {
    fn check(node: &str, target: &str, value: &str, expected: &str) {
        fn graph(node: &str) -> String {
            format!(
                "Graph(format: 1, nodes: {{\n  \"i\": ReadImage(path: \"a.png\"),\n  \"n\": {node},\n}}, outputs: {{}})"
            )
        }
        assert_eq!(set(&graph(node), &[(target, value)]), Ok(graph(expected)));
    }
    let near = "select: Near(color: \"#c33923\")";
    check(
        &format!("Threshold(image: \"i\", {near})"),
        "n.invert",
        "true",
        &format!("Threshold(image: \"i\", {near}, invert: true)"),
    );
    check(
        &format!("Threshold(image:\"i\",{near}, /* c */ )"),
        "n.invert",
        "true",
        &format!("Threshold(image:\"i\",{near},invert: true, /* c */ )"),
    );
    check(
        &format!("Threshold(\n\t image: \"i\",\n\t {near}, // red\n  )"),
        "n.invert",
        "true",
        &format!("Threshold(\n\t image: \"i\",\n\t {near}, // red\n\t invert: true,\n  )"),
    );
    check(
        &format!("Threshold(\r\n    image: \"i\",\r\n    {near} // red\r\n  )"),
        "n.invert",
        "true",
        &format!(
            "Threshold(\r\n    image: \"i\",\r\n    {near}, // red\r\n    invert: true\r\n  )"
        ),
    );
    check(
        &format!("Threshold(image: \"i\", {near})"),
        "n.select.distance",
        "3",
        "Threshold(image: \"i\", select: Near(color: \"#c33923\", distance: 3))",
    );
}

/// Generates random valid edits. Each is the target, the keys that lead to it in the file, and the new value.
fn edits() -> impl Strategy<Value = (&'static str, &'static [&'static str], String)> {
    let number = prop_oneof![(0..40i32).prop_map(|x| x.to_string()), "[0-3]?[0-9]\\.[0-9]{1,9}"];
    let color = "#[0-9a-f]{6}".prop_map(|color| format!("\"{color}\""));
    // A file name with an escape sequence for one character, as an author may write it.
    let file =
        "[a-z ä'(]{1,9}".prop_map(|name| format!("\"{}.png\"", name.replace('ä', "\\u{e4}")));
    prop_oneof![
        number.clone().prop_map(|x| ("growth", &["params", "growth", "default"][..], x)),
        number.prop_map(|x| {
            ("red.select.distance", &["nodes", "red", "select", "distance"][..], x)
        }),
        color.prop_map(|x| ("red.select.color", &["nodes", "red", "select", "color"][..], x)),
        (1..9u32).prop_map(|x| ("nose.pick", &["nodes", "nose", "pick"][..], format!("Rank({x})"))),
        file.prop_map(|x| ("scan.color", &["nodes", "scan", "color"][..], x)),
        any::<bool>().prop_map(|x| ("red.invert", &["nodes", "red", "invert"][..], x.to_string())),
    ]
}

#[test]
fn any_value_that_is_set_is_read_back_by_ron() {
    let seed = TestRng::from_seed(RngAlgorithm::ChaCha, &[7; 32]);
    let mut runner = TestRunner::new_with_rng(Config::with_cases(200), seed);
    let run = runner.run(&edits(), |(target, way, value)| {
        let options = Options { files: maquette::Files::Ignored, ..Options::default() };
        let values = [(target.to_owned(), value.clone())];
        let edited =
            maquette::edit::set_values(Path::new("graph.ron"), DOLL, &values, catalog(), &options);
        let text =
            edited.map_err(|problems| TestCaseError::fail(problems[0].message.clone()))?.text;
        let mut found = to_ron(&text);
        for step in way {
            let Value::Map(map) = found else { return Err(TestCaseError::fail("no map")) };
            found = map.get(&Value::String((*step).to_owned())).cloned().unwrap_or(Value::Unit);
        }
        prop_assert_eq!(found, to_ron(&value));
        Ok(())
    });
    run.unwrap();
}

#[test]
fn what_would_make_a_new_problem_is_refused() {
    fn check(target: &str, value: &str, expected: Expect) {
        expected.assert_eq(&set(DOLL, &[(target, value)]).unwrap_err());
    }
    check(
        "growth",
        "99",
        expect!["G010 parameter `growth` is 99 mm, but must be at least 0 and at most 40 mm ()"],
    );
    check(
        "raised.steps.0.distance",
        "3",
        expect![[
            r#"G011 raised.steps.0.distance=3: its value is Param("growth"), a parameter of the graph (set the parameter: growth=3)"#
        ]],
    );
    check(
        "raised.steps.1.distance",
        "3",
        expect![
            "G004 raised.steps.1.distance=3: there is no item `1` (its items are numbered from 0 to 0)"
        ],
    );
    check(
        "rde.invert",
        "true",
        expect!["G007 rde.invert=true: the graph has no node `rde` (did you mean `red`?)"],
    );
    check(
        "red.invrt",
        "true",
        expect!["G004 Threshold has no field `invrt` (did you mean `invert`?)"],
    );
    check(
        "spots.mask",
        "nose",
        expect![
            "G008 cycle: spots <- nose <- spots (a node cannot need its own result: break one of these links)"
        ],
    );
    check(
        "surface.order.1",
        "2",
        expect![
            "G004 surface.order.1=2: `order` does not exist, so it has no items to set (give all of `order`)"
        ],
    );
    check(
        "scan.color",
        "../../../etc/passwd",
        expect![
            "G014 `../../../etc/passwd` lies outside of the project (move the file into nowhere, put a maquette.toml into a folder above both, or allow its folder with --root)"
        ],
    );
}

#[test]
fn two_values_that_are_right_together_are_set_together() {
    let values = [("red.select", "Otsu"), ("growth", "3.5")];
    let text = set(DOLL, &values).unwrap();
    assert_eq!(
        differences(DOLL, &text),
        [
            "parameter growth: changed default: 12 -> 3.5",
            "node red: changed select: Near(color: \"#c33923\", distance: 30) -> Otsu()"
        ]
    );
}

#[test]
fn setting_a_value_and_setting_it_back_gives_the_same_bytes() {
    let mut count = 0;
    for (path, text) in corpus() {
        for (target, other) in [
            ("red.select.distance", "12.25"),
            ("blue.select.color", "\"#123456\""),
            ("skin.levels", "3"),
            ("growth", "3"),
            ("net.points.0.0", "(9, 9, 9)"),
            ("smooth.levels", "4"),
            ("scan.color", "another.png"),
            ("doll.path", "another.obj"),
            ("photo.path", "a folder/another.png"),
        ] {
            fn put(
                text: &str,
                value: &str,
                path: &Path,
                target: &str,
            ) -> Result<maquette::EditedText, Vec<Diagnostic>> {
                let set = [(target.to_owned(), value.to_owned())];
                maquette::edit::set_values(path, text, &set, catalog(), &Options::default())
            }
            let Ok(new) = put(&text, other, &path, target) else { continue };
            let Some(before) = &new.changes[0].before else { continue };
            assert_ne!(new.text, text);
            let back = put(&new.text, before, &path, target).map(|edited| edited.text);
            assert_eq!(back, Ok(text.clone()), "{}: {target}", path.display());
            count += 1;
        }
    }
    assert!(count > 40, "{count}");
}

fn check_diff(old: &str, new: &str, expected: Expect) {
    expected.assert_eq(&differences(old, new).join("\n"));
}

#[test]
fn formatting_order_comments_and_defaults_make_no_difference() {
    let new = DOLL
        .replace(", connectivity: Eight", "")
        .replace("color: \"#c33923\", distance: 30.0", "distance: 30, color: \"#C33923\"")
        .replace("pick: Largest", "")
        .replace("// Let it grow.", "")
        .replace("image: \"scan.color\"", "image: \"scan\"")
        .replace("        \"grid\": Triangulate(range: \"blended\"),\n", "")
        .replace("    nodes: {", "    nodes: { \"grid\": Triangulate(range: \"blended\"),");
    check_diff(DOLL, &new, expect![""]);
}

#[test]
fn additions_removals_renames_rewirings_and_changes_are_told_apart() {
    let new = DOLL
        .replace("\"red\"", "\"nose-mask\"")
        .replace("\"growth\"", "\"grow\"")
        .replace("distance: 30.0", "distance: 31")
        .replace("        \"knots-u\": Knots(net: \"raised\", along: U, order: 3),\n", "")
        .replace("u: \"knots-u\"", "u: \"knots-v\"")
        .replace("\"model.ply\"", "\"skin.ply\"")
        .replace("    nodes: {", "    nodes: { \"edges\": Edges(image: \"scan.color\"),")
        .replace("levels\": Integer(default: 1, min: 0", "levels\": Integer(default: 2, min: 0");
    check_diff(
        DOLL,
        &new,
        expect![[r#"
        parameter grow: renamed, was growth
        parameter levels: changed default: 1 -> 2
        node nose-mask: renamed, was red
        node nose-mask: changed select.distance: 30 -> 31
        node knots-u: removed: Knots(along: U, net: "raised")
        node surface: rewired u: "knots-u" -> "knots-v"
        node edges: added: Edges(image: "scan")
        output skin.ply: renamed, was model.ply"#]],
    );
}

#[test]
fn a_chain_of_renamed_nodes_is_no_more_than_renamed() {
    let new = DOLL
        .replace("\"net\"", "\"points\"")
        .replace("\"raised\"", "\"moved\"")
        .replace("\"knots-u\"", "\"ku\"")
        .replace("\"knots-v\"", "\"kv\"")
        .replace("\"surface\"", "\"patch\"");
    check_diff(
        DOLL,
        &new,
        expect![[r#"
        node points: renamed, was net
        node moved: renamed, was raised
        node ku: renamed, was knots-u
        node kv: renamed, was knots-v
        node patch: renamed, was surface"#]],
    );
}

#[test]
fn the_form_of_a_text_keeps_the_ends_of_its_lines() {
    const TEXT: &str = "\u{feff}Graph(\n  format: 1, // a\n  /* b\n  c */ doc: \"d\ne\",\n)\n";
    let form = format_text(TEXT).unwrap();
    assert!(
        form.starts_with("Graph(\n    format: 1, // a\n") && form.contains("\"d\ne\""),
        "{form}"
    );
    fn windows(text: &str) -> String {
        text.replace('\n', "\r\n")
    }
    assert_eq!(format_text(&windows(TEXT)), Some(windows(&form)));
    assert_eq!(format_text(&windows(&form)), Some(windows(&form)));
    // The formatted form of a text with mixed line endings contains only line feeds.
    assert_eq!(format_text(&TEXT.replacen('\n', "\r\n", 1)), Some(form));
}
