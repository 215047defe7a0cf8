//! After any sequence of edits, the server gives the same answers as a new server.

use serde_json::{Value as Json, json};

use super::editor::{Editor, uri};
use super::{FACE, NOSE, Place, face};

/// Number of random steps with one server: each opens, edits, saves or closes a file.
const STEPS: usize = 150;

const FILES: [&str; 3] = ["face.ron", "lib/nose.ron", "big.ron"];

/// Returns possible contents of a file, valid and invalid ones.
fn texts(file: &str) -> Vec<String> {
    match file {
        "face.ron" => vec![
            FACE.to_owned(),
            FACE.replace("levels: 1", "levls: 1"),
            FACE.replace("\"smooth\": Sub", "\"soft\": Sub"),
            FACE[..FACE.len() / 2].to_owned(),
        ],
        "lib/nose.ron" => vec![
            NOSE.to_owned(),
            NOSE.replace("\"lift\"", "\"raise\""),
            NOSE.replace("outputs: { \"mesh\"", "outputs: { \"skin\""),
            NOSE.replace("Graph(", "Graph(("),
        ],
        _ => vec![
            "Patch(format: 1, of: \"face.ron\", params: { \"growth\": 4.0 })".to_owned(),
            "Patch(format: 1, of: \"face.ron\", nodes: { \"smooth\": (levels: 2) })".to_owned(),
            "Patch(format: 1, of: \"nobody.ron\")".to_owned(),
        ],
    }
}

/// Returns the diagnostics of all files, and the answers to requests at a few positions.
fn diagnostics(editor: &mut Editor, place: &Place, open: &[(usize, String)]) -> Json {
    // Diagnostics arrive in the order of paths, so once those of the last file arrive, all others have arrived.
    let last = place.path("zz.ron");
    editor.open(&last, "Graph(format: 1, nodes: {}, outputs: {})");
    editor.diagnostics(&last);
    let mut places = Vec::new();
    for (file, _) in open {
        let path = place.path(FILES[*file]);
        for (line, character) in [(7, 10), (8, 33), (4, 22), (0, 30)] {
            let asked = json!({
                "textDocument": { "uri": uri(&path) },
                "position": { "line": line, "character": character },
                "context": { "includeDeclaration": true, "triggerKind": 1 },
            });
            for method in ["definition", "references", "hover", "completion"] {
                places.push(editor.ask(&format!("textDocument/{method}"), asked.clone()));
            }
        }
    }
    let told = editor.told.iter().filter(|(_, all)| !all.is_empty());
    json!({ "told": told.collect::<std::collections::BTreeMap<_, _>>(), "places": places })
}

#[test]
fn any_order_of_edits_leads_where_a_new_server_begins() {
    let place = face();
    let mut editor = place.editor();
    let mut open: Vec<(usize, String)> = Vec::new();
    let mut state = 20_070_115_u64;
    fn next(below: usize, state: &mut u64) -> usize {
        *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (*state >> 33) as usize % below
    }
    for step in 0..STEPS {
        let file = next(FILES.len(), &mut state);
        let path = place.path(FILES[file]);
        let texts = texts(FILES[file]);
        let text = texts[next(texts.len(), &mut state)].clone();
        let known = open.iter().position(|(known, _)| *known == file);
        match (known, next(4, &mut state)) {
            (Some(at), 0) => {
                open.remove(at);
                editor.tell(
                    "textDocument/didClose",
                    json!({ "textDocument": { "uri": uri(&path) } }),
                );
            }
            (Some(at), 1) => {
                place.write(FILES[file], &open[at].1);
                editor
                    .tell("textDocument/didSave", json!({ "textDocument": { "uri": uri(&path) } }));
            }
            (Some(at), _) => {
                editor.change(&path, &text);
                open[at].1 = text;
            }
            (None, _) => {
                editor.open(&path, &text);
                open.push((file, text));
                open.sort();
            }
        }
        if step % 10 == 9 && !open.is_empty() {
            let mut fresh = place.editor();
            open.iter().for_each(|(file, text)| fresh.open(&place.path(FILES[*file]), text));
            let (now, new) =
                (diagnostics(&mut editor, &place, &open), diagnostics(&mut fresh, &place, &open));
            assert_eq!(now, new, "step {step}");
        }
    }
}
