//! Graph files whose lines begin with commas. Every tool treats them like the same graph with commas at the ends of lines.

use std::path::{Path, PathBuf};

use expect_test::expect;
use maquette::{Edit, Extraction, Options, Source};

use super::{add, catalog, edit, remove, rename};
use crate::ron_files::ron_files;

const LEADING: &str = r#"Graph(
    format: 1
    , nodes: {
        "mesh": ReadMesh(path: "t.obj") // the first
        // about red
        , "red": Transform(mesh: "mesh", translate: (0, 0, 1))
        // about blue
        , "blue": Transform(
            mesh: "red"
            // how far
            , translate: (0, 0, 2)
        )
        // about green
        , "green": Transform(mesh: "mesh", translate: (0, 0, 3))
    }
    // the files
    , outputs: { "r.obj": "red" }
)
"#;

/// Returns the text in canonical form, as the formatter writes it.
fn form(text: &str) -> String {
    maquette::edit::format_text(Path::new("graph.ron"), text)
        .unwrap_or_else(|why| panic!("{why:?}\n{text}"))
}

fn apply_edits(text: &str, edits: &[Edit]) -> Option<String> {
    edit(Path::new("nowhere/graph.ron"), text, edits).ok().map(|edited| edited.text)
}

/// Moves the commas of a text in canonical form to the beginnings of lines. If `apart` is true, the comma of an entry with a comment above
/// is put before that comment.
fn leading(text: &str, apart: bool) -> String {
    let mut lines: Vec<String> = Vec::new();
    let mut is_due = false;
    for line in text.lines() {
        let code = line.trim_start();
        let indent = &line[..line.len() - code.len()];
        let is_note = code.is_empty() || code.starts_with("//");
        let (mut code, note) = match code.find(", //").filter(|_| !is_note) {
            Some(at) => (code[..=at].to_owned(), &code[at + 1..]),
            None => (code.to_owned(), ""),
        };
        let begins = is_due && !is_note;
        if !is_note {
            is_due = code.ends_with(',');
            code.truncate(code.len() - usize::from(is_due));
        }
        let comma = if begins && !code.starts_with([')', ']', '}']) { ", " } else { "" };
        lines.push(format!("{indent}{comma}{code}{note}"));
        let last = lines.len() - 1;
        if apart && !comma.is_empty() && last > 0 && lines[last - 1].trim_start().starts_with("//")
        {
            let note = lines[last - 1].trim_start().to_owned();
            lines[last - 1] = format!("{indent}, {note}");
            lines[last] = format!("{indent}{code}");
        }
    }
    lines.join("\n") + "\n"
}

