//! Edits in texts with syntax errors: an edit stays on its line and removes nothing else.
//!
//! `PROPTEST_RNG_SEED` selects the positions that are tried in large texts.

use std::path::Path;

use serde_json::{Value as Json, json};

use super::editor::{Editor, apply_edits, uri};
use super::{GRAPHS, Place, face, files};

/// Maximum length in bytes of a text of which all positions are tried.
const SMALL: usize = 700;

/// Number of positions that are tried in a longer text.
const SAMPLES: usize = 6;

const TEXT: &str = r##"Graph(
    format: 1,
    params: { "growth": Number(default: 1.0, unit: "mm"), "hue": Color(default: "#ffffff") },
    nodes: {
        // A "comment.
        "ball": ReadMesh(path: "ball.obj"), /* "another
        one */
        "häu😀t": Subdivide(mesh: "ball", scheme: Loop, levels: Expr("growth * 2
            + growth / 3")),
        "s": Transform(mesh: r#"häu😀t"#, translate: (0, Param("growth"), 0)),
    },
    outputs: { "b.ply": "s" },
)
"##;

struct Random(u64);

impl Random {
    fn next_below(&mut self, end: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (self.0 >> 33) as usize % end.max(1)
    }
}

/// Splits a text into lines as editors do; each line includes its line ending.
fn lines(text: &str) -> Vec<&str> {
    let (mut lines, mut start) = (Vec::new(), 0);
    for (at, c) in text.char_indices() {
        let ends = c == '\n' || c == '\r' && !text[at..].starts_with("\r\n");
        if ends {
            lines.push(&text[start..=at]);
            start = at + 1;
        }
    }
    lines.push(&text[start..]);
    lines
}

fn without_end(line: &str) -> &str {
    line.trim_end_matches(['\r', '\n'])
}

/// Converts a column in UTF-16 units to a byte offset. The column must be on this line.
fn column(line: &str, units: u64) -> usize {
    let line = without_end(line);
    let mut passed = 0;
    for (at, c) in line.char_indices() {
        if passed == units {
            return at;
        }
        passed += c.len_utf16() as u64;
    }
    assert_eq!(passed, units, "there is no such column in `{line}`");
    line.len()
}

/// Applies an edit, which must stay on line `line` and contain column `at`.
fn apply_edit(lines: &[&str], edit: &Json, line: usize, at: u64) -> String {
    let range = &edit["range"];
    fn number(path: &str, range: &Json) -> u64 {
        range.pointer(path).and_then(Json::as_u64).unwrap()
    }
    assert_eq!(number("/start/line", range), line as u64, "the edit is on another line");
    assert_eq!(number("/end/line", range), line as u64, "the edit is not on one line");
    let (start, end) = (number("/start/character", range), number("/end/character", range));
    assert!(start <= at && at <= end, "{start}..{end} does not contain {at}");
    let old = lines[line];
    let (start, end) = (column(old, start), column(old, end));
    // The edit must not remove a quote, except for an escaped one inside of a string.
    let gone = &old[start..end];
    assert!(!gone.contains('"') || gone.contains('\\'), "`{gone}` is taken away");
    let new = edit["newText"].as_str().unwrap();
    let (before, behind) = (lines[..line].concat(), lines[line + 1..].concat());
    format!("{before}{}{new}{}{behind}", &old[..start], &old[end..])
}

/// Applies each completion at a position separately. Returns the number of completions.
fn complete(editor: &mut Editor, path: &Path, text: &str, at: usize) -> usize {
    let (lines, mut line, mut start) = (lines(text), 0, 0);
    while start + lines[line].len() <= at && line + 1 < lines.len() {
        start += lines[line].len();
        line += 1;
    }
    let units = text[start..at].encode_utf16().count() as u64;
    let position = json!({ "line": line, "character": units });
    let asked = json!({ "textDocument": { "uri": uri(path) }, "position": position });
    let found = editor.ask("textDocument/completion", asked);
    // A file of another program gets no completions.
    let items = found["items"].as_array().map_or(&[][..], Vec::as_slice);
    for item in items {
        assert!(item.get("additionalTextEdits").is_none(), "{item}");
        assert!(!item["label"].as_str().unwrap().contains(['\n', '\r']), "{item}");
        let new = apply_edit(&lines, &item["textEdit"], line, units);
        // The text before and after the edited line is unchanged.
        let (before, behind) = (&text[..start], &text[start + lines[line].len()..]);
        assert!(before.len() + behind.len() <= new.len());
        assert!(new.starts_with(before) && new.ends_with(behind));
    }
    items.len()
}

/// The text and position that are tested. If the test fails, they are printed.
struct Case<'a> {
    seed: u64,
    text: &'a str,
    at: usize,
}

impl Drop for Case<'_> {
    #[expect(clippy::print_stdout, reason = "says which case failed")]
    fn drop(&mut self) {
        if std::thread::panicking() {
            let (before, behind) = self.text.split_at(self.at);
            println!("PROPTEST_RNG_SEED={}\n{before}<HERE>{behind}", self.seed);
        }
    }
}

