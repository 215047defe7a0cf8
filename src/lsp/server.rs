//! The language server: reads the messages of an editor and answers them.

use std::collections::{BTreeMap, VecDeque};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::sync::Arc;
use std::sync::mpsc::Sender;
use std::time::{Duration, Instant};

use crossbeam_channel::{Receiver, select};
use gen_lsp_types::Uri;
use lsp_server::{Connection, ErrorCode, Message, Notification, Request, RequestId, Response};
use maquette_edit::resolve_path;
use maquette_engine::session::Session;
use maquette_graph::catalog::Catalog;
use maquette_graph::{Graph, Options};
use maquette_syntax::error::panic_message;
use maquette_syntax::paths::{MARKER, project_root};
use maquette_syntax::{WalkEvent, first_word, for_each_word};
use serde_json::{Value as Json, json};

use super::checker::Checker;
use super::commands::Commands;
use super::last_run::LastRun;
use super::library::Library;
use super::params::RequestError;
use super::position::{Columns, Lines, path_of};
use super::project::Project;
use super::transport::id_of;
use super::watcher::Event;
use crate::{capabilities, checker, params, position, process};

/// The interval at which the results of the last evaluation are looked up again, even if the server has not noticed an evaluation.
pub const LOOKUP_INTERVAL: Duration = Duration::from_secs(1);

/// The arguments with which the server is started.
pub struct Setup {
    /// The session for looking up node types and cached results. It never evaluates.
    pub session: Session,
    /// The path of the program that runs graphs. It accepts the arguments of `maquette`.
    pub program: PathBuf,
    /// Additional arguments for that program, such as the cache folder: `--cache`, `DIR`.
    pub arguments: Vec<String>,
}

/// The settings of the user in the editor.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Folders outside of the project from which graphs may read.
    pub(crate) roots: Vec<PathBuf>,
    /// True if inlay hints show the shapes and times of results.
    pub(crate) hints: bool,
    /// True if the editor itself shows the results of commands, not the server.
    pub(crate) shows: bool,
    /// The size in kilobytes above which a document gets only diagnostics; 0 for no limit.
    pub(crate) large_files: usize,
}

impl Default for Settings {
    fn default() -> Self {
        Self { roots: Vec::new(), hints: true, shows: false, large_files: 1_000 }
    }
}

impl Settings {
    /// Applies all valid settings in `given`. Missing and invalid settings do not change.
    fn update(&mut self, given: &Json) {
        let given = given.get("maquette").unwrap_or(given);
        if let Some(roots) = given["roots"].as_array() {
            self.roots = roots.iter().filter_map(Json::as_str).map(PathBuf::from).collect();
        }
        for (name, choice) in [("hints", &mut self.hints), ("shows", &mut self.shows)] {
            *choice = given[name].as_bool().unwrap_or(*choice);
        }
        if let Some(kilobytes) = params::number(&given["largeFiles"]) {
            self.large_files = kilobytes as usize;
        }
    }
}

/// A document that is open in the editor.
pub struct Document {
    /// The URIs of the document, exactly as the editor writes them. There may be several, because symbolic links give a file several paths.
    pub(crate) uris: Vec<Uri>,
    pub(crate) version: i32,
    pub(crate) text: Arc<str>,
    /// The results of the last evaluation of the document. The instant is the time when they were looked up; the number is that of the
    /// evaluations that had ended by then. `None` before the first lookup.
    pub(crate) last: Option<(Instant, usize, Rc<LastRun>)>,
}