#[test]
fn comments_stay_above_their_entries() {
    expect![[r#"
        Graph(
            format: 1,
            nodes: {
                "mesh": ReadMesh(path: "t.obj"), // the first
                // about red
                "red": Transform(mesh: "mesh", translate: (0, 0, 1)),
                // about blue
                "blue": Transform(
                    mesh: "red",
                    // how far
                    translate: (0, 0, 2),
                ),
                // about green
                "green": Transform(mesh: "mesh", translate: (0, 0, 3)),
            },
            // the files
            outputs: { "r.obj": "red" },
        )
    "#]]
    .assert_eq(&form(LEADING));
}

#[test]
fn edits_keep_the_commas_of_the_author() {
    fn check(edits: &[Edit], changes: &[(&str, &str)]) {
        let expected = changes.iter().fold(LEADING.to_owned(), |text, (old, new)| {
            assert!(text.contains(old), "{old}");
            text.replacen(old, new, 1)
        });
        assert_eq!(apply_edits(LEADING, edits).as_deref(), Some(&expected[..]));
    }
    let green = "        , \"green\": Transform(mesh: \"mesh\", translate: (0, 0, 3))\n";
    check(&[remove("green", false)], &[(green, "")]);
    let blue = &LEADING[LEADING.find("        , \"blue\"").unwrap()
        ..LEADING.find("        // about green").unwrap()];
    check(&[remove("blue", false)], &[(blue, "")]);
    check(&[rename("blue", "teal")], &[("\"blue\"", "\"teal\"")]);
    let red = "        , \"red\": Transform(mesh: \"mesh\", translate: (0, 0, 1))\n";
    let new = format!("{red}        , \"new\": Transform(mesh: \"mesh\")\n");
    check(&[add("new", "Transform", &[("mesh", "mesh")], Some("red"))], &[(red, &new)]);
    let set = Edit::Set { target: "blue.scale".into(), value: "(1, 2, 1)".into() };
    let far = "            , translate: (0, 0, 2)\n";
    check(&[set], &[(far, &format!("{far}            , scale: (1, 2, 1)\n"))]);
}

#[test]
fn nodes_become_a_graph_with_their_comments_and_come_back() {
    let nodes = ["red", "blue"].map(str::to_owned).to_vec();
    let wish =
        Extraction { nodes, to: Some(PathBuf::from("nowhere/two.ron")), ..Extraction::default() };
    let here = Path::new("nowhere/graph.ron");
    let options = Options { files: maquette::Files::Ignored, ..Options::default() };
    let done = maquette::edit::extract(here, LEADING, &wish, catalog(), &options).unwrap();
    for comment in ["// about red", "// about blue", "// how far"] {
        assert!(done.text.contains(comment), "{}", done.text);
        assert!(!done.edited.text.contains(comment), "{}", done.edited.text);
    }
    assert!(
        done.edited.text.contains("\n        // about green\n        , \"green\""),
        "{}",
        done.edited.text
    );
    let options = options.with_text("nowhere/two.ron", leading(&done.text, false));
    let back = maquette::edit::inline(here, &done.edited.text, "two", catalog(), &options).unwrap();
    assert!(
        form(&back.text).contains("        // about blue\n        \"blue\": Transform("),
        "{}",
        back.text
    );
    assert!(back.text.contains("\n        // about green\n        , \"green\""), "{}", back.text);
}

#[test]
fn both_may_change_a_graph() {
    let start = LEADING.find("        // about blue").unwrap();
    let end = LEADING.find("        // about green").unwrap();
    let ours = [&LEADING[..start], &LEADING[end..]].concat();
    let theirs = LEADING.replace("about green", "all about green");
    let texts = [LEADING, &ours, &theirs]
        .map(|text| Source { name: "graph.ron".into(), text: text.to_owned() });
    let merged =
        maquette::edit::merge("graph.ron".as_ref(), [&texts[0], &texts[1], &texts[2]], catalog());
    assert!(merged.conflicts.is_empty() && !merged.by_lines, "{merged:?}");
    assert_eq!(merged.text, ours.replace("about green", "all about green"));
}

#[test]
fn each_graph_of_the_project_is_the_same_with_leading_commas() {
    let mut count = 0;
    for path in ron_files(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../graphs")) {
        let text = std::fs::read_to_string(&path).unwrap();
        let name = path.to_string_lossy();
        if [".pins.ron", ".lock.ron"].iter().any(|end| name.ends_with(end)) || text.contains("/*") {
            continue;
        }
        let text = form(&text);
        for apart in [false, true] {
            let other = leading(&text, apart);
            assert_eq!(form(&other), text, "{name}\n{other}");
            if !text.contains("\nGraph(") && !text.starts_with("Graph(") || apart && count % 3 > 0 {
                continue;
            }
            count += 1;
            let nodes = ["scan", "red", "mesh", "skin", "net"];
            for node in
                nodes.into_iter().filter(|node| text.contains(&format!("        \"{node}\": ")))
            {
                for edit in [rename(node, "other-name"), remove(node, true)] {
                    let [one, two] =
                        [&text, &other].map(|text| apply_edits(text, std::slice::from_ref(&edit)));
                    assert_eq!(one.map(|it| form(&it)), two.map(|it| form(&it)), "{name} {edit:?}");
                }
            }
        }
    }
    assert!(20 < count, "{count}");
}
