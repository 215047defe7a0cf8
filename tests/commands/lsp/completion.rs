//! Completions while the user types.

use serde_json::json;

use super::editor::{Editor, uri};
use super::{GRAPHS, face, files};
use crate::thorough::is_thorough;

#[test]
fn completion_proposes_what_fits() {
    let place = face();
    let path = place.path("new.ron");
    let mut editor = place.editor();
    // Checks the completions at the end of a text: labels that must be among the first five, and labels that must not be proposed.
    let check = |editor: &mut Editor, text: &str, wanted: &[&str], not: &[&str]| {
        editor.open(&path, text);
        let found = editor.complete_at(&path, text, text);
        let first: Vec<_> = found.iter().take(5).map(String::as_str).collect();
        for wanted in wanted {
            assert!(first.contains(wanted), "{wanted} in {found:?} behind {text}");
        }
        for not in not {
            assert!(!found.iter().any(|it| it == not), "{not} in {found:?} behind {text}");
        }
    };
    let e = &mut editor;
    check(e, "Gr", &["Graph"], &[]);
    check(e, "Graph(", &["format", "nodes", "outputs"], &[]);
    check(e, "Graph(format: ", &["1"], &[]);
    check(e, "Graph(format: 1, ", &["nodes", "outputs"], &["format"]);
    check(e, "Graph(use: { \"Nose\": \"", &["lib/", "face.ron"], &["ball.obj"]);
    check(e, "Graph(use: { \"Nose\": \"lib/", &["lib/nose.ron"], &[]);
    check(e, "Graph(inputs: { \"a\": Me", &["Mesh"], &[]);
    check(e, "Graph(inputs: { \"a\": Mesh(wants: [Clo", &["Closed"], &[]);
    check(e, "Graph(params: { \"a\": Nu", &["Number"], &[]);
    check(e, "Graph(params: { \"a\": Number(", &["default", "min", "max", "unit"], &["of"]);
    check(e, "Graph(params: { \"a\": Number(unit: \"", &["mm", "deg"], &[]);
    check(e, "Graph(nodes: { \"a\": Thre", &["Threshold"], &[]);
    let head = "Graph(use: { \"Nose\": \"lib/nose.ron\" }, params: { \"growth\": Number(default: 1.0, unit: \"mm\"), \"hue\": Color(default: \"#ffffff\") }, nodes: { \"scan\": ReadCapture(color: \"a.png\"), \"ball\": ReadMesh(path: \"ball.obj\"), ";
    let check = |editor: &mut Editor, rest: &str, wanted: &[&str], not: &[&str]| {
        check(editor, &format!("{head}{rest}"), wanted, not);
    };
    check(e, "\"a\": ", &["Nose", "Subdivide"], &[]);
    check(e, "\"a\": Nose(", &["mesh", "lift"], &[]);
    check(e, "\"a\": Nose(mesh: ", &["ball"], &["scan.color", "a"]);
    check(e, "\"a\": Nose(mesh: \"", &["ball"], &["scan.color", "a"]);
    check(e, "\"a\": Nose(lift: ", &["1.0", "Param(\"growth\")", "mm"], &["Param(\"hue\")", "deg"]);
    check(e, "\"a\": Nose(lift: Param(\"", &["growth"], &[]);
    check(e, "\"a\": Nose(lift: Expr(\"2 * gr", &["growth"], &[]);
    check(e, "\"a\": ReadMesh(path: \"", &["ball.obj"], &["face.ron"]);
    check(e, "\"a\": ReadMesh(", &["path", "unit"], &[]);
    check(
        e,
        "\"a\": Subdivide(mesh: \"ball\", scheme: ",
        &["Loop", "CatmullClark", "DooSabin"],
        &[],
    );
    check(e, "\"a\": Subdivide(mesh: \"ball\", limit: ", &["true", "false"], &[]);
    check(e, "\"a\": Threshold(image: \"", &["scan.color"], &["ball", "scan.range"]);
    check(e, "\"a\": Threshold(image: \"scan.color\", ", &["select"], &["image"]);
    check(e, "\"a\": Threshold(image: \"scan.color\", select: Near(", &["color", "distance"], &[]);
    check(
        e,
        "\"a\": Threshold(image: \"scan.color\", select: Near(color: ",
        &["Param(\"hue\")"],
        &["Param(\"growth\")"],
    );
    check(e, "\"a\": Merge(meshes: [\"", &["ball"], &["scan.color"]);
    check(e, "\"a\": ForEach(", &["graph", "over", "with"], &[]);
    check(e, "\"a\": ForEach(graph: \"", &["Nose"], &[]);
    check(e, "\"a\": ForEach(graph: \"Nose\", over: [(", &["lift"], &["path"]);
    check(e, "\"a\": ForEach(graph: \"Nose\", each: \"", &["mesh"], &["lift"]);
    check(e, "\"a\": Switch(cases: { \"one\": \"", &["ball", "scan.color"], &[]);
    check(e, "\"a\": Nose(mesh: \"ball\") }, outputs: { \"x.ply\": \"", &["a"], &[]);
    check(e, "}, outputs: { \"x.ply\": \"ball\" }, expect: [Clo", &["Closed"], &[]);
    check(e, "}, outputs: { \"x.ply\": \"ball\" }, expect: [Closed(\"", &["x.ply", "ball"], &[]);
    check(
        e,
        "}, outputs: { \"x.ply\": \"ball\" }, expect: [Count(of: \"ball\", ",
        &["what"],
        &["of"],
    );
    let check = |editor: &mut Editor, text: &str, wanted: &[&str]| {
        editor.open(&path, text);
        let found = editor.complete_at(&path, text, text);
        wanted.iter().for_each(|wanted| {
            assert!(
                found.iter().take(5).any(|it| it == wanted),
                "{wanted} in {found:?} behind {text}"
            );
        });
    };
    check(e, "Patch(format: 1, of: \"face.ron\", params: { \"", &["growth"]);
    check(e, "Patch(format: 1, of: \"face.ron\", nodes: { \"sm", &["smooth"]);
    check(e, "Patch(format: 1, of: \"face.ron\", nodes: { \"smooth\": (", &["levels", "scheme"]);
    check(e, "Patch(format: 1, of: \"face.ron\", nodes: { \"nose\": (li", &["lift"]);
    check(e, "Test(graph: \"", &["face.ron"]);
    check(e, "Test(graph: \"face.ron\", cases: { \"a\": (set: { \"gr", &["growth"]);
    check(e, "Test(graph: \"face.ron\", cases: { \"a\": (set: { \"smooth.le", &["smooth.levels"]);
    check(e, "Test(graph: \"face.ron\", compare: { \"", &["face.ply"]);
    check(e, "Test(graph: \"face.ron\", compare: { \"face.ply\": Mesh(ma", &["max"]);
}

