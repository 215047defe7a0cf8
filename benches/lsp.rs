//! Measures how fast the language server answers an editor, for a graph of 500 nodes that uses another graph. Each kind of request is sent
//! a hundred times at different positions, each time after a keystroke.
//!
//! `cargo bench -p maquette-program --bench lsp` prints the median and the 95th percentile in ms.

#![allow(clippy::print_stdout, reason = "the table goes to whoever measures")]

use std::path::{Path, PathBuf};
use std::time::Instant;

use lsp_server::{Connection, Message, Notification, Request};
use maquette::{CacheFolder, Session, Settings};
use maquette_lsp::{Setup, serve};
use serde_json::{Value as Json, json};

const NODES: usize = 500;
const TIMES: usize = 100;

const FEATURE: &str = "Graph(format: 1, inputs: { \"mesh\": Mesh(doc: \"\") }, params: { \"lift\": Number(default: 1.0, unit: \"mm\", doc: \"\") }, \
                       nodes: { \"moved\": Transform(mesh: \"mesh\", translate: (0, Param(\"lift\"), 0)) }, outputs: { \"mesh\": \"moved\" })\n";

/// Returns a graph with a chain of nodes. Every tenth node uses the other graph.
fn graph() -> String {
    let mut text = "Graph(\n    format: 1,\n    use: { \"Feature\": \"feature.ron\" },\n    params: { \"growth\": Number(default: 2.0, unit: \"mm\", doc: \"\") },\n    nodes: {\n        \"n0\": ReadMesh(path: \"ball.obj\"),\n".to_owned();
    for index in 1..NODES {
        let before = index - 1;
        let output = if before.is_multiple_of(10) && 0 < before { ".mesh" } else { "" };
        text += &match index % 10 {
            0 => format!(
                "        \"n{index}\": Feature(mesh: \"n{before}{output}\", lift: Param(\"growth\")),\n"
            ),
            _ => format!(
                "        \"n{index}\": Transform(mesh: \"n{before}{output}\", translate: (0, 0, 1.01)),\n"
            ),
        };
    }
    text + &format!("    }},\n    outputs: {{ \"a.ply\": \"n{}\" }},\n)\n", NODES - 1)
}

struct Editor {
    connection: Connection,
    uri: String,
    next: i32,
}

impl Editor {
    fn tell(&self, method: &str, params: Json) {
        let message = Notification { method: method.into(), params };
        self.connection.sender.send(message.into()).expect("the server is there");
    }

    fn ask(&mut self, method: &str, params: Json) -> Json {
        self.next += 1;
        let request = Request { id: self.next.into(), method: method.into(), params };
        self.connection.sender.send(request.into()).expect("the server is there");
        loop {
            let message = self.connection.receiver.recv().expect("the server is there");
            if let Message::Response(answer) = message
                && answer.id == self.next.into()
            {
                return answer
                    .response_result
                    .unwrap_or_else(|error| panic!("{method}: {}", error.message));
            }
        }
    }
}

