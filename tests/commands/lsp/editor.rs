//! A simulated editor: it sends the messages of real editors to a language server that runs in this process.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use lsp_server::{Connection, Message, Notification, Request};
use maquette::{CacheFolder, Session, Settings};
use maquette_lsp::{Setup, serve};
use serde_json::{Value as Json, json};

/// Timeout for answers; only a failing test waits this long.
const PATIENCE: Duration = Duration::from_secs(60);

pub(crate) struct Editor {
    connection: Option<Connection>,
    server: Option<JoinHandle<Result<(), String>>>,
    next: i32,
    version: i32,
    /// The latest diagnostics of each file, by its URI.
    pub(crate) told: BTreeMap<String, Vec<Json>>,
    /// All notifications and requests that the server has sent, each with its method.
    pub(crate) heard: Vec<(String, Json)>,
}

impl Editor {
    pub(crate) fn new(cache: &Path) -> Self {
        let can = json!({
            "general": { "positionEncodings": ["utf-16"] },
            "textDocument": {
                "codeAction": { "codeActionLiteralSupport": { "codeActionKind": { "valueSet": [""] } } },
                "completion": { "completionItem": { "snippetSupport": true } },
                "documentSymbol": { "hierarchicalDocumentSymbolSupport": true },
                "hover": { "contentFormat": ["markdown"] },
                "publishDiagnostics": { "relatedInformation": true },
            },
            "workspace": { "workspaceEdit": { "resourceOperations": ["create"], "documentChanges": true } },
        });
        Self::that_can(cache, can, Json::Null)
    }

    pub(crate) fn that_can(cache: &Path, capabilities: Json, options: Json) -> Self {
        let (ours, theirs) = Connection::memory();
        let settings = Settings {
            cache: CacheFolder::At(cache.to_owned()),
            threads: 1,
            ..Settings::default()
        };
        let words = vec!["--cache".to_owned(), cache.display().to_string()];
        let server = std::thread::spawn(move || {
            let session = Session::new(maquette_nodes::PACKS, &settings).unwrap();
            let program = PathBuf::from(env!("CARGO_BIN_EXE_maquette"));
            serve(&theirs, Setup { session, program, arguments: words })
        });
        let (told, heard) = (BTreeMap::new(), Vec::new());
        let mut editor =
            Self { connection: Some(ours), server: Some(server), next: 0, version: 0, told, heard };
        let params = json!({ "processId": null, "rootUri": null, "capabilities": capabilities, "initializationOptions": options });
        editor.ask("initialize", params);
        editor.tell("initialized", json!({}));
        editor
    }

    fn send(&self, message: impl Into<Message>) {
        self.connection.as_ref().unwrap().sender.send(message.into()).unwrap();
    }

    pub(crate) fn tell(&self, method: &str, params: Json) {
        self.send(Notification { method: method.into(), params });
    }

    /// Sends a request and returns the answer, or its error.
    pub(crate) fn try_ask(&mut self, method: &str, params: Json) -> Result<Json, String> {
        self.next += 1;
        let id = self.next;
        self.send(Request { id: id.into(), method: method.into(), params });
        loop {
            match self.receive() {
                Message::Response(answer) if answer.id == id.into() => {
                    return answer.response_result.map_err(|error| error.message);
                }
                other => self.hear(other),
            }
        }
    }

    pub(crate) fn ask(&mut self, method: &str, params: Json) -> Json {
        self.try_ask(method, params).unwrap_or_else(|why| panic!("{method}: {why}"))
    }

    fn receive(&self) -> Message {
        self.connection.as_ref().unwrap().receiver.recv_timeout(PATIENCE).unwrap()
    }

    fn hear(&mut self, message: Message) {
        match message {
            Message::Notification(told) if told.method == "textDocument/publishDiagnostics" => {
                let uri = told.params["uri"].as_str().unwrap().to_owned();
                let all = told.params["diagnostics"].as_array().unwrap().clone();
                self.told.insert(uri, all);
                self.heard.push((told.method, told.params));
            }
            Message::Notification(told) => self.heard.push((told.method, told.params)),
            Message::Request(request) => self.heard.push((request.method, request.params)),
            Message::Response(_) => {}
        }
    }

    pub(crate) fn open(&mut self, path: &Path, text: &str) {
        self.version += 1;
        let document =
            json!({ "uri": uri(path), "languageId": "ron", "version": self.version, "text": text });
        self.tell("textDocument/didOpen", json!({ "textDocument": document }));
    }

