//! The server: it listens to an editor, and answers.

use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::sync::Arc;
use std::sync::mpsc::Sender;
use std::time::{Duration, Instant};

use gen_lsp_types::{
    DidChangeTextDocumentParams, DidCloseTextDocumentParams, DidOpenTextDocumentParams,
    DidSaveTextDocumentParams, InitializeParams, TextDocumentContentChangeEvent, Uri,
};
use lsp_server::{Connection, ErrorCode, Message, Notification, Request, RequestId, Response};
use maquette_edit::real;
use maquette_engine::session::Session;
use maquette_graph::catalog::Catalog;
use maquette_graph::{Graph, Options};
use maquette_syntax::error::in_words;
use maquette_syntax::paths::{MARKER, project_root};
use maquette_syntax::{Passed, each_word, first_word};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::{Value as Json, json};

use super::checker::Checker;
use super::commands::Commands;
use super::last::Last;
use super::library::Library;
use super::place::{Columns, Lines, path_of};
use super::project::Project;
use crate::{capabilities, checker, place};

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
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "camelCase", default)]
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

/// A text that is open in the editor.
pub struct Document {
    /// As the editor writes it.
    pub(crate) uri: Uri,
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
    /// It asks for hints and lenses again when it is told to.
    pub(crate) refreshes: bool,
    pub(crate) shows_documents: bool,
    /// It shows how far work is.
    pub(crate) progress: bool,
    /// Edits may make files.
    pub(crate) creates_files: bool,
    /// It asks for the edits of an action that is chosen.
    pub(crate) resolves: bool,
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
}

/// Why there is no answer.
pub enum Refused {
    /// The request cannot be understood.
    Invalid(String),
    /// It can, but not be done: in words for the user.
    Failed(String),
}

impl From<String> for Refused {
    fn from(why: String) -> Self {
        Self::Failed(why)
    }
}

/// Serves an editor until it says that it ends, or is gone.
///
/// # Errors
/// In words, if it does not speak the protocol.
pub fn serve(connection: &Connection, setup: Setup) -> Result<(), String> {
    let begun = connection.initialize_start().map_err(|error| error.to_string())?;
    let (id, params) = begun;
    let params: InitializeParams =
        serde_json::from_value(params).map_err(|error| error.to_string())?;
    let client = capabilities::of_client(&params.capabilities);
    let told = capabilities::of_server(client.columns);
    connection.initialize_finish(id, told).map_err(|error| error.to_string())?;
    let given = params.initialization_options.filter(|given| !given.is_null());
    let choices = given.and_then(|given| serde_json::from_value(given).ok()).unwrap_or_default();
    let sender = connection.sender.clone();
    let Setup { session, program, words } = setup;
    let catalog = session.shared_catalog();
    let (checks, checker) = Checker::start(catalog.clone(), client, sender.clone());
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
    };
    let ended = server.listen(connection);
    drop(server);
    let _ = checker.join();
    ended
}

impl Server {
    pub(crate) fn listen(&mut self, connection: &Connection) -> Result<(), String> {
        for message in &connection.receiver {
            match message {
                Message::Request(request) => {
                    if connection.handle_shutdown(&request).map_err(|error| error.to_string())? {
                        return Ok(());
                    }
                    self.request(request);
                }
                Message::Notification(told) if told.method == "exit" => return Ok(()),
                Message::Notification(told) => self.hear(told),
                Message::Response(_) => {}
            }
        }
        Ok(())
    }

    pub(crate) fn request(&mut self, Request { id, method, params }: Request) {
        if method == "workspace/executeCommand" {
            return self.execute(id, &params);
        }
        let answer = catch_unwind(AssertUnwindSafe(|| self.answer(&method, params)));
        let response = match answer {
            Ok(Ok(result)) => Response::new_ok(id, result),
            Ok(Err(Refused::Failed(why))) => {
                Response::new_err(id, ErrorCode::RequestFailed as i32, why)
            }
            Ok(Err(Refused::Invalid(why))) => {
                Response::new_err(id, ErrorCode::InvalidRequest as i32, why)
            }
            Err(panic) => {
                let why = format!("a bug of the language server: {}", in_words(&*panic));
                Response::new_err(id, ErrorCode::InternalError as i32, why)
            }
        };
        // Nobody is left to tell if this fails.
        let _ = self.sender.send(response.into());
    }

