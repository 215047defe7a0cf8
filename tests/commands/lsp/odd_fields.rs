//! The server answers each kind of message, whatever the values of its fields.

use serde_json::{Value as Json, json};

use super::editor::{Editor, uri};
use super::{FACE, Place, face};

/// Collects the JSON pointers of all fields and items in a value, and of the value itself.
fn places(value: &Json, at: String, found: &mut Vec<String>) {
    match value {
        Json::Object(fields) => {
            fields.iter().for_each(|(name, value)| places(value, format!("{at}/{name}"), found));
        }
        Json::Array(items) => {
            items
                .iter()
                .enumerate()
                .for_each(|(k, value)| places(value, format!("{at}/{k}"), found));
        }
        _ => {}
    }
    found.push(at);
}

fn odd_values() -> Vec<Json> {
    let deep = (0..64).fold(json!([]), |inner, _| json!([inner]));
    vec![
        json!(null),
        json!(true),
        json!([]),
        json!({}),
        json!(-1),
        json!(1.5),
        json!(1e300),
        json!(4_294_967_296_u64),
        json!(u64::MAX),
        json!("x"),
        json!("file://"),
        json!("file:///\u{0}%00%ff"),
        json!("\u{1f600}\r\n"),
        deep,
    ]
}

/// The requests that the server knows, with fields as editors send them.
fn requests(place: &Place) -> Vec<(&'static str, Json)> {
    let document = json!({ "uri": uri(&place.path("face.ron")) });
    let start = json!({ "line": 6, "character": 12 });
    let range = json!({ "start": start, "end": { "line": 8, "character": 3 } });
    let at = json!({ "textDocument": document, "position": start });
    let of = json!({ "textDocument": document });
    let of_range = json!({ "textDocument": document, "range": range });
    fn with_field(base: &Json, name: &str, value: Json) -> Json {
        let mut all = base.clone();
        all[name] = value;
        all
    }
    let context = json!({ "includeDeclaration": true, "triggerKind": 1, "diagnostics": [], "only": ["quickfix"] });
    let refactor = json!({ "title": "x", "kind": "refactor.extract", "data": { "extract": { "uri": document["uri"], "nodes": ["smooth"] } } });
    let stop = json!({ "command": "maquette.stop", "arguments": [document["uri"], "smooth"], "workDoneToken": 1 });
    vec![
        ("textDocument/completion", with_field(&at, "context", context.clone())),
        ("textDocument/hover", at.clone()),
        ("textDocument/signatureHelp", at.clone()),
        ("textDocument/definition", at.clone()),
        ("textDocument/references", with_field(&at, "context", context.clone())),
        ("textDocument/documentHighlight", at.clone()),
        ("textDocument/prepareRename", at.clone()),
        ("textDocument/rename", with_field(&at, "newName", json!("other"))),
        ("textDocument/documentSymbol", of.clone()),
        ("workspace/symbol", json!({ "query": "smooth" })),
        ("textDocument/foldingRange", of.clone()),
        ("textDocument/selectionRange", with_field(&of, "positions", json!([start]))),
        ("textDocument/documentColor", of.clone()),
        (
            "textDocument/colorPresentation",
            with_field(
                &of_range,
                "color",
                json!({ "red": 0.5, "green": 0.5, "blue": 0.5, "alpha": 1.0 }),
            ),
        ),
        ("textDocument/documentLink", of.clone()),
        ("textDocument/semanticTokens/full", of.clone()),
        ("textDocument/semanticTokens/range", of_range.clone()),
        ("textDocument/inlayHint", of_range.clone()),
        ("textDocument/codeLens", of.clone()),
        ("textDocument/codeAction", with_field(&of_range, "context", context)),
        ("codeAction/resolve", refactor),
        (
            "textDocument/formatting",
            with_field(&of, "options", json!({ "tabSize": 4, "insertSpaces": true })),
        ),
        ("textDocument/rangeFormatting", with_field(&of_range, "options", json!({ "tabSize": 4 }))),
        ("workspace/executeCommand", stop),
        ("no/such/method", of),
    ]
}