    pub(crate) fn change(&mut self, path: &Path, text: &str) {
        self.version += 1;
        let document = json!({ "uri": uri(path), "version": self.version });
        let changes = json!([{ "text": text }]);
        self.tell(
            "textDocument/didChange",
            json!({ "textDocument": document, "contentChanges": changes }),
        );
    }

    /// Waits for the diagnostics of this file, as of the latest version that was sent to the server.
    pub(crate) fn diagnostics(&mut self, path: &Path) -> Vec<Json> {
        let start = Instant::now();
        loop {
            let newest = self.heard.iter().rev().find(|(method, params)| {
                method == "textDocument/publishDiagnostics"
                    && params["uri"] == uri(path)
                    && params["version"] == self.version
            });
            if newest.is_some() {
                return self.told[&uri(path)].clone();
            }
            assert!(start.elapsed() < PATIENCE, "nothing is said of {}", path.display());
            let message = self.receive();
            self.hear(message);
        }
    }

    /// Waits until the server has sent at least one diagnostic for this file.
    pub(crate) fn some_diagnostics(&mut self, path: &Path) -> Vec<Json> {
        while self.told.get(&uri(path)).is_none_or(Vec::is_empty) {
            let message = self.receive();
            self.hear(message);
        }
        self.told[&uri(path)].clone()
    }

    /// Waits until the server reports that this file has no diagnostics.
    pub(crate) fn no_diagnostics(&mut self, path: &Path) {
        let start = Instant::now();
        while !self.told[&uri(path)].is_empty() {
            assert!(start.elapsed() < PATIENCE, "{:?}", self.told[&uri(path)]);
            let message = self.receive();
            self.hear(message);
        }
    }

    /// Sends a request for the position that `mark` denotes: after its first occurrence in the text, or at the `|` inside of it.
    pub(crate) fn ask_at(&mut self, method: &str, path: &Path, text: &str, mark: &str) -> Json {
        let params = place(path, text, mark);
        self.ask(method, params)
    }

    /// Returns the labels of the completions at the position that `mark` denotes.
    pub(crate) fn complete_at(&mut self, path: &Path, text: &str, mark: &str) -> Vec<String> {
        let found = self.ask_at("textDocument/completion", path, text, mark);
        let items = found["items"].as_array().into_iter().flatten();
        items.map(|item| item["label"].as_str().unwrap().to_owned()).collect()
    }
}

impl Drop for Editor {
    fn drop(&mut self) {
        if std::thread::panicking() {
            return;
        }
        self.ask("shutdown", Json::Null);
        self.tell("exit", Json::Null);
        drop(self.connection.take());
        self.server.take().unwrap().join().unwrap().unwrap();
    }
}

pub(crate) fn uri(path: &Path) -> String {
    format!("file://{}", path.display())
}

/// Returns the line and column (in UTF-16 units) of a byte offset.
pub(crate) fn position(text: &str, at: usize) -> Json {
    let before = &text[..at];
    let line = before.matches('\n').count();
    let column = before.rsplit('\n').next().unwrap().encode_utf16().count();
    json!({ "line": line, "character": column })
}

pub(crate) fn place(path: &Path, text: &str, mark: &str) -> Json {
    let (before, behind) = mark.split_once('|').unwrap_or((mark, ""));
    let whole = format!("{before}{behind}");
    let start = text.find(&whole).unwrap_or_else(|| panic!("`{whole}` is not in the text"));
    json!({ "textDocument": { "uri": uri(path) }, "position": position(text, start + before.len()) })
}

/// Applies a list of text edits to a text.
pub(crate) fn apply_edits(text: &str, edits: &Json) -> String {
    fn byte(position: &Json, text: &str) -> usize {
        let (line, column) =
            (position["line"].as_u64().unwrap(), position["character"].as_u64().unwrap());
        let start = text.split_inclusive('\n').take(line as usize).map(str::len).sum::<usize>();
        let mut units = 0;
        let rest = text[start..].char_indices().find(|(_, c)| {
            let is_there = units == column;
            units += c.len_utf16() as u64;
            is_there
        });
        rest.map_or(text.len(), |(at, _)| start + at)
    }
    let mut spans: Vec<_> = edits
        .as_array()
        .unwrap()
        .iter()
        .map(|edit| {
            let range = &edit["range"];
            (
                byte(&range["start"], text),
                byte(&range["end"], text),
                edit["newText"].as_str().unwrap(),
            )
        })
        .collect();
    spans.sort_unstable();
    let mut new = text.to_owned();
    for (start, end, with) in spans.into_iter().rev() {
        new.replace_range(start..end, with);
    }
    new
}