#[test]
fn functions_of_expressions_are_proposed_and_their_parentheses_written_once() {
    let place = face();
    let path = place.path("new.ron");
    let mut editor = place.editor();
    let head = "Graph(params: { \"growth\": Number(default: 1.0, unit: \"mm\") }, nodes: { \"ball\": ReadMesh(path: \"ball.obj\"), \"a\": Transform(mesh: \"ball\", translate: (0, Expr(\"";
    // Returns the completions at the bar `|`: labels and inserted texts.
    let mut proposed = |text: &str| {
        let (before, behind) = text.split_once('|').unwrap();
        let whole = format!("{head}{before}{behind}");
        editor.open(&path, &whole);
        let mark = format!("{head}{before}");
        let found = editor.ask_at("textDocument/completion", &path, &whole, &mark);
        let items = found["items"].as_array().unwrap().iter();
        fn word(json: &serde_json::Value) -> String {
            json.as_str().unwrap().to_owned()
        }
        let of =
            |item: &serde_json::Value| (word(&item["label"]), word(&item["textEdit"]["newText"]));
        items.map(of).collect::<Vec<_>>()
    };
    let functions = [
        "min", "max", "clamp", "abs", "floor", "round", "sqrt", "pow", "sin", "cos", "tan", "asin",
        "acos", "atan", "atan2", "if",
    ];
    for text in ["|", "growth * |", "max(1, |", "|\"), 0))", "if(growth > 1, |"] {
        let found = proposed(text);
        assert_eq!(found[0].0, "growth", "{text}: {found:?}");
        for name in functions {
            let named = found.iter().filter(|(label, _)| label == name);
            assert_eq!(named.count(), 1, "{name} behind {text} in {found:?}");
        }
    }
    for name in functions {
        for text in [format!("{name}|"), format!("2 * {name}|\"), 0))"), format!("growth+{name}|")]
        {
            let (label, written) = &proposed(&text)[0];
            assert_eq!((&label[..], &written[..]), (name, &format!("{name}($0)")[..]), "{text}");
        }
        // The text already has a parenthesis after the name, so only the name is inserted.
        for text in
            [format!("{name}|(growth)\"), 0))"), format!("1 + {}|{} (2)", &name[..1], &name[1..])]
        {
            let found = proposed(&text);
            let (_, written) = found.iter().find(|(label, _)| label == name).unwrap();
            assert_eq!(written, name, "{text}");
        }
    }
    assert_eq!(proposed("cla|mp(1)")[0], ("clamp".to_owned(), "clamp".to_owned()));
    assert_eq!(proposed("tru|")[0], ("true".to_owned(), "true".to_owned()));
    assert_eq!(proposed("inc|")[0], ("inch".to_owned(), "inch($0)".to_owned()));
}