    pub(crate) fn hear(&mut self, Notification { method, params }: Notification) {
        match &method[..] {
            "textDocument/didOpen" => {
                let Ok(DidOpenTextDocumentParams { text_document: it }) =
                    serde_json::from_value(params)
                else {
                    return;
                };
                self.put(it.uri, it.version, it.text);
            }
            "textDocument/didChange" => {
                let Ok(changed) = serde_json::from_value::<DidChangeTextDocumentParams>(params)
                else {
                    return;
                };
                let uri = changed.text_document.text_document_identifier.uri;
                let Some(last) = changed.content_changes.into_iter().last() else { return };
                // The whole text, as was agreed.
                let text = match last {
                    TextDocumentContentChangeEvent::TextDocumentContentChangePartial(it) => it.text,
                    TextDocumentContentChangeEvent::TextDocumentContentChangeWholeDocument(it) => {
                        it.text
                    }
                };
                self.put(uri, changed.text_document.version, text);
            }
            "textDocument/didClose" => {
                let Ok(closed) = serde_json::from_value::<DidCloseTextDocumentParams>(params)
                else {
                    return;
                };
                if let Some(path) = path_of(&closed.text_document.uri) {
                    self.documents.remove(&real(&path));
                }
                self.check(None);
            }
            "textDocument/didSave" => {
                let saved = serde_json::from_value::<DidSaveTextDocumentParams>(params).ok();
                self.check(saved.and_then(|saved| path_of(&saved.text_document.uri)));
            }
            "workspace/didChangeWatchedFiles" => self.check(None),
            "workspace/didChangeConfiguration" => {
                let given = params["settings"]["maquette"].clone();
                if let Ok(choices) = serde_json::from_value(given) {
                    self.choices = choices;
                    self.check(None);
                }
            }
            "window/workDoneProgress/cancel" => self.commands.cancel(&params["token"]),
            _ => {}
        }
    }

    /// A text is open, or has changed.
    pub(crate) fn put(&mut self, uri: Uri, version: i32, text: String) {
        let Some(path) = path_of(&uri).map(|path| real(&path)) else { return };
        self.documents
            .insert(path.clone(), Document { uri, version, text: text.into(), last: None });
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
        let uris = self.documents.iter().map(|(path, it)| (path.clone(), it.uri.clone())).collect();
        // The thread lives as long as this.
        let _ = self.checks.send(checker::Job::Check { open, uris, options: self.options() });
    }

    /// How graphs are read: with what has not been saved yet.
    pub(crate) fn options(&self) -> Options {
        let texts = self.documents.iter().map(|(path, it)| (path.clone(), it.text.to_string()));
        let roots = self.choices.roots.clone();
        Options { texts: texts.collect(), roots, pins: true, ..Options::default() }
    }

    /// A number for a request of our own.
    pub(crate) fn number(&mut self) -> RequestId {
        self.next += 1;
        format!("maquette-{}", self.next).into()
    }

    /// Opens a file or a page in the editor, or asks its system to.
    pub(crate) fn show(&mut self, uri: &str, external: bool) {
        if self.client.shows_documents && !self.choices.shows {
            let params = json!({ "uri": uri, "external": external, "takeFocus": true });
            let request =
                Request { id: self.number(), method: "window/showDocument".into(), params };
            let _ = self.sender.send(request.into());
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
    /// The text that a request is about; none if it is not one of ours, of which nothing is said.
    pub(crate) fn subject<'s>(&self, uri: &Uri, text: &'s mut Arc<str>) -> Option<Subject<'s>> {
        let path = real(&path_of(uri)?);
        let document = self.documents.get(&path)?;
        if !is_ours(&path, &document.text) && !is_new(&path, &document.text) {
            return None;
        }
        *text = document.text.clone();
        let lines = Lines::new(text, self.client.columns);
        Some(Subject { path, uri: document.uri.clone(), lines, options: self.options() })
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
            .map_or_else(|| place::uri_of(path), |document| document.uri.clone())
    }

    /// The text of a file, open or not.
    pub(crate) fn text(&self, path: &Path) -> Arc<str> {
        let open = self.documents.get(path).map(|document| document.text.clone());
        open.unwrap_or_else(|| maquette_value::plain::read_text(path).unwrap_or_default().into())
    }
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

/// What a request says.
pub fn read<P: DeserializeOwned>(params: Json) -> Result<P, Refused> {
    serde_json::from_value(params).map_err(|error| Refused::Invalid(error.to_string()))
}
