//! Quick fixes that add the missing fields of a node.

use serde_json::{Value as Json, json};

use super::Place;
use super::editor::{Editor, apply_edits, uri};

/// Returns the titles of the quick fixes in a text, each with the text after the fix.
fn fixes(editor: &mut Editor, place: &Place, text: &str) -> Vec<(String, String)> {
    let path = place.path("x.ron");
    editor.open(&path, text);
    let lines = text.matches('\n').count();
    let range =
        json!({ "start": { "line": 0, "character": 0 }, "end": { "line": lines, "character": 0 } });
    let asked = json!({ "textDocument": { "uri": uri(&path) }, "range": range, "context": { "diagnostics": [], "only": ["quickfix"] } });
    let found = editor.ask("textDocument/codeAction", asked);
    found
        .as_array()
        .unwrap()
        .iter()
        .map(|it| {
            let text = apply_edits(text, &it["edit"]["changes"][uri(&path)]);
            (it["title"].as_str().unwrap().to_owned(), text)
        })
        .collect()
}

fn graph(nodes: &str) -> String {
    format!(
        "Graph(\n    format: 1,\n    nodes: {{\n        {nodes}\n    }},\n    outputs: {{ \"out.ply\": \"x\" }},\n)\n"
    )
}

/// Checks the titles of the fixes. Each fixed text must also have no errors, unless the fix inserts an empty link.
#[track_caller]
fn check(nodes: &str, titles: &[&str]) {
    let place = Place::new(&[]);
    let mut editor = place.editor();
    let found = fixes(&mut editor, &place, &graph(nodes));
    assert_eq!(found.iter().map(|(title, _)| &title[..]).collect::<Vec<_>>(), titles, "{nodes}");
    for (title, text) in found.iter().filter(|(title, _)| !title.contains("\"\"")) {
        place.write("x.ron", text);
        let told: Json = serde_json::from_str(&place.run(&["check", "x.ron", "--json"])).unwrap();
        // An unused node is only a warning, so only errors count.
        let problems = told["problems"].as_array().unwrap().iter();
        let errors: Vec<_> = problems.filter(|it| it["severity"] == "error").collect();
        assert!(errors.is_empty(), "{title}: {errors:?} in {text}");
    }
}

#[test]
fn a_port_that_is_missing_is_added_with_each_link_that_fits() {
    fn ball(name: &str) -> String {
        format!("\"{name}\": Primitive(shape: Sphere(radius: 1.0)),")
    }
    let (a, b) = (ball("a"), ball("b"));
    // The first graph has one possible link, the second has several, and the third has none.
    check(&format!("{a} \"x\": Transform(scale: (2, 2, 2))"), &["Write `mesh: \"a\",`"]);
    check(
        &format!("{a} {b} \"x\": Transform(scale: (2, 2, 2))"),
        &["Write `mesh: \"b\"`", "Write `mesh: \"a\"`"],
    );
    check(
        &format!("{a} {b} \"x\": Merge(meshes: [\"y\", \"a\", \"b\"]), \"y\": Transform()"),
        &["Write `mesh: \"b\"`", "Write `mesh: \"a\"`"],
    );
    check("\"x\": Transform(scale: (2, 2, 2))", &["Write `mesh: \"\"`"]);
    check("\"x\": Transform()", &["Write `mesh: \"\"`"]);
}

#[test]
fn a_port_for_several_and_a_field_are_added_too() {
    let balls = "\"a\": Primitive(shape: Sphere(radius: 1.0)), \"b\": Primitive(shape: Sphere(radius: 1.0)),";
    check(
        &format!("{balls} \"x\": Merge()"),
        &["Write `meshes: [\"b\"]`", "Write `meshes: [\"a\"]`"],
    );
    let place = Place::new(&[]);
    let mut editor = place.editor();
    let found = fixes(
        &mut editor,
        &place,
        &graph(&format!("{balls} \"x\": Subdivide(mesh: \"a\", levels: 1)")),
    );
    let titles: Vec<_> = found.iter().map(|(title, _)| &title[..]).collect();
    assert!(titles.contains(&"Write `scheme: Loop`"), "{titles:?}");
}