#[test]
fn completion_bears_every_cut() {
    let mut texts = Vec::new();
    files(&std::fs::canonicalize(GRAPHS).unwrap(), &mut texts);
    let place = face();
    let mut editor = place.editor();
    let (mut asked, mut met, mut named) = (0, 0, 0);
    let step = if is_thorough() { 3 } else { 9 };
    for path in
        texts.iter().filter(|path| !path.to_string_lossy().contains("/nodes/")).step_by(7).take(20)
    {
        let text = std::fs::read_to_string(path).unwrap();
        for at in (0..text.len()).filter(|&at| text.is_char_boundary(at)).step_by(step) {
            let cut = &text[..at];
            editor.open(path, cut);
            let found = editor.complete_at(path, cut, cut);
            asked += 1;
            // If at least half of a word is typed, the word must be among the first five completions in nearly all cases.
            let typed =
                cut.chars().rev().take_while(|c| c.is_alphanumeric() || "-_.".contains(*c)).count();
            let rest = text[at..]
                .chars()
                .take_while(|c| c.is_alphanumeric() || "-_.".contains(*c))
                .count();
            let word = &text[at - typed.min(at)
                ..at + text[at..].chars().take(rest).map(char::len_utf8).sum::<usize>()];
            if typed < 2 || rest == 0 || rest > typed || found.is_empty() {
                continue;
            }
            named += 1;
            met += usize::from(
                found.iter().take(5).any(|it| it.starts_with(word) || it.contains(word)),
            );
        }
    }
    assert!(asked * step > 15_000, "{asked}");
    assert!(named * step > 1_500 && 100 * met >= 97 * named, "{met} of {named}");
}

