//! The messages of the server over stdin and stdout, for valid and invalid input.

use std::io::{BufRead, BufReader, Read, Write};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use serde_json::{Value as Json, json};

use super::editor::{Editor, apply_edits, uri};
use super::{BALL, FACE, NOSE, Place, face};

/// Timeout for answers; only a failing test waits this long.
const TIMEOUT: Duration = Duration::from_secs(60);

/// A process `maquette lsp`, and the messages that it has sent.
struct Server {
    process: Child,
    input: Option<ChildStdin>,
    heard: Receiver<Json>,
}

impl Server {
    fn start(place: &Place) -> Self {
        Self::start_with(place, &[])
    }

    fn start_with(place: &Place, options: &[&str]) -> Self {
        let mut process = Command::new(env!("CARGO_BIN_EXE_maquette"))
            .args(["lsp", "--no-cache"])
            .args(options)
            .current_dir(&place.folder)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let (sender, heard) = channel();
        let mut out = BufReader::new(process.stdout.take().unwrap());
        std::thread::spawn(move || {
            while let Some(message) = read(&mut out) {
                if sender.send(message).is_err() {
                    break;
                }
            }
        });
        let input = process.stdin.take();
        Self { process, input, heard }
    }

    fn raw(&mut self, bytes: &str) {
        let input = self.input.as_mut().unwrap();
        input.write_all(bytes.as_bytes()).unwrap();
        input.flush().unwrap();
    }

    fn send(&mut self, message: &Json) {
        let body = message.to_string();
        self.raw(&format!("Content-Length: {}\r\n\r\n{body}", body.len()));
    }

    fn tell(&mut self, method: &str, params: Json) {
        self.send(&json!({ "jsonrpc": "2.0", "method": method, "params": params }));
    }

    /// Waits for the answer to the request with this id.
    fn answer(&self, id: &Json) -> Json {
        let end = Instant::now() + TIMEOUT;
        loop {
            let left = end.saturating_duration_since(Instant::now());
            let message =
                self.heard.recv_timeout(left).unwrap_or_else(|_| panic!("no answer to {id}"));
            if message["id"] == *id && message.get("method").is_none() {
                return message;
            }
        }
    }

    fn ask(&mut self, id: impl Into<Json>, method: &str, params: Json) -> Json {
        let id = id.into();
        self.send(&json!({ "jsonrpc": "2.0", "id": id, "method": method, "params": params }));
        self.answer(&id)
    }

    fn initialize(place: &Place, params: Json) -> Self {
        let mut server = Self::start(place);
        let answer = server.ask(0, "initialize", params);
        assert!(answer["result"]["capabilities"].is_object(), "{answer}");
        server.tell("initialized", json!({}));
        server
    }

    /// Waits for the process to end and returns its exit code.
    fn end(mut self) -> Option<i32> {
        self.wait()
    }

