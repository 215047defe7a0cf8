//! The server: it listens to an editor, and answers.

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
use maquette_edit::real;
use maquette_engine::session::Session;
use maquette_graph::catalog::Catalog;
use maquette_graph::{Graph, Options};
use maquette_syntax::error::in_words;
use maquette_syntax::paths::{MARKER, project_root};
use maquette_syntax::{Passed, each_word, first_word};
use serde_json::{Value as Json, json};

use super::checker::Checker;
use super::commands::Commands;
use super::last::Last;
use super::library::Library;
use super::params::Refused;
use super::place::{Columns, Lines, path_of};
use super::project::Project;
use super::transport::id_of;
use super::watcher::Event;
use crate::{capabilities, checker, params, place, process};

/// What the last evaluation found is looked up again after so long.
pub const FRESH: Duration = Duration::from_secs(1);

/// What the server stands on.
pub struct Setup {
    /// Looks up what evaluations found, and what packs offer; runs nothing.
    pub session: Session,
    /// The program that runs graphs, with the words of `maquette`.
    pub program: PathBuf,
    /// What it is told each time beside these, such as where results are kept: `--cache`, `DIR`.
    pub words: Vec<String>,
}

/// What an editor's user may choose.
#[derive(Clone, Debug)]
pub struct Choices {
    /// Folders outside of the project that graphs may read.
    pub(crate) roots: Vec<PathBuf>,
    /// Whether shapes and times stand behind the lines.
    pub(crate) hints: bool,
    /// Whether the editor shows what commands answer by itself.
    pub(crate) shows: bool,
    /// Of a text with more kilobytes only its problems are told; 0 for no such limit.
    pub(crate) large_files: usize,
}

impl Default for Choices {
    fn default() -> Self {
        Self { roots: Vec::new(), hints: true, shows: false, large_files: 1_000 }
    }
}

impl Choices {
    /// Takes the settings that are given and can be understood; the others stay.
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

/// A text that is open in the editor.
pub struct Document {
    /// As the editor writes them: a file may be open under several names, by links.
    pub(crate) uris: Vec<Uri>,
    pub(crate) version: i32,
    pub(crate) text: Arc<str>,
    /// What the last evaluation found, and when that was looked up.
    pub(crate) last: Option<(Instant, usize, Rc<Last>)>,
}

/// What the editor can do.
#[derive(Clone, Copy, Debug, Default)]
pub struct Client {
    pub(crate) columns: Columns,
    pub(crate) snippets: bool,
    /// Places that belong to a problem are shown beside it.
    pub(crate) related: bool,
    /// It asks for hints again when it is told to.
    pub(crate) refreshes_hints: bool,
    /// The same of lenses.
    pub(crate) refreshes_lenses: bool,
    pub(crate) shows_documents: bool,
    /// It shows how far work is.
    pub(crate) progress: bool,
    /// Edits may make files.
    pub(crate) creates_files: bool,
    /// It asks for the edits of an action that is chosen.
    pub(crate) resolves: bool,
    /// Actions may have edits; else they are commands.
    pub(crate) has_action_literals: bool,
    /// Symbols may have children.
    pub(crate) has_symbol_trees: bool,
    pub(crate) hovers_markdown: bool,
    pub(crate) completes_markdown: bool,
    /// It can be asked for settings.
    pub(crate) has_configuration: bool,
    /// It tells of changed files when it is asked to.
    pub(crate) watches_files: bool,
}

pub struct Server {
    pub(crate) catalog: Arc<Catalog>,
    pub(crate) session: Session,
    pub(crate) client: Client,
    pub(crate) choices: Choices,
    pub(crate) sender: crossbeam_channel::Sender<Message>,
    pub(crate) documents: BTreeMap<PathBuf, Document>,
    pub(crate) project: Project,
    pub(crate) checks: Sender<checker::Job>,
    pub(crate) commands: Commands,
    pub(crate) next: i32,
    /// The folders that the editor has open.
    pub(crate) folders: Vec<PathBuf>,
    /// The editor has asked the server to end.
    is_shut_down: bool,
}

/// Serves an editor until it says that it ends, or is gone.
///
/// # Errors
/// In words, if it ends in another way than the protocol says.
pub fn serve(connection: &Connection, setup: Setup) -> Result<(), String> {
    let (id, params) = initialize(connection)?;
    let client = capabilities::of_client(&params["capabilities"]);
    let sender = connection.sender.clone();
    let answer = Response::new_ok(id, capabilities::of_server(client));
    sender.send(answer.into()).map_err(|_| "the editor reads nothing".to_owned())?;
    let (happened, events) = crossbeam_channel::unbounded();
    if let Some(editor) = params::number(&params["processId"]) {
        process::watch(editor, happened.clone());
    }
    let mut choices = Choices::default();
    choices.update(&params["initializationOptions"]);
    let Setup { session, program, words } = setup;
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

/// Waits for the first request, and gives its id and fields.
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
            Message::Notification(told) if told.method == "exit" => {
                return Err("expected `initialize`, found `exit`".into());
            }
            Message::Notification(_) | Message::Response(_) => {}
        }
    }
    Err("expected `initialize`, found the end of the input".into())
}