/// The capabilities that the editor has declared.
#[derive(Clone, Copy, Debug, Default)]
pub struct ClientCapabilities {
    pub(crate) columns: Columns,
    pub(crate) snippets: bool,
    /// True if the editor shows the related information that a diagnostic contains.
    pub(crate) related: bool,
    /// True if the editor requests inlay hints again when the server asks for it.
    pub(crate) refreshes_hints: bool,
    /// True if the editor requests code lenses again when the server asks for it.
    pub(crate) refreshes_lenses: bool,
    pub(crate) shows_documents: bool,
    /// True if the editor shows the progress of commands.
    pub(crate) progress: bool,
    /// True if the editor can apply edits that create files.
    pub(crate) creates_files: bool,
    /// True if the edits of a code action may be computed later, when the user has chosen the action.
    pub(crate) resolves_actions: bool,
    /// True if a code action may contain edits, instead of only a command.
    pub(crate) has_action_literals: bool,
    /// True if document symbols may contain other symbols.
    pub(crate) has_symbol_trees: bool,
    pub(crate) hovers_markdown: bool,
    pub(crate) completes_markdown: bool,
    /// True if the editor answers requests for its settings.
    pub(crate) has_configuration: bool,
    /// True if the editor can notify the server of changed files.
    pub(crate) watches_files: bool,
}

pub struct Server {
    pub(crate) catalog: Arc<Catalog>,
    pub(crate) session: Session,
    pub(crate) client: ClientCapabilities,
    pub(crate) choices: Settings,
    pub(crate) sender: crossbeam_channel::Sender<Message>,
    pub(crate) documents: BTreeMap<PathBuf, Document>,
    pub(crate) project: Project,
    pub(crate) checks: Sender<checker::Job>,
    pub(crate) commands: Commands,
    pub(crate) next: i32,
    /// The folders that are open in the editor.
    pub(crate) folders: Vec<PathBuf>,
    /// True if the editor has requested `shutdown`.
    is_shut_down: bool,
}

/// Serves an editor until it sends `exit` or its process ends.
///
/// # Errors
/// A message if the session does not end as the protocol specifies.
pub fn serve(connection: &Connection, setup: Setup) -> Result<(), String> {
    let (id, params) = initialize(connection)?;
    let client = capabilities::of_client(&params["capabilities"]);
    let sender = connection.sender.clone();
    let answer = Response::new_ok(id, capabilities::of_server(client));
    sender.send(answer.into()).map_err(|_| "the editor does not read answers".to_owned())?;
    let (happened, events) = crossbeam_channel::unbounded();
    if let Some(editor) = params::number(&params["processId"]) {
        process::watch(editor, happened.clone());
    }
    let mut choices = Settings::default();
    choices.update(&params["initializationOptions"]);
    let Setup { session, program, arguments: words } = setup;
    let catalog = session.shared_catalog();
    let (checks, checker) = Checker::start(catalog.clone(), client, sender.clone(), happened);
    let commands = Commands::new((program, words), client, sender.clone(), checks.clone());
    let (documents, project) = (BTreeMap::new(), Project::default());
    let mut server = Server {
        catalog,
        session,
        client,
        choices,
        sender,
        documents,
        project,
        checks,
        commands,
        next: 0,
        folders: folders(&params),
        is_shut_down: false,
    };
    let ended = server.listen(&connection.receiver, &events);
    drop(server);
    let _ = checker.join();
    ended
}

/// Waits for the request `initialize`. Returns its id and its parameters.
fn initialize(connection: &Connection) -> Result<(RequestId, Json), String> {
    for message in &connection.receiver {
        match message {
            Message::Request(request) if request.method == "initialize" => {
                return Ok((request.id, request.params));
            }
            Message::Request(Request { id, method, .. }) => {
                let why = format!("expected `initialize`, found `{method}`");
                let code = ErrorCode::ServerNotInitialized as i32;
                let _ = connection.sender.send(Response::new_err(id, code, why).into());
            }
            Message::Notification(notification) if notification.method == "exit" => {
                return Err("expected `initialize`, found `exit`".into());
            }
            Message::Notification(_) | Message::Response(_) => {}
        }
    }
    Err("expected `initialize`, found the end of the input".into())
}

