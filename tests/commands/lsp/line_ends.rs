//! New text in edits has the line endings of the file.

use std::path::Path;

use serde_json::{Value as Json, json};

use super::editor::{Editor, uri};
use super::{FACE, Place, face};

const ENDS: [&str; 3] = ["\n", "\r\n", "\r"];

/// Collects all new texts in an answer.
fn new_texts<'a>(answer: &'a Json, found: &mut Vec<&'a str>) {
    match answer {
        Json::Object(fields) => {
            found.extend(fields.get("newText").and_then(Json::as_str));
            fields.values().for_each(|value| new_texts(value, found));
        }
        Json::Array(items) => items.iter().for_each(|value| new_texts(value, found)),
        _ => {}
    }
}

/// Checks the line endings in all new texts of an answer, and returns the number of these line endings.
#[track_caller]
fn check(answer: &Json, end: &str) -> usize {
    let mut texts = Vec::new();
    new_texts(answer, &mut texts);
    let mut count = 0;
    for text in texts {
        let rest = text.replace(end, "");
        assert!(!rest.contains(['\n', '\r']), "{text:?} in a file with {end:?}");
        count += text.matches(end).count();
    }
    count
}

fn replace_all(path: &Path, text: &str) -> Json {
    let lines = text.replace("\r\n", "\n").replace('\r', "\n").matches('\n').count();
    let range =
        json!({ "start": { "line": 0, "character": 0 }, "end": { "line": lines, "character": 0 } });
    json!({
        "textDocument": { "uri": uri(path) },
        "range": range,
        "context": { "diagnostics": [] },
        "options": { "tabSize": 4, "insertSpaces": true },
    })
}

#[test]
fn new_lines_end_as_the_lines_of_the_file() {
    for end in ENDS {
        let place = face();
        let path = place.path("face.ron");
        let text = FACE.replace("levels: 1", "levls: 1").replace(", lift:", ",\n  lift:");
        // A line comment ends only at a line feed, so a text with `\r` alone cannot have any.
        let text = if end == "\r" { without_comments(&text) } else { text };
        let text = text.replace('\n', end);
        let mut editor = place.editor();
        editor.open(&path, &text);
        let mut count = 0;
        for method in ["formatting", "rangeFormatting", "codeAction"] {
            let answer = editor.ask(&format!("textDocument/{method}"), replace_all(&path, &text));
            count += check(&answer, end);
        }
        assert!(count > 0, "nothing with a line end is written: {end:?}");
    }
}

fn without_comments(text: &str) -> String {
    let lines = text.lines().map(|line| line.split("//").next().unwrap_or_default());
    lines.map(|line| format!("{line}\n")).collect()
}

#[test]
fn a_formatted_file_has_the_ends_that_it_had() {
    let text = "Graph(\n  format: 1,\n nodes: {\n \"a\": Primitive(shape: Sphere(radius: 1.0)) },\n outputs: { \"a.ply\": \"a\" })\n";
    for end in ENDS {
        let place = Place::new(&[]);
        let path = place.path("x.ron");
        let text = text.replace('\n', end);
        place.write("x.ron", &text);
        place.run(&["fmt", "x.ron"]);
        let formatted = std::fs::read_to_string(&path).unwrap();
        let rest = formatted.replace(end, "");
        assert!(
            !rest.contains(['\n', '\r']) && formatted.matches(end).count() > 5,
            "{formatted:?}"
        );
        place.run(&["edit", "x.ron", "set", "a.shape=Sphere(radius: 2.0)"]);
        let rest = std::fs::read_to_string(&path).unwrap().replace(end, "");
        assert!(rest.contains("2.0") && !rest.contains(['\n', '\r']), "{rest:?}");
    }
}

#[test]
fn a_proposal_of_several_lines_has_the_ends_of_the_file() {
    let place = Place::new(&[]);
    for end in ENDS {
        let path = place.path("new.ron");
        let text = format!("{end}{end}Gra");
        let mut editor: Editor = place.editor();
        editor.open(&path, &text);
        let asked = json!({ "textDocument": { "uri": uri(&path) }, "position": { "line": 2, "character": 3 } });
        let answer = editor.ask("textDocument/completion", asked);
        assert!(check(&answer, end) > 3, "{answer}");
    }
}