/// Unfinished texts: strings, brackets or comments without an end, various line endings, and characters with several UTF-16 units.
const BROKEN: [&str; 9] = [
    "Graph(\n    format: 1,\n    nodes: {\n        \"b\": Primitive(shape: Sphere(radius: 2.0)),\n        \"s\": Subdivide(mesh: \"\n        \"t\": Subdivide(mesh: \"b\", levels: 1),\n    },\n    outputs: { \"b.ply\": \"t\" },\n)\n",
    "Graph(format: 1, params: { \"g\": Number(default: 1.0) },\n nodes: {\n  \"b\": Primitive(shape: Sphere(radius: Expr(\"g * \n  \"t\": Subdivide(mesh: \"b\"),\n })\n",
    "Graph(nodes: {\r\n \"b\": ReadMesh(path: \"ba\r\n \"c\": Transform(mesh: \"b\"),\r\n})\r\n",
    "Graph(nodes: {\r \"b\": ReadMesh(path: \"ba\r \"c\": Transform(mesh: \"b\"),\r})\r",
    "Graph(\n nodes: { \"\u{1f600}\u{e4}\": ReadMesh(path: r#\"ball\n obj\"#), /* open\n \"x\": Sub\n",
    "Graph(use: { \"Nose\": \"lib/\n }, nodes: { \"n\": Nose(mesh: \"a\\\"\n\", lift: Param(\"\n) })",
    "Sweep(\n graph: \"face.ron,\n over: Values(\"gro\n [1, 2]),\n)\n",
    "Test(graph: \"face.ron\", cases: { \"a\": (set: { \"grow\n\": 3 }) })\n",
    "Patch(of: \"face.ron\", params: {\n \"gro\n}, nodes: { \"smooth\": (lev\n",
];

#[test]
fn every_completion_changes_its_own_line_around_the_cursor_only() {
    let place = face();
    let path = place.path("new.ron");
    let mut editor = place.editor();
    let mut applied = 0;
    for text in BROKEN {
        editor.open(&path, text);
        let lines: Vec<_> =
            text.replace("\r\n", "\n").replace('\r', "\n").split('\n').map(str::to_owned).collect();
        for (line, content) in lines.iter().enumerate() {
            let mut columns: Vec<_> = content
                .chars()
                .scan(0, |column, c| {
                    let at = *column;
                    *column += c.len_utf16();
                    Some(at)
                })
                .collect();
            columns.push(content.encode_utf16().count());
            for column in columns {
                let position = json!({ "line": line, "character": column });
                let asked = json!({ "textDocument": { "uri": uri(&path) }, "position": position });
                let found = editor.ask("textDocument/completion", asked);
                for item in found["items"].as_array().into_iter().flatten() {
                    let range = &item["textEdit"]["range"];
                    fn number(way: &str, range: &serde_json::Value) -> usize {
                        range.pointer(way).unwrap().as_u64().unwrap() as usize
                    }
                    let is_of_line =
                        number("/start/line", range) == line && number("/end/line", range) == line;
                    let (start, end) =
                        (number("/start/character", range), number("/end/character", range));
                    assert!(
                        is_of_line && start <= column && column <= end,
                        "{item} at {position} of {text:?}"
                    );
                    // The replaced range is a word or the inside of a string, and never contains a bracket or a quote.
                    let units = Vec::from_iter(content.encode_utf16());
                    let replaced = String::from_utf16(&units[start..end]).unwrap();
                    let is_kept = |c: char| "(){}[]:\"".contains(c);
                    assert!(!replaced.contains(is_kept), "{replaced:?} at {position} of {text:?}");
                    applied += 1;
                }
            }
        }
    }
    assert!(applied > 3_000, "{applied}");
}

#[test]
fn a_node_comes_with_its_required_ports_and_is_found_by_other_words() {
    let place = face();
    let path = place.path("new.ron");
    let mut editor = place.editor();
    fn first_item(typed: &str, editor: &mut Editor, path: &std::path::Path) -> serde_json::Value {
        let text = format!("Graph(nodes: {{ \"a\": {typed}");
        editor.open(path, &text);
        let found = editor.ask_at("textDocument/completion", path, &text, &text);
        found["items"][0].clone()
    }
    let item = first_item("Decim", &mut editor, &path);
    assert_eq!((&item["label"], &item["filterText"]), (&"Simplify".into(), &"Decim".into()));
    assert_eq!(item["textEdit"]["newText"], "Simplify(mesh: \"$0\")");
    let item = first_item("Merg", &mut editor, &path);
    assert_eq!(item["textEdit"]["newText"], "Merge(meshes: [$0])");
    assert_eq!(item.get("filterText"), None);
}