/// Returns the folders that are open in the editor.
fn folders(params: &Json) -> Vec<PathBuf> {
    let several = params["workspaceFolders"].as_array();
    let uris = several.into_iter().flatten().map(|folder| &folder["uri"]);
    let uris = uris.chain([&params["rootUri"]]).filter_map(Json::as_str);
    let mut folders: Vec<_> = uris.filter_map(|uri| path_of(&uri.into())).collect();
    if let (true, Some(root)) = (folders.is_empty(), params["rootPath"].as_str()) {
        folders.push(root.into());
    }
    folders.iter().map(|folder| resolve_path(folder)).collect()
}

impl Server {
    fn listen(
        &mut self,
        messages: &Receiver<Message>,
        events: &Receiver<Event>,
    ) -> Result<(), String> {
        let mut waiting = VecDeque::new();
        loop {
            if waiting.is_empty() {
                select! {
                    recv(messages) -> message => match message {
                        Ok(message) => waiting.push_back(message),
                        Err(_) => return Ok(()),
                    },
                    recv(events) -> event => {
                        match event {
                            Ok(Event::FilesChanged) => self.check(None),
                            // An error means that the checker thread has ended. The server cannot work without that thread, so it ends,
                            // too.
                            Ok(Event::EditorEnded) | Err(_) => return Ok(()),
                        }
                        continue;
                    }
                }
            }
            waiting.extend(messages.try_iter());
            match waiting.pop_front() {
                Some(Message::Request(request)) if is_cancelled(&request.id, &waiting) => {
                    self.refuse(request.id, ErrorCode::RequestCanceled, "cancelled".into());
                }
                Some(Message::Request(request)) => self.request(request),
                Some(Message::Notification(notification)) if notification.method == "exit" => {
                    return match self.is_shut_down {
                        true => Ok(()),
                        false => Err("expected `shutdown` before `exit`".into()),
                    };
                }
                Some(Message::Notification(notification)) if !self.is_shut_down => {
                    self.handle_notification(notification);
                }
                Some(Message::Response(answer)) => self.receive_answer(answer),
                Some(Message::Notification(_)) | None => {}
            }
        }
    }

    fn refuse(&self, id: RequestId, code: ErrorCode, why: String) {
        // Ignore an error: sending fails only if the editor has ended.
        let _ = self.sender.send(Response::new_err(id, code as i32, why).into());
    }

    pub(crate) fn request(&mut self, Request { id, method, params }: Request) {
        if self.is_shut_down || method == "initialize" {
            let why = match self.is_shut_down {
                true => format!("expected `exit` after `shutdown`, found `{method}`"),
                false => "expected `initialize` once, found it again".to_owned(),
            };
            return self.refuse(id, ErrorCode::InvalidRequest, why);
        }
        if method == "shutdown" {
            self.is_shut_down = true;
            self.commands.end();
            let _ = self.sender.send(Response::new_ok(id, ()).into());
            return;
        }
        if method == "workspace/executeCommand" {
            return self.execute(id, &params);
        }
        let answer = catch_unwind(AssertUnwindSafe(|| self.answer(&method, &params)));
        match answer {
            Ok(Ok(result)) => drop(self.sender.send(Response::new_ok(id, result).into())),
            Ok(Err(RequestError::Failed(why))) => self.refuse(id, ErrorCode::RequestFailed, why),
            Ok(Err(RequestError::Invalid(why))) => self.refuse(id, ErrorCode::InvalidParams, why),
            Ok(Err(RequestError::Unknown(method))) => {
                let why = format!("unknown method `{method}`");
                self.refuse(id, ErrorCode::MethodNotFound, why);
            }
            Err(panic) => {
                let why = format!("a bug of the language server: {}", panic_message(&*panic));
                self.refuse(id, ErrorCode::InternalError, why);
            }
        }
    }

    pub(crate) fn handle_notification(&mut self, Notification { method, params }: Notification) {
        let heard =
            catch_unwind(AssertUnwindSafe(|| self.handle_document_notification(&method, &params)));
        if let Err(panic) = heard {
            let why = format!("a bug of the language server: {}", panic_message(&*panic));
            let params = json!({ "type": 1, "message": why });
            let method = "window/logMessage".to_owned();
            let _ = self.sender.send(Notification { method, params }.into());
        }
    }

