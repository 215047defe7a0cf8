//! Extracting nodes to a new graph and inlining them again, as code actions.

use std::path::Path;

use serde_json::{Value as Json, json};

use super::Place;
use super::editor::{Editor, apply_edits, position, uri};

const GRAPH: &str = r#"Graph(
    format: 1,
    params: { "far": Number(default: 9.0, unit: "mm", doc: "How far.") },
    nodes: {
        "mesh": ReadMesh(path: "doll/coarse.obj"),
        // Made smooth.
        "smooth": Subdivide(mesh: "mesh", scheme: Loop, levels: 1),
        "moved": Transform(mesh: "smooth", translate: (0, Param("far"), 0)),
        "both": Merge(meshes: ["mesh", "moved"]),
    },
    outputs: { "both.ply": "both" },
)
"#;

/// Returns the refactorings for the text between two marks.
fn actions(editor: &mut Editor, path: &Path, text: &str, marks: [&str; 2]) -> Vec<Json> {
    let [start, end] = marks.map(|mark| position(text, text.find(mark).unwrap()));
    let asked = json!({
        "textDocument": { "uri": uri(path) },
        "range": { "start": start, "end": end },
        "context": { "diagnostics": [], "only": ["refactor"] },
    });
    editor.ask("textDocument/codeAction", asked).as_array().unwrap().clone()
}

fn titles(actions: &[Json]) -> Vec<&str> {
    actions.iter().map(|action| action["title"].as_str().unwrap()).collect()
}

/// Applies the part of an edit for this file to the text `before`.
fn text_of(edit: &Json, path: &Path, before: &str) -> String {
    let changes = edit["documentChanges"].as_array().unwrap();
    let change = changes.iter().find(|it| it["textDocument"]["uri"] == uri(path)).unwrap();
    apply_edits(before, &change["edits"])
}

fn lazy() -> Json {
    json!({
        "textDocument": { "codeAction": { "dataSupport": true, "resolveSupport": { "properties": ["edit"] } } },
        "workspace": { "workspaceEdit": { "resourceOperations": ["create"], "documentChanges": true } },
    })
}

#[test]
fn nodes_become_a_graph_and_come_back() {
    let place = Place::doll("both.ron", GRAPH);
    // The preferred name of the new file is taken by another file.
    place.write("moved.ron", "");
    let (path, new) = (place.path("both.ron"), place.path("moved-2.ron"));
    for can in [lazy(), json!({ "workspace": lazy()["workspace"] })] {
        let mut editor = Editor::that_can(&place.cache, can.clone(), Json::Null);
        editor.open(&path, GRAPH);
        let found = actions(&mut editor, &path, GRAPH, ["smooth\":", "moved\": Tr"]);
        assert_eq!(titles(&found), ["Extract 2 nodes into a graph"]);
        let is_lazy = !can["textDocument"].is_null();
        assert_eq!(found[0]["edit"].is_null(), is_lazy);
        let action = match is_lazy {
            true => editor.ask("codeAction/resolve", found[0].clone()),
            false => found[0].clone(),
        };
        let edit = &action["edit"];
        assert_eq!(edit["documentChanges"][1]["kind"], "create", "{edit}");
        let (text, file) = (text_of(edit, &path, GRAPH), text_of(edit, &new, ""));
        assert!(text.contains(r#"use: { "Moved2": "moved-2.ron" }"#), "{text}");
        assert!(file.contains("// Made smooth."), "{file}");
        editor.change(&path, &text);
        editor.open(&new, &file);
        assert_eq!(editor.diagnostics(&new), Vec::<Json>::new());
        editor.change(&path, &text);
        assert_eq!(editor.diagnostics(&path), Vec::<Json>::new());
        let found = actions(&mut editor, &path, &text, ["moved2\": Mov", "moved2\": Mov"]);
        assert_eq!(titles(&found), ["Extract `moved2` into a graph", "Inline `moved2`"]);
        let action = match is_lazy {
            true => editor.ask("codeAction/resolve", found[1].clone()),
            false => found[1].clone(),
        };
        assert_eq!(apply_edits(&text, &action["edit"]["changes"][uri(&path)]), GRAPH);
    }
}

#[test]
fn what_cannot_be_done_is_refused_in_words_and_nothing_is_offered_that_an_editor_cannot_do() {
    let place = Place::doll("both.ron", GRAPH);
    let path = place.path("both.ron");
    let mut editor = Editor::that_can(&place.cache, lazy(), Json::Null);
    editor.open(&path, GRAPH);
    let asked = json!({ "title": "", "data": { "extract": { "uri": uri(&path), "nodes": ["mesh", "moved"] } } });
    let why = editor.try_ask("codeAction/resolve", asked).unwrap_err();
    assert_eq!(
        why,
        "`smooth` is between the nodes: it needs `mesh`, and `moved` needs it: extract `smooth`, too, or leave one of them where it is"
    );
    // Extraction is not offered to an editor that cannot create files.
    let mut editor = Editor::that_can(&place.cache, json!({}), Json::Null);
    editor.open(&path, GRAPH);
    let found = actions(&mut editor, &path, GRAPH, ["smooth\":", "moved\": Tr"]);
    assert_eq!(titles(&found), Vec::<&str>::new());
}