/// The folders that an editor has open.
fn folders(params: &Json) -> Vec<PathBuf> {
    let several = params["workspaceFolders"].as_array();
    let uris = several.into_iter().flatten().map(|folder| &folder["uri"]);
    let uris = uris.chain([&params["rootUri"]]).filter_map(Json::as_str);
    let mut folders: Vec<_> = uris.filter_map(|uri| path_of(&uri.into())).collect();
    if let (true, Some(root)) = (folders.is_empty(), params["rootPath"].as_str()) {
        folders.push(root.into());
    }
    folders.iter().map(|folder| real(folder)).collect()
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
                            // Without events there is no checker either.
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
                Some(Message::Notification(told)) if told.method == "exit" => {
                    return match self.is_shut_down {
                        true => Ok(()),
                        false => Err("expected `shutdown` before `exit`".into()),
                    };
                }
                Some(Message::Notification(told)) if !self.is_shut_down => self.hear(told),
                Some(Message::Response(answer)) => self.answered(answer),
                Some(Message::Notification(_)) | None => {}
            }
        }
    }

    fn refuse(&self, id: RequestId, code: ErrorCode, why: String) {
        // Nobody is left to tell if this fails.
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
            Ok(Err(Refused::Failed(why))) => self.refuse(id, ErrorCode::RequestFailed, why),
            Ok(Err(Refused::Invalid(why))) => self.refuse(id, ErrorCode::InvalidParams, why),
            Ok(Err(Refused::Unknown(method))) => {
                let why = format!("there is no method `{method}` here");
                self.refuse(id, ErrorCode::MethodNotFound, why);
            }
            Err(panic) => {
                let why = format!("a bug of the language server: {}", in_words(&*panic));
                self.refuse(id, ErrorCode::InternalError, why);
            }
        }
    }

    pub(crate) fn hear(&mut self, Notification { method, params }: Notification) {
        let heard = catch_unwind(AssertUnwindSafe(|| self.take_note(&method, &params)));
        if let Err(panic) = heard {
            let why = format!("a bug of the language server: {}", in_words(&*panic));
            let params = json!({ "type": 1, "message": why });
            let method = "window/logMessage".to_owned();
            let _ = self.sender.send(Notification { method, params }.into());
        }
    }

    fn take_note(&mut self, method: &str, params: &Json) {
        let document = &params["textDocument"];
        let uri = document["uri"].as_str().map(|uri| Uri(uri.to_owned()));
        // An editor that counts in another way still changes its texts.
        let version = document["version"].as_f64().map_or(0, |version| version as i32);
        match (method, uri) {
            ("initialized", _) => self.register(),
            ("textDocument/didOpen", Some(uri)) => {
                if let Some(text) = document["text"].as_str() {
                    let path = path_of(&uri).map(|path| real(&path));
                    if self.is_large(text) && path.is_some_and(|path| is_ours(&path, text)) {
                        self.show_large(&uri, text.len());
                    }
                    self.put(uri, version, text.to_owned());
                }
            }
            ("textDocument/didChange", Some(uri)) => {
                let Some(path) = path_of(&uri).map(|path| real(&path)) else { return };
                let Some(known) = self.documents.get(&path) else { return };
                let mut text = known.text.to_string();
                for change in params["contentChanges"].as_array().into_iter().flatten() {
                    let Some(new) = change["text"].as_str() else { continue };
                    // The whole text, as was agreed, unless an editor says a part.
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
                let Some(path) = path_of(&uri).map(|path| real(&path)) else { return };
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

    /// Takes the answer to a request of ours.
    fn answered(&mut self, answer: Response) {
        let is_configuration = answer.id.to_string().contains(CONFIGURATION);
        if let (true, Ok(settings)) = (is_configuration, &answer.response_result) {
            self.choices.update(&settings[0]);
            self.check(None);
        }
    }

    /// Asks to be told of changed graphs, where the editor can do that. Other files that texts depend on are looked at by the checker.
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

    /// A text is open, or has changed.
    pub(crate) fn put(&mut self, uri: Uri, version: i32, text: String) {
        let Some(path) = path_of(&uri).map(|path| real(&path)) else { return };
        let known = self.documents.remove(&path).map(|document| document.uris);
        let mut uris = known.unwrap_or_default();
        if !uris.contains(&uri) {
            uris.push(uri);
        }
        let document = Document { uris, version, text: text.into(), last: None };
        self.documents.insert(path.clone(), document);
        self.check(Some(path));
    }

    /// Has all that is open checked, this text first.
    pub(crate) fn check(&mut self, first: Option<PathBuf>) {
        self.project.forget();
        let first = first.map(|path| real(&path));
        let mut open = Vec::new();
        for (path, document) in self.documents.iter().filter(|(path, it)| is_ours(path, &it.text)) {
            let (version, text) = (document.version, document.text.clone());
            let document = checker::Open { path: path.clone(), version, text };
            match first.as_ref() == Some(path) {
                true => open.insert(0, document),
                false => open.push(document),
            }
        }
        let uris =
            self.documents.iter().map(|(path, it)| (path.clone(), it.uris.clone())).collect();
        // The thread lives as long as this.
        let _ = self.checks.send(checker::Job::Check { open, uris, options: self.options() });
    }

    /// How graphs are read: with what has not been saved yet.
    pub(crate) fn options(&self) -> Options {
        let texts = self.documents.iter().map(|(path, it)| (path.clone(), it.text.to_string()));
        let roots = self.choices.roots.clone();
        Options { texts: texts.collect(), roots, pins: true, ..Options::default() }
    }

    /// Opens a file or a page in the editor, or asks its system to.
    pub(crate) fn show(&mut self, uri: &str, external: bool) {
        if self.client.shows_documents && !self.choices.shows {
            let params = json!({ "uri": uri, "external": external, "takeFocus": true });
            self.ask("window/showDocument", params);
        }
    }
}

/// What is known of the text that a request is about.
pub struct Subject<'s> {
    pub(crate) path: PathBuf,
    pub(crate) uri: Uri,
    pub(crate) lines: Lines<'s>,
    pub(crate) options: Options,
}

impl Server {
    /// The text that a request is about; `None` if it is not one of ours, of which nothing is said, or a large one, of which only problems
    /// are reported.
    pub(crate) fn subject<'s>(&self, uri: &Uri, text: &'s mut Arc<str>) -> Option<Subject<'s>> {
        let path = real(&path_of(uri)?);
        let document = self.documents.get(&path)?;
        let text_is_ours = is_ours(&path, &document.text) || is_new(&path, &document.text);
        if !text_is_ours || self.is_large(&document.text) {
            return None;
        }
        *text = document.text.clone();
        let lines = Lines::new(text, self.client.columns);
        Some(Subject { path, uri: uri.clone(), lines, options: self.options() })
    }

    /// Shows why a large file has diagnostics only.
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

    /// Whether only the problems of a text are told.
    pub(crate) fn is_large(&self, text: &str) -> bool {
        self.choices.large_files != 0 && self.choices.large_files * 1_000 < text.len()
    }

    /// What the last evaluation of a graph found.
    pub(crate) fn last(&mut self, path: &Path) -> Rc<Last> {
        let evaluations = self.commands.evaluations();
        let known = self.documents.get(path).and_then(|document| document.last.as_ref());
        if let Some((when, count, last)) = known
            && when.elapsed() < FRESH
            && *count == evaluations
        {
            return last.clone();
        }
        let checked = Graph::load(path, &self.catalog, &self.options());
        let Some(document) = self.documents.get_mut(path) else { return Rc::default() };
        let graph = checked.graph.or(checked.partial);
        let last = match (graph, &document.last) {
            (Some(graph), _) => Rc::new(Last::of(&graph, &mut self.session)),
            // Of a text that is being written.
            (None, Some((.., last))) => last.clone(),
            (None, None) => Rc::default(),
        };
        document.last = Some((Instant::now(), evaluations, last.clone()));
        last
    }

    pub(crate) fn library<'a>(&'a self, path: &'a Path, options: &'a Options) -> Library<'a> {
        Library::new(&self.catalog, path, options)
    }

    /// The URI of a file: as the editor writes it, where it is open.
    pub(crate) fn uri(&self, path: &Path) -> Uri {
        self.documents
            .get(path)
            .and_then(|document| document.uris.last().cloned())
            .unwrap_or_else(|| place::uri_of(path))
    }

    /// The text of a file, open or not.
    pub(crate) fn text(&self, path: &Path) -> Arc<str> {
        let open = self.documents.get(path).map(|document| document.text.clone());
        open.unwrap_or_else(|| maquette_value::plain::read_text(path).unwrap_or_default().into())
    }
}