    fn handle_document_notification(&mut self, method: &str, params: &Json) {
        let document = &params["textDocument"];
        let uri = document["uri"].as_str().map(|uri| Uri(uri.to_owned()));
        // Treat a missing or invalid version as 0, so that the text is still updated.
        let version = document["version"].as_f64().map_or(0, |version| version as i32);
        match (method, uri) {
            ("initialized", _) => self.register(),
            ("textDocument/didOpen", Some(uri)) => {
                if let Some(text) = document["text"].as_str() {
                    let path = path_of(&uri).map(|path| resolve_path(&path));
                    if self.is_large(text) && path.is_some_and(|path| is_ours(&path, text)) {
                        self.show_large(&uri, text.len());
                    }
                    self.put(uri, version, text.to_owned());
                }
            }
            ("textDocument/didChange", Some(uri)) => {
                let Some(path) = path_of(&uri).map(|path| resolve_path(&path)) else { return };
                let Some(known) = self.documents.get(&path) else { return };
                let mut text = known.text.to_string();
                for change in params["contentChanges"].as_array().into_iter().flatten() {
                    let Some(new) = change["text"].as_str() else { continue };
                    // The server requests whole texts in changes, but some editors send only the changed ranges.
                    text = match params::range(&change["range"]) {
                        Ok(range) => {
                            let lines = Lines::new(&text, self.client.columns);
                            let (start, end) = (lines.offset(range.start), lines.offset(range.end));
                            [&text[..start], new, &text[end.max(start)..]].concat()
                        }
                        Err(_) => new.to_owned(),
                    };
                }
                self.put(uri, version, text);
            }
            ("textDocument/didClose", Some(uri)) => {
                let Some(path) = path_of(&uri).map(|path| resolve_path(&path)) else { return };
                if let Some(document) = self.documents.get_mut(&path) {
                    document.uris.retain(|known| *known != uri);
                    if document.uris.is_empty() {
                        self.documents.remove(&path);
                    }
                }
                self.check(None);
            }
            ("textDocument/didSave", uri) => self.check(uri.and_then(|uri| path_of(&uri))),
            ("workspace/didChangeWatchedFiles", _) => self.check(None),
            ("workspace/didChangeWorkspaceFolders", _) => {
                let added = folders(&json!({ "workspaceFolders": params["event"]["added"] }));
                let removed = folders(&json!({ "workspaceFolders": params["event"]["removed"] }));
                self.folders.retain(|folder| !removed.contains(folder));
                self.folders.extend(added);
            }
            ("workspace/didChangeConfiguration", _) => {
                if params["settings"].is_object() {
                    self.choices.update(&params["settings"]);
                    self.check(None);
                } else if self.client.has_configuration {
                    let items = json!({ "items": [{ "section": "maquette" }] });
                    self.ask(CONFIGURATION, items);
                }
            }
            ("$/cancelRequest", _) => self.commands.cancel_request(&id_of(&params["id"])),
            ("window/workDoneProgress/cancel", _) => self.commands.cancel(&params["token"]),
            _ => {}
        }
    }

    /// Handles the editor's answer to a request of the server.
    fn receive_answer(&mut self, answer: Response) {
        let is_configuration = answer.id.to_string().contains(CONFIGURATION);
        if let (true, Ok(settings)) = (is_configuration, &answer.response_result) {
            self.choices.update(&settings[0]);
            self.check(None);
        }
    }

    /// Asks the editor to report changed graph files, if the editor supports this. All other files on which documents depend are polled by
    /// the checker.
    fn register(&mut self) {
        if self.client.watches_files {
            let watchers =
                ["**/*.ron", "**/maquette.toml"].map(|glob| json!({ "globPattern": glob }));
            let method = "workspace/didChangeWatchedFiles";
            let options = json!({ "watchers": watchers });
            let registration =
                json!({ "id": "files", "method": method, "registerOptions": options });
            self.ask("client/registerCapability", json!({ "registrations": [registration] }));
        }
    }