fn boundaries(text: &str) -> Vec<usize> {
    (0..=text.len())
        .filter(|at| {
            text.is_char_boundary(*at)
                && !(text[..*at].ends_with('\r') && text[*at..].starts_with('\n'))
        })
        .collect()
}

/// Returns the byte offsets of all occurrences of the given letters in a text.
fn places_of(text: &str, letters: &[char]) -> Vec<usize> {
    text.match_indices(letters).map(|(at, _)| at).collect()
}

fn remove_char(text: &str, at: usize) -> String {
    let mut text = text.to_owned();
    text.remove(at);
    text
}

/// Returns versions of a text with syntax errors.
fn damaged_texts(text: &str, random: &mut Random, all: bool) -> Vec<String> {
    let mut texts = vec![text.to_owned(), text.trim_end().to_owned()];
    for letters in [&['"'][..], &['(', ')', '[', ']', '{', '}']] {
        let places = places_of(text, letters);
        match all {
            true => texts.extend(places.iter().map(|&at| remove_char(text, at))),
            false => {
                texts.extend(
                    places.get(random.next_below(places.len())).map(|&at| remove_char(text, at)),
                );
            }
        }
    }
    let cuts = boundaries(text);
    let count = if all { 12 } else { 1 };
    texts.extend((0..count).map(|_| text[..cuts[random.next_below(cuts.len())]].to_owned()));
    texts
}

#[test]
fn a_completion_changes_its_line_alone_in_any_text() {
    let seed = std::env::var("PROPTEST_RNG_SEED").ok().and_then(|seed| seed.parse().ok());
    let seed = seed.unwrap_or(20_070_115_u64);
    let mut random = Random(seed);
    let place = face();
    let path = place.path("new.ron");
    let mut editor = place.editor();
    let (mut asked, mut found) = (0, 0);
    let mut check = |text: &str, random: &mut Random, samples: usize| {
        editor.open(&path, text);
        let mut at = boundaries(text);
        while samples < at.len() {
            at.swap_remove(random.next_below(at.len()));
        }
        for at in at {
            let _told = Case { seed, text, at };
            found += complete(&mut editor, &path, text, at);
            asked += 1;
        }
    };
    // In a small text, all positions are tried.
    for text in [
        "",
        "\n",
        "\"",
        "Gra",
        "Graph(nodes: {\"a\": Subdivide(mesh: \"\n \"b\": Merge(meshes: [\"",
        "Graph(nodes: {\"a\": ReadMesh(path: \"\r\n  }, outputs: { \"x.ply\": \"a\" })\r\n",
        "Graph(nodes: {\"a\": ReadMesh(path: \"ball\r  \"b\": ReadMesh(path: \"l\")\r",
        "Graph(params: {\"g\": Number(default: 1.0)}, nodes: {\"a\": Transform(scale: Expr(\"g *\n  g + \n\n g\"))})",
        "Graph(params: {\"g\": Number(default: 1.0)}, nodes: {\"a\": Transform(scale: Expr(\"g * \n  \"b\": Merge()})",
        "Graph(use: {\"N\": \"lib/\n\"}, nodes: {\"😀\": N(mesh: \"😀\nä\n\")})",
        "Graph(nodes: {\"a\": N(mesh: r#\"a\nb\"#), \"c\": N(mesh: r#\"a\n \"d\": N(mesh: \"",
        "Graph(nodes: { // \"a\n \"b\": /* \" \n */ Merge(meshes: [\n",
        "Graph(params: {\n \"a\n\": Number(), \"b\n c\": Number(unit: \"\n) }, nodes: {\"s\": Transform(scale: Param(\"\n",
        "Patch(of: \"face.ron\", nodes: { \"sm\n \"nose\": (lift: 2) }, params: {\"\n",
        "Test(graph: \"face.ron\n, cases: { \"a\": (set: { \"\n",
        "Sweep(graph: \"\n over: Values(\"\n",
    ] {
        assert!(text.len() <= SMALL);
        check(text, &mut random, usize::MAX);
    }
    // One text is tried in all its damaged versions, with all kinds of line endings.
    for ends in ["\n", "\r\n", "\r"] {
        for text in damaged_texts(&TEXT.replace('\n', ends), &mut random, true) {
            check(&text, &mut random, SAMPLES);
        }
    }
    let mut graphs = Vec::new();
    files(&std::fs::canonicalize(GRAPHS).unwrap(), &mut graphs);
    for graph in graphs.iter().skip(random.next_below(9)).step_by(9) {
        let text = std::fs::read_to_string(graph).unwrap();
        for text in damaged_texts(&text, &mut random, false) {
            check(&text, &mut random, SAMPLES);
        }
    }
    assert!(asked > 2_000 && found > 5_000, "{found} completions at {asked} positions");
}