fn notifications(place: &Place) -> Vec<(&'static str, Json)> {
    let file = uri(&place.path("other.ron"));
    let range =
        json!({ "start": { "line": 0, "character": 1 }, "end": { "line": 0, "character": 2 } });
    let text = "Graph(format: 1, nodes: {}, outputs: {})";
    vec![
        (
            "textDocument/didOpen",
            json!({ "textDocument": { "uri": file, "languageId": "ron", "version": 1, "text": text } }),
        ),
        (
            "textDocument/didChange",
            json!({ "textDocument": { "uri": file, "version": 2 }, "contentChanges": [{ "range": range, "text": "x" }] }),
        ),
        ("textDocument/didSave", json!({ "textDocument": { "uri": file }, "text": text })),
        (
            "workspace/didChangeConfiguration",
            json!({ "settings": { "maquette": { "roots": ["/"], "hints": true, "largeFiles": 9 } } }),
        ),
        ("workspace/didChangeWatchedFiles", json!({ "changes": [{ "uri": file, "type": 2 }] })),
        (
            "workspace/didChangeWorkspaceFolders",
            json!({ "event": { "added": [{ "uri": file, "name": "x" }], "removed": [] } }),
        ),
        ("window/workDoneProgress/cancel", json!({ "token": "maquette-run-1" })),
        ("$/cancelRequest", json!({ "id": 7_777 })),
        ("$/setTrace", json!({ "value": "off" })),
        ("textDocument/didClose", json!({ "textDocument": { "uri": file } })),
        ("no/such/notification", json!({ "x": 1 })),
    ]
}

/// Calls `send` with copies of a message in which one field has an unexpected value.
fn for_each_odd(params: &Json, mut send: impl FnMut(Json)) {
    let mut all = Vec::new();
    places(params, String::new(), &mut all);
    for at in all {
        for odd in odd_values() {
            let mut params = params.clone();
            *params.pointer_mut(&at).unwrap() = odd;
            send(params);
        }
    }
}

fn check_answer(method: &str, params: &Json, answer: &Result<Json, String>) {
    if let Err(why) = answer {
        assert!(!why.contains("a bug of"), "{method} {params}: {why}");
    }
}

#[test]
fn every_request_with_an_odd_field_is_answered() {
    let place = face();
    let mut editor = place.editor();
    editor.open(&place.path("face.ron"), FACE);
    let mut count = 0;
    for (method, params) in requests(&place) {
        for_each_odd(&params, |params| {
            let answer = editor.try_ask(method, params.clone());
            check_answer(method, &params, &answer);
            count += 1;
        });
        // After the unexpected messages, the server still answers.
        let hover = json!({ "textDocument": { "uri": uri(&place.path("face.ron")) }, "position": { "line": 0, "character": 2 } });
        assert!(editor.try_ask("textDocument/hover", hover).is_ok(), "behind {method}");
    }
    assert!(count > 2_000, "{count}");
}

#[test]
fn behind_every_notification_with_an_odd_field_requests_are_answered() {
    let place = face();
    for (method, params) in notifications(&place) {
        let mut editor: Editor = place.editor();
        let path = place.path("other.ron");
        editor.open(&path, "Graph(format: 1)");
        for_each_odd(&params, |params| editor.tell(method, params));
        let asked = json!({ "textDocument": { "uri": uri(&path) } });
        let answer = editor.try_ask("textDocument/documentSymbol", asked);
        assert!(answer.is_ok(), "{method}: {answer:?}");
        let bugs = editor.heard.iter().filter(|(method, _)| method == "window/logMessage");
        assert_eq!(Vec::from_iter(bugs), Vec::<&(String, Json)>::new(), "{method}");
    }
}

#[test]
fn an_editor_with_odd_fields_at_its_start_gets_answers() {
    let place = face();
    let can = json!({
        "general": { "positionEncodings": ["utf-16"] },
        "textDocument": {
            "codeAction": { "codeActionLiteralSupport": {}, "resolveSupport": { "properties": ["edit"] }, "dataSupport": true },
            "completion": { "completionItem": { "snippetSupport": true, "documentationFormat": ["markdown"] } },
            "hover": { "contentFormat": ["markdown"] },
        },
        "workspace": { "workspaceEdit": { "resourceOperations": ["create"], "documentChanges": true }, "configuration": false },
    });
    for_each_odd(&can, |can| {
        let mut editor = Editor::that_can(&place.cache, can, json!({ "roots": 3, "shows": [] }));
        editor.open(&place.path("face.ron"), FACE);
        let asked = json!({ "textDocument": { "uri": uri(&place.path("face.ron")) } });
        assert!(editor.ask("textDocument/documentSymbol", asked).is_array());
    });
}