    /// Sends a request to the editor.
    pub(crate) fn ask(&mut self, method: &str, params: Json) {
        self.next += 1;
        let id = format!("maquette-{}-{method}", self.next).into();
        let _ = self.sender.send(Request { id, method: method.into(), params }.into());
    }

    /// Stores the new text of a document that was opened or changed, and checks it.
    pub(crate) fn put(&mut self, uri: Uri, version: i32, text: String) {
        let Some(path) = path_of(&uri).map(|path| resolve_path(&path)) else { return };
        let known = self.documents.remove(&path).map(|document| document.uris);
        let mut uris = known.unwrap_or_default();
        if !uris.contains(&uri) {
            uris.push(uri);
        }
        let document = Document { uris, version, text: text.into(), last: None };
        self.documents.insert(path.clone(), document);
        self.check(Some(path));
    }

    /// Checks all open documents, beginning with `first`.
    pub(crate) fn check(&mut self, first: Option<PathBuf>) {
        self.project.forget();
        let first = first.map(|path| resolve_path(&path));
        let mut open = Vec::new();
        for (path, document) in self.documents.iter().filter(|(path, it)| is_ours(path, &it.text)) {
            let (version, text) = (document.version, document.text.clone());
            let document = checker::OpenDocument { path: path.clone(), version, text };
            match first.as_ref() == Some(path) {
                true => open.insert(0, document),
                false => open.push(document),
            }
        }
        let uris =
            self.documents.iter().map(|(path, it)| (path.clone(), it.uris.clone())).collect();
        // Sending cannot fail, because the checker thread lives as long as the server.
        let _ = self.checks.send(checker::Job::Check { open, uris, options: self.options() });
    }

    /// Returns the options for loading graphs. They include the texts of unsaved documents.
    pub(crate) fn options(&self) -> Options {
        let texts = self.documents.iter().map(|(path, it)| (path.clone(), it.text.to_string()));
        let roots = self.choices.roots.clone();
        Options { texts: texts.collect(), roots, pins: true, ..Options::default() }
    }

    /// Opens a file or URL in the editor. If `external` is true, opens it in the system's default program instead.
    pub(crate) fn show(&mut self, uri: &str, external: bool) {
        if self.client.shows_documents && !self.choices.shows {
            let params = json!({ "uri": uri, "external": external, "takeFocus": true });
            self.ask("window/showDocument", params);
        }
    }
}

/// The document that a request is about.
pub struct Subject<'s> {
    pub(crate) path: PathBuf,
    pub(crate) uri: Uri,
    pub(crate) lines: Lines<'s>,
    pub(crate) options: Options,
}