#[test]
fn a_completion_in_a_string_without_an_end_leaves_the_lines_behind_it() {
    let place = face();
    let path = place.path("new.ron");
    let mut editor = place.editor();
    // Checks the text that results from the completion with this label at the `|`.
    fn check(text: &str, label: &str, expected: &str, editor: &mut Editor, path: &Path) {
        let at = text.find('|').unwrap();
        let text = text.replacen('|', "", 1);
        editor.open(path, &text);
        let (line, start) =
            (text[..at].matches('\n').count(), text[..at].rfind('\n').map_or(0, |at| at + 1));
        let position = json!({ "line": line, "character": at - start });
        let asked = json!({ "textDocument": { "uri": uri(path) }, "position": position });
        let found = editor.ask("textDocument/completion", asked);
        let item = found["items"].as_array().unwrap().iter().find(|item| item["label"] == label);
        let item = item.unwrap_or_else(|| panic!("no `{label}` in {found}"));
        assert_eq!(
            apply_edit(&lines(&text), &item["textEdit"], line, (at - start) as u64),
            expected
        );
    }
    let head =
        "Graph(params: { \"g\": Number(default: 1.0) }, nodes: { \"b\": ReadMesh(path: \"x\"),\n";
    let rest = "\n \"t\": Subdivide(mesh: \"b\", levels: 1),\n}, outputs: { \"b.ply\": \"t\" })\n";
    let mut check = |line: &str, label: &str, expected: &str| {
        check(
            &format!("{head}{line}{rest}"),
            label,
            &format!("{head}{expected}{rest}"),
            &mut editor,
            &path,
        );
    };
    check("\"s\": Subdivide(mesh: \"|", "b", "\"s\": Subdivide(mesh: \"b");
    check("\"s\": Subdivide(mesh: \"b|", "b", "\"s\": Subdivide(mesh: \"b");
    check(
        "\"s\": Subdivide(mesh: \"|, levels: 2),",
        "b",
        "\"s\": Subdivide(mesh: \"b, levels: 2),",
    );
    check("\"s\": Transform(scale: Expr(\"g * |", "g", "\"s\": Transform(scale: Expr(\"g * g");
    check(
        "\"s\": Transform(scale: Expr(\"|g * 2\")),",
        "g",
        "\"s\": Transform(scale: Expr(\"g * 2\")),",
    );
    check(
        "\"s\": Transform(scale: Expr(\"2 *\n|\n + 3\")),",
        "g",
        "\"s\": Transform(scale: Expr(\"2 *\ng\n + 3\")),",
    );
    // The lines after a string without an end are parsed normally.
    check(
        "\"s\": Subdivide(mesh: \"\n), \"u\": Subdivide(mesh: \"|\"),",
        "b",
        "\"s\": Subdivide(mesh: \"\n), \"u\": Subdivide(mesh: \"b\"),",
    );
}

/// Tests quick fixes, renaming and formatting in texts with syntax errors.
#[test]
fn other_edits_of_broken_texts_leave_their_lines_too() {
    let place = Place::new(&[]);
    let path = place.path("new.ron");
    let mut editor = place.editor();
    let mut random = Random(20_070_115);
    for ends in ["\n", "\r\n", "\r"] {
        let whole = TEXT.replace('\n', ends);
        for text in damaged_texts(&whole, &mut random, true) {
            editor.open(&path, &text);
            let lines = lines(&text);
            let file = json!({ "uri": uri(&path) });
            let last = lines.len() - 1;
            let range = json!({ "start": { "line": 0, "character": 0 }, "end": { "line": last, "character": 0 } });
            let asked = json!({ "textDocument": file, "range": range, "context": { "diagnostics": [], "only": ["quickfix"] } });
            let found = editor.ask("textDocument/codeAction", asked);
            for edit in found
                .as_array()
                .unwrap()
                .iter()
                .flat_map(|it| it["edit"]["changes"][uri(&path)].as_array().unwrap())
            {
                let [start, end] =
                    ["start", "end"].map(|side| edit["range"][side]["line"].as_u64().unwrap());
                assert_eq!(start, end, "a fix over several lines: {edit}\n{text}");
                assert!(start as usize <= last);
            }
            for at in places_of(&text, &['a', 'g']).into_iter().step_by(5) {
                let line = self::lines(&text[..at]).len() - 1;
                let start = lines[..line].iter().map(|line| line.len()).sum::<usize>();
                let units = text[start..at].encode_utf16().count() as u64;
                let asked = json!({ "textDocument": file, "position": { "line": line, "character": units }, "newName": "another" });
                let Ok(found) = editor.try_ask("textDocument/rename", asked) else { continue };
                for edit in found["changes"][uri(&path)].as_array().unwrap() {
                    let line = edit["range"]["start"]["line"].as_u64().unwrap() as usize;
                    let from = edit["range"]["start"]["character"].as_u64().unwrap();
                    drop(apply_edit(&lines, edit, line, from));
                }
            }
            // Formatting moves existing text and removes none. It leaves a text with syntax errors unchanged.
            let asked =
                json!({ "textDocument": file, "options": { "tabSize": 4, "insertSpaces": true } });
            let edits = editor.ask("textDocument/formatting", asked);
            if ends == "\n" {
                fn letters(text: &str) -> String {
                    text.chars().filter(|c| !c.is_whitespace() && *c != ',').collect::<String>()
                }
                assert_eq!(letters(&apply_edits(&text, &edits)), letters(&text));
            }
        }
    }
}