    fn wait(&mut self) -> Option<i32> {
        let end = Instant::now() + TIMEOUT;
        while Instant::now() < end {
            if let Some(status) = self.process.try_wait().unwrap() {
                return status.code();
            }
            std::thread::sleep(Duration::from_millis(20));
        }
        panic!("the server does not end");
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

fn read(out: &mut BufReader<ChildStdout>) -> Option<Json> {
    let mut length = 0;
    loop {
        let mut line = String::new();
        if out.read_line(&mut line).ok()? == 0 {
            return None;
        }
        match line.trim().strip_prefix("Content-Length:") {
            Some(bytes) => length = bytes.trim().parse().unwrap(),
            None if line.trim().is_empty() => break,
            None => {}
        }
    }
    let mut body = vec![0; length];
    out.read_exact(&mut body).ok()?;
    serde_json::from_slice(&body).ok()
}

const SHUTDOWN: &str = "shutdown";

#[test]
fn a_log_gets_all_messages_and_keeps_what_was_there() {
    let place = face();
    place.write("messages.log", "older\n");
    let mut server = Server::start_with(&place, &["--log", "messages.log"]);
    server.ask(7, "initialize", json!({}));
    server.ask(8, SHUTDOWN, json!(null));
    server.tell("exit", json!(null));
    assert_eq!(server.end(), Some(0));

    let log = std::fs::read_to_string(place.path("messages.log")).unwrap();
    let lines: Vec<_> = log.lines().collect();
    assert_eq!(lines[0], "older");
    fn count_lines(who: &str, what: &str, lines: &[&str]) -> usize {
        lines.iter().filter(|line| line.contains(who) && line.contains(what)).count()
    }
    for (who, what) in [
        (" editor: ", "\"initialize\""),
        (" server: ", "\"capabilities\""),
        (" editor: ", "\"shutdown\""),
        (" server: ", "\"id\":8"),
        (" editor: ", "\"exit\""),
    ] {
        assert_eq!(count_lines(who, what, &lines), 1, "{who}{what}\n{log}");
    }
}

#[test]
fn odd_fields_of_no_interest_stop_nothing() {
    let place = face();
    let path = place.path("face.ron");
    for (capabilities, options) in [
        (json!({ "textDocument": { "foldingRange": { "rangeLimit": 5000.0 } } }), json!(null)),
        (
            json!({ "workspace": { "workspaceEdit": { "resourceOperations": ["create", "copy"] } } }),
            json!([]),
        ),
        (
            json!({ "textDocument": [], "general": { "positionEncodings": [3, "utf-16"] } }),
            json!("x"),
        ),
        (json!([]), json!({ "hints": "yes", "roots": {}, "largeFiles": 1e9 })),
        (Json::Null, json!({ "roots": [null, "/nowhere"] })),
    ] {
        let params = json!({ "processId": 1e99, "rootUri": 5, "capabilities": capabilities, "initializationOptions": options });
        let mut server = Server::initialize(&place, params);
        let document = json!({ "uri": uri(&path), "languageId": 7, "version": 1.0, "text": FACE });
        server.tell("textDocument/didOpen", json!({ "textDocument": document }));
        let document = json!({ "uri": uri(&path) });
        let position = json!({ "line": 9.0, "character": 20.0 });
        for id in [json!("a"), json!(5_000_000_000_i64), json!(1.5)] {
            let asked = json!({ "textDocument": document, "position": position, "context": [], "workDoneToken": {} });
            let answer = server.ask(id, "textDocument/completion", asked);
            assert!(answer["result"]["items"].is_array(), "{answer}");
        }
        let context = json!({ "diagnostics": [{ "range": 3, "code": {} }], "triggerKind": 1.0 });
        let range = json!({ "start": position, "end": position });
        let asked = json!({ "textDocument": document, "range": range, "context": context });
        let answer = server.ask(9, "textDocument/codeAction", asked);
        assert!(answer["result"].is_array(), "{answer}");
        assert_eq!(server.ask(10, SHUTDOWN, Json::Null)["result"], Json::Null);
        server.tell("exit", Json::Null);
        assert_eq!(server.end(), Some(0));
    }
}

#[test]
fn what_breaks_the_protocol_is_an_error_and_the_next_request_is_answered() {
    let place = face();
    let mut server = Server::start(&place);
    let early = server.ask(1, "textDocument/hover", json!({}));
    assert_eq!(early["error"]["code"], -32002);
    server.ask(2, "initialize", json!({ "capabilities": {} }));
    for (id, broken) in (10..).zip([
        "Content-Length: 5\r\n\r\n{abc}",
        "Content-Length: 99999999999999\r\n\r\n{}",
        "Content-Type: x\r\n\r\n{}",
        "{\"jsonrpc\": \"2.0\", \"id\": 5, \"method\": \"shutdown\"}",
        "Content-Length: 2\r\n\r\n[]",
    ]) {
        server.raw(broken);
        let code = server.answer(&Json::Null)["error"]["code"].clone();
        assert!(code == -32700 || code == -32600, "{broken}: {code}");
        let next = server.ask(id, "no/such", json!({}));
        assert_eq!(next["error"]["code"], -32601, "{broken}: {next}");
    }
    assert_eq!(
        server.ask(20, "textDocument/hover", json!({ "textDocument": 3 }))["error"]["code"],
        -32602
    );
    assert_eq!(server.ask(21, "initialize", json!({}))["error"]["code"], -32600);
    server.ask(22, SHUTDOWN, Json::Null);
    assert_eq!(server.ask(23, "textDocument/hover", json!({}))["error"]["code"], -32600);
    server.tell("textDocument/didClose", json!({ "textDocument": { "uri": "file:///x" } }));
    server.tell("exit", Json::Null);
    assert_eq!(server.end(), Some(0));
    let mut server = Server::initialize(&place, json!({}));
    server.tell("exit", Json::Null);
    assert_eq!(server.end(), Some(1));
}

/// A graph that takes long to run on any machine.
const LONG: &str = "Graph(format: 1, nodes: { \"b\": Primitive(shape: Sphere(radius: 1.0)), \"s\": Subdivide(mesh: \"b\", scheme: CatmullClark, levels: 6), \"m\": Simplify(mesh: \"s\", faces: 100) }, outputs: { \"a.ply\": \"m\" })\n";

/// Starts a server and lets it run a graph; the request has the id 7.
fn running(place: &Place, params: Json) -> Server {
    let path = place.path("long.ron");
    let mut server = Server::initialize(place, params);
    let document = json!({ "uri": uri(&path), "languageId": "ron", "version": 1, "text": LONG });
    server.tell("textDocument/didOpen", json!({ "textDocument": document }));
    let command = json!({ "command": "maquette.run", "arguments": [uri(&path)] });
    server.send(&json!({ "id": 7, "method": "workspace/executeCommand", "params": command }));
    // A request that is sent later is answered only after the run's process has started.
    server.ask(8, "workspace/symbol", json!({ "query": "" }));
    server
}

#[test]
fn a_cancelled_request_is_refused_and_its_run_ends() {
    let place = Place::new(&[("long.ron", LONG)]);
    let mut server = running(&place, json!({}));
    server.tell("$/cancelRequest", json!({ "id": 7 }));
    assert_eq!(server.answer(&json!(7))["error"]["code"], -32800);
}

#[cfg(target_os = "linux")]
#[test]
fn a_run_ends_with_its_editor_and_with_its_server() {
    use std::path::Path;
    let place = Place::new(&[("long.ron", LONG)]);
    fn children(server: &Server) -> Vec<String> {
        let id = server.process.id();
        let path = format!("/proc/{id}/task/{id}/children");
        let children = std::fs::read_to_string(path).unwrap_or_default();
        children.split_whitespace().map(|id| format!("/proc/{id}/exe")).collect::<Vec<_>>()
    }
    fn have_ended(children: &[String]) {
        let end = Instant::now() + TIMEOUT;
        // A process has ended if its executable cannot be read. This includes zombies: processes that have ended, but were not waited for.
        while children.iter().any(|child| std::fs::read_link(Path::new(child)).is_ok()) {
            assert!(Instant::now() < end, "{children:?} still run");
            std::thread::sleep(Duration::from_millis(20));
        }
    }
    let mut editor = Command::new("sleep").arg("600").spawn().unwrap();
    let mut server = running(&place, json!({ "processId": editor.id() }));
    let runs = children(&server);
    assert_eq!(runs.len(), 1);
    editor.kill().unwrap();
    editor.wait().unwrap();
    server.wait();
    have_ended(&runs);
    let mut server = running(&place, json!({}));
    let runs = children(&server);
    assert_eq!(runs.len(), 1);
    server.process.kill().unwrap();
    have_ended(&runs);
}

/// The server may be killed before the process of its run checks that the server exists.
#[cfg(unix)]
#[test]
fn a_run_ends_at_once_if_its_server_has_ended_before() {
    let mut server = Command::new("true").spawn().unwrap();
    let id = server.id().to_string();
    server.wait().unwrap();
    let mut run = Command::new(env!("CARGO_BIN_EXE_maquette"));
    run.args(["nodes"]).env(maquette_lsp::PARENT, id);
    assert_eq!(run.output().unwrap().status.code(), Some(130));
    assert_eq!(run.env_remove(maquette_lsp::PARENT).output().unwrap().status.code(), Some(0));
}

#[test]
fn files_that_change_outside_of_the_editor_are_seen() {
    let place = face();
    let path = place.path("face.ron");
    let mut editor = place.editor();
    editor.open(&path, FACE);
    assert_eq!(editor.diagnostics(&path), Vec::<Json>::new());
    let mut check = |change: &dyn Fn(), wanted: &str| {
        change();
        let found = editor.some_diagnostics(&path);
        assert!(found.iter().any(|it| it["message"] == wanted), "{found:?}");
        place.write("lib/nose.ron", NOSE);
        place.write("ball.obj", BALL);
        editor.no_diagnostics(&path);
    };
    let other = NOSE.replace("\"lift\"", "\"raise\"");
    check(&|| place.write("lib/nose.ron", &other), "Nose has no field `lift`");
    check(&|| std::fs::remove_file(place.path("ball.obj")).unwrap(), "there is no file `ball.obj`");
    // The new text has the same length and modification time as the old text, as after `cp -p` or with some version control systems.
    check(
        &|| {
            let path = place.path("lib/nose.ron");
            let time = std::fs::metadata(&path).unwrap().modified().unwrap();
            place.write("lib/nose.ron", &NOSE.replace("\"lift\"", "\"life\""));
            std::fs::File::options().write(true).open(&path).unwrap().set_modified(time).unwrap();
        },
        "Nose has no field `lift`",
    );
}

#[test]
fn an_editor_gets_what_it_says_that_it_understands() {
    let place = face();
    let path = place.path("face.ron");
    let mut editor = Editor::that_can(&place.cache, json!({}), Json::Null);
    let text = FACE.replace("Subdivide(", "Subdivde(");
    editor.open(&path, &text);
    let hover = editor.ask_at("textDocument/hover", &path, &text, "sc|heme");
    assert!(hover["contents"]["kind"] == "plaintext" || hover.is_null(), "{hover}");
    let hover = editor.ask_at("textDocument/hover", &path, &text, "For|Each");
    assert_eq!(hover["contents"]["kind"], "plaintext");
    assert!(!hover["contents"]["value"].as_str().unwrap().contains(['*', '`']), "{hover}");
    let document = json!({ "uri": uri(&path) });
    let symbols = editor.ask("textDocument/documentSymbol", json!({ "textDocument": document }));
    assert!(symbols[0]["location"]["range"].is_object() && symbols[0].get("children").is_none());
    let found = editor.ask("workspace/symbol", json!({ "query": "smth" }));
    assert_eq!(found[0]["name"], "smooth", "{found}");
    // This editor gets commands as code actions. When a command is executed, the server asks the editor to apply the edit.
    let whole =
        json!({ "start": { "line": 0, "character": 0 }, "end": { "line": 99, "character": 0 } });
    let asked =
        json!({ "textDocument": document, "range": whole, "context": { "diagnostics": [] } });
    let actions = editor.ask("textDocument/codeAction", asked);
    assert!(actions.as_array().unwrap().iter().all(|it| it["command"].is_string()), "{actions}");
    let action = actions.as_array().unwrap().iter().find(|it| it["command"] == "maquette.apply");
    editor.ask("workspace/executeCommand", action.unwrap().clone());
    let (_, edit) = editor.heard.iter().find(|it| it.0 == "workspace/applyEdit").unwrap();
    assert_eq!(apply_edits(&text, &edit["edit"]["changes"][uri(&path)]), FACE);
}

#[test]
fn settings_that_are_not_named_stay() {
    let place = face();
    let path = place.path("face.ron");
    let options = json!({ "largeFiles": 0.5, "hints": true });
    let mut editor = Editor::that_can(&place.cache, json!({}), json!({ "largeFiles": 1000 }));
    editor.open(&path, FACE);
    fn lenses(editor: &mut Editor, path: &std::path::Path) -> bool {
        let asked = json!({ "textDocument": { "uri": uri(path) } });
        editor.ask("textDocument/codeLens", asked).is_array()
    }
    assert!(lenses(&mut editor, &path));
    let large = format!("{FACE}// {}\n", "x".repeat(2_000));
    for (settings, text, is_answered) in [
        (json!({ "maquette": { "largeFiles": 1 } }), &large[..], false),
        (json!({ "maquette": { "hints": false } }), &large, false),
        (json!({ "maquette": { "largeFiles": null, "roots": 3 } }), &large, false),
        (json!(null), &large, false),
        (json!({ "maquette": { "largeFiles": 0.0 } }), &large, true),
        (options, FACE, true),
    ] {
        editor.change(&path, text);
        editor.tell("workspace/didChangeConfiguration", json!({ "settings": settings }));
        assert_eq!(lenses(&mut editor, &path), is_answered, "{settings}");
    }
}

#[test]
fn a_large_file_has_a_message_that_names_the_setting() {
    let place = face();
    let path = place.path("face.ron");
    let mut editor = Editor::that_can(&place.cache, json!({}), json!({ "largeFiles": 1 }));
    editor.open(&path, &format!("{FACE}// {}\n", "x".repeat(2_000)));
    editor.ask("textDocument/codeLens", json!({ "textDocument": { "uri": uri(&path) } }));
    let message = editor.heard.iter().find(|it| it.0 == "window/showMessage");
    let message = message.expect("a message").1["message"].as_str().unwrap();
    assert!(message.contains("face.ron") && message.contains("`maquette.largeFiles`"), "{message}");
}

#[test]
fn one_file_under_two_names_has_its_problems_under_both() {
    let place = face();
    let link = place.folder.parent().unwrap().join("link");
    #[cfg(unix)]
    std::os::unix::fs::symlink(&place.folder, &link).unwrap();
    if !link.exists() {
        return;
    }
    let (path, other) = (place.path("face.ron"), link.join("face.ron"));
    let mut editor = place.editor();
    let text = FACE.replace("levels: 1", "levls: 1");
    editor.open(&path, &text);
    editor.open(&other, &text);
    assert_eq!(editor.diagnostics(&other).len(), editor.some_diagnostics(&path).len());
    editor.tell("textDocument/didClose", json!({ "textDocument": { "uri": uri(&other) } }));
    editor.no_diagnostics(&other);
    assert!(editor.ask_at("textDocument/hover", &path, &text, "For|Each").is_object());
}