impl Server {
    /// Returns the document that a request is about. Returns `None` if the document is not a graph, patch, test or sweep, or if it is so
    /// large that it gets only diagnostics.
    pub(crate) fn subject<'s>(&self, uri: &Uri, text: &'s mut Arc<str>) -> Option<Subject<'s>> {
        let path = resolve_path(&path_of(uri)?);
        let document = self.documents.get(&path)?;
        let text_is_ours = is_ours(&path, &document.text) || is_new(&path, &document.text);
        if !text_is_ours || self.is_large(&document.text) {
            return None;
        }
        *text = document.text.clone();
        let lines = Lines::new(text, self.client.columns);
        Some(Subject { path, uri: uri.clone(), lines, options: self.options() })
    }

    /// Shows the user a message that explains why a large file gets only diagnostics.
    fn show_large(&self, uri: &Uri, bytes: usize) {
        let message = format!(
            "{} has {} kB: only errors and warnings are reported; `largeFiles` (`maquette.largeFiles`) raises the limit of {} kB",
            path_of(uri).unwrap_or_default().display(),
            bytes / 1_000,
            self.choices.large_files
        );
        let params = json!({ "type": 3, "message": message });
        let method = "window/showMessage".to_owned();
        let _ = self.sender.send(Notification { method, params }.into());
    }

    /// Returns true if a text is so large that it gets only diagnostics.
    pub(crate) fn is_large(&self, text: &str) -> bool {
        self.choices.large_files != 0 && self.choices.large_files * 1_000 < text.len()
    }

    /// Returns the results of the last evaluation of a graph. They are looked up again after an evaluation, and at regular intervals.
    pub(crate) fn last_run(&mut self, path: &Path) -> Rc<LastRun> {
        let evaluations = self.commands.evaluations();
        let known = self.documents.get(path).and_then(|document| document.last.as_ref());
        if let Some((when, count, last)) = known
            && when.elapsed() < LOOKUP_INTERVAL
            && *count == evaluations
        {
            return last.clone();
        }
        let checked = Graph::load(path, &self.catalog, &self.options());
        let Some(document) = self.documents.get_mut(path) else { return Rc::default() };
        let graph = checked.graph.or(checked.partial);
        let last = match (graph, &document.last) {
            (Some(graph), _) => Rc::new(LastRun::load(&graph, &mut self.session)),
            // The document is not a valid graph at present. Keep the results of the last lookup with the present time, so that the next
            // lookup is not due at once.
            (None, Some((.., last))) => last.clone(),
            (None, None) => Rc::default(),
        };
        document.last = Some((Instant::now(), evaluations, last.clone()));
        last
    }

    pub(crate) fn library<'a>(&'a self, path: &'a Path, options: &'a Options) -> Library<'a> {
        Library::new(&self.catalog, path, options)
    }

    /// Returns the URI of a file. For an open document, this is the URI exactly as the editor writes it.
    pub(crate) fn uri(&self, path: &Path) -> Uri {
        self.documents
            .get(path)
            .and_then(|document| document.uris.last().cloned())
            .unwrap_or_else(|| position::uri_of(path))
    }

    /// Returns the text of a file: the current text of an open document, otherwise the content on disk.
    pub(crate) fn text(&self, path: &Path) -> Arc<str> {
        let open = self.documents.get(path).map(|document| document.text.clone());
        open.unwrap_or_else(|| maquette_value::fs::read_text(path).unwrap_or_default().into())
    }
}

/// The protocol method by which the server requests settings from the editor.
const CONFIGURATION: &str = "workspace/configuration";

/// Returns true if one of the messages in `waiting` cancels the request `id`.
fn is_cancelled(id: &RequestId, waiting: &VecDeque<Message>) -> bool {
    waiting.iter().any(|message| match message {
        Message::Notification(notification) => {
            notification.method == "$/cancelRequest" && id_of(&notification.params["id"]) == *id
        }
        Message::Request(_) | Message::Response(_) => false,
    })
}

/// Returns true if a text is a graph, patch, test or sweep. Outside of a project the text must also contain a field that is typical of
/// these files, because other programs also use the file format RON.
pub fn is_ours(path: &Path, text: &str) -> bool {
    let fields: &[&str] = match first_word(text) {
        "Graph" => &["nodes", "outputs"],
        "Patch" => &["of"],
        "Test" | "Sweep" => &["graph"],
        _ => return false,
    };
    is_in_project(path) || is_ron(path) && has_field(text, fields)
}

/// Returns true if the outermost call in a text has at least one of these fields.
fn has_field(text: &str, fields: &[&str]) -> bool {
    let mut found = false;
    for_each_word(text, |frames, passed| {
        if let WalkEvent::Name(name) = passed {
            found |= frames.len() == 1 && fields.contains(&&name.text[..]);
        }
    });
    found
}

/// Returns true if a file in a project has so little text that it may become a graph, patch, test or sweep.
pub fn is_new(path: &Path, text: &str) -> bool {
    let word = first_word(text);
    let begins = ["Graph", "Patch", "Test", "Sweep"].iter().any(|known| known.starts_with(word));
    is_in_project(path) && begins && text.trim().len() <= word.len()
}

pub fn is_in_project(path: &Path) -> bool {
    is_ron(path) && path.parent().is_some_and(|folder| project_root(folder).join(MARKER).is_file())
}

fn is_ron(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending == "ron")
}