fn main() {
    let folder = tempfile::tempdir().expect("a folder");
    let root = std::fs::canonicalize(folder.path()).expect("a folder");
    fn write(name: &str, text: &str, root: &Path) {
        std::fs::write(root.join(name), text).expect("a file");
    }
    write("maquette.toml", "", &root);
    write("feature.ron", FEATURE, &root);
    write(
        "ball.obj",
        "v 0 0 0\nv 9 0 0\nv 0 9 0\nv 0 0 9\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n",
        &root,
    );
    let text = graph();
    write("graph.ron", &text, &root);
    let settings = Settings { cache: CacheFolder::At(root.join("cache")), ..Settings::default() };
    evaluate(&settings, &root.join("graph.ron"));
    let (connection, theirs) = Connection::memory();
    let server = std::thread::spawn(move || {
        let session = Session::new(maquette_nodes::PACKS, &settings).expect("a session");
        serve(&theirs, Setup { session, program: PathBuf::new(), arguments: Vec::new() })
    });
    let uri = format!("file://{}", root.join("graph.ron").display());
    let mut editor = Editor { connection, uri, next: 0 };
    let client = json!({ "general": { "positionEncodings": ["utf-8"] } });
    editor.ask("initialize", json!({ "processId": null, "rootUri": null, "capabilities": client }));
    editor.tell("initialized", json!({}));
    let document = json!({ "uri": editor.uri, "languageId": "ron", "version": 0, "text": text });
    editor.tell("textDocument/didOpen", json!({ "textDocument": document }));
    for method in [
        "completion",
        "hover",
        "definition",
        "references",
        "documentHighlight",
        "prepareRename",
        "rename",
        "documentSymbol",
        "foldingRange",
        "documentColor",
        "documentLink",
        "semanticTokens/full",
        "inlayHint",
        "codeLens",
        "codeAction",
        "formatting",
        "extract",
        "inline",
    ] {
        measure(&mut editor, &text, method);
    }
    editor.ask("shutdown", Json::Null);
    editor.tell("exit", Json::Null);
    drop(editor);
    server.join().expect("the server ends").expect("it is told to");
}

fn evaluate(settings: &Settings, path: &Path) {
    let mut session = Session::new(maquette_nodes::PACKS, settings).expect("a session");
    let graph = session.load(path, &maquette::Options::default()).graph.expect("a graph");
    assert!(session.run(&graph, &maquette::Run::default()).is_ok());
    session.finish();
}

fn measure(editor: &mut Editor, text: &str, method: &str) {
    let mut times = Vec::with_capacity(TIMES);
    for index in 0..TIMES {
        // Change a number in the text, like a keystroke, and then send the request for the line of a node.
        let node = 5 * index + 3;
        let new = text.replacen("1.01", &format!("1.{index:03}"), 1 + index % 7);
        let line =
            new.lines().position(|line| line.contains(&format!("\"n{node}\": "))).expect("a line");
        let place = json!({ "line": line, "character": 10 });
        let end = json!({ "line": line, "character": 20 });
        let version = json!({ "uri": editor.uri, "version": index + 1 });
        editor.tell(
            "textDocument/didChange",
            json!({ "textDocument": version, "contentChanges": [{ "text": new }] }),
        );
        let (method, params) = match method {
            "extract" => {
                let nodes = [format!("n{node}"), format!("n{}", node + 1)];
                resolve_request(&json!({ "extract": { "uri": editor.uri, "nodes": nodes } }))
            }
            "inline" => {
                let used = format!("n{}", 10 + node / 10 % 49 * 10);
                resolve_request(&json!({ "inline": { "uri": editor.uri, "node": used } }))
            }
            _ => (
                format!("textDocument/{method}"),
                json!({
                    "textDocument": { "uri": editor.uri },
                    "position": if method == "completion" { json!({ "line": line, "character": 32 }) } else { place.clone() },
                    "range": if method == "inlayHint" { json!({ "start": { "line": 0, "character": 0 }, "end": { "line": 9999, "character": 0 } }) } else { json!({ "start": place, "end": end }) },
                    "context": { "includeDeclaration": true, "diagnostics": [], "triggerKind": 1 },
                    "newName": format!("m{index}"),
                    "options": { "tabSize": 4, "insertSpaces": true },
                }),
            ),
        };
        let start = Instant::now();
        let answer = editor.ask(&method, params);
        times.push(start.elapsed().as_secs_f64() * 1e3);
        assert!(!answer.is_null(), "{method}");
    }
    times.sort_by(f64::total_cmp);
    println!(
        "{method:<22} median {:6.1} ms, 95th of a hundred {:6.1} ms",
        times[TIMES / 2],
        times[TIMES * 95 / 100]
    );
}

/// Returns the request that an editor sends after the user has chosen a code action.
fn resolve_request(data: &Json) -> (String, Json) {
    ("codeAction/resolve".into(), json!({ "title": "", "data": data }))
}