/// The method by which editors are asked for settings.
const CONFIGURATION: &str = "workspace/configuration";

/// Returns true if one of these messages cancels a request.
fn is_cancelled(id: &RequestId, waiting: &VecDeque<Message>) -> bool {
    waiting.iter().any(|message| match message {
        Message::Notification(told) => {
            told.method == "$/cancelRequest" && id_of(&told.params["id"]) == *id
        }
        Message::Request(_) | Message::Response(_) => false,
    })
}

/// Returns true if a text is a graph, a patch, a test or a sweep. Without a project around it, it must have a field of these, since
/// others write RON, too.
pub fn is_ours(path: &Path, text: &str) -> bool {
    let fields: &[&str] = match first_word(text) {
        "Graph" => &["nodes", "outputs"],
        "Patch" => &["of"],
        "Test" | "Sweep" => &["graph"],
        _ => return false,
    };
    is_in_project(path) || is_ron(path) && has_field(text, fields)
}

/// Returns true if one of these words is a field of the call that a text holds.
fn has_field(text: &str, fields: &[&str]) -> bool {
    let mut found = false;
    each_word(text, |frames, passed| {
        if let Passed::Name(name) = passed {
            found |= frames.len() == 1 && fields.contains(&&name.text[..]);
        }
    });
    found
}

/// Whether nothing has been written yet that could tell.
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
