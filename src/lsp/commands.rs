//! Commands of the editor, such as running a graph. Each command runs in its own process, so a crash during an evaluation does not affect
//! the server.
//!
//! A command runs in the folder of the project and uses the saved files. The server itself evaluates nothing. The shapes, times and sizes
//! that it shows come from the record that every evaluation writes to disk (`last_run`). A forecast decides which of these results are
//! still valid.

use std::collections::HashMap;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::Sender;
use std::sync::{Arc, Mutex, MutexGuard};

use lsp_server::{ErrorCode, Message, Notification, Request, RequestId, Response};
use maquette_edit::resolve_path;
use maquette_syntax::error::Span;
use maquette_syntax::first_word;
use maquette_syntax::paths::project_root;
use maquette_value::fs::read_text;
use serde_json::{Value as Json, json};

use super::checker::{FileDiagnostics, Job};
use super::position::{Lines, path_of};
use super::{ClientCapabilities, Server};

/// The names of the commands in the protocol.
pub(super) const COMMANDS: [&str; 6] =
    ["maquette.run", "maquette.watch", "maquette.stop", "maquette.inspect", "maquette.why", APPLY];

/// The command that applies the edit in its argument. For editors whose code actions can only be commands.
pub(super) const APPLY: &str = "maquette.apply";

/// The environment variable that contains the process id of the parent. A child process ends when that parent ends.
pub const PARENT: &str = "MAQUETTE_PARENT";

/// The child processes that the server runs for the editor.
pub(super) struct Commands {
    program: PathBuf,
    /// The arguments that every child process gets, such as the cache folder.
    arguments: Vec<String>,
    client: ClientCapabilities,
    sender: crossbeam_channel::Sender<Message>,
    checks: Sender<Job>,
    running: Arc<Mutex<HashMap<String, RunningCommand>>>,
    watches: Arc<Mutex<HashMap<PathBuf, Child>>>,
    notifier: EvaluationNotifier,
    next: usize,
}

/// A running child process. Its result answers a request of the editor.
struct RunningCommand {
    id: RequestId,
    child: Child,
}

/// Counts finished evaluations, and notifies the editor of each.
#[derive(Clone)]
struct EvaluationNotifier {
    client: ClientCapabilities,
    sender: crossbeam_channel::Sender<Message>,
    count: Arc<AtomicUsize>,
}

impl EvaluationNotifier {
    /// Counts a finished evaluation, and asks the editor to request inlay hints and code lenses again.
    fn notify(&self) {
        let count = self.count.fetch_add(1, Ordering::Relaxed);
        let ClientCapabilities { refreshes_hints, refreshes_lenses, .. } = self.client;
        for (what, is_wanted) in [("inlayHint", refreshes_hints), ("codeLens", refreshes_lenses)] {
            if is_wanted {
                let id = format!("maquette-refresh-{count}-{what}").into();
                let method = format!("workspace/{what}/refresh");
                let _ = self.sender.send(Request { id, method, params: Json::Null }.into());
            }
        }
    }
}

impl Commands {
    pub(super) fn new(
        (program, words): (PathBuf, Vec<String>),
        client: ClientCapabilities,
        sender: crossbeam_channel::Sender<Message>,
        checks: Sender<Job>,
    ) -> Self {
        let (running, watches) = (Arc::default(), Arc::default());
        let news = EvaluationNotifier { client, sender: sender.clone(), count: Arc::default() };
        Self {
            program,
            arguments: words,
            client,
            sender,
            checks,
            running,
            watches,
            notifier: news,
            next: 0,
        }
    }

    /// Returns the number of evaluations that have ended since the server started.
    pub(super) fn evaluations(&self) -> usize {
        self.notifier.count.load(Ordering::Relaxed)
    }

    /// Returns true while a watch of the graph `path` is running.
    pub(super) fn watches(&self, path: &Path) -> bool {
        let mut watches = lock(&self.watches);
        // Remove watches that have ended by themselves.
        watches.retain(|_, child| matches!(child.try_wait(), Ok(None)));
        watches.contains_key(path)
    }

    /// Stops the process whose progress the editor shows under this token.
    pub(super) fn cancel(&self, token: &Json) {
        let running = token.as_str().and_then(|token| lock(&self.running).remove(token));
        if let Some(RunningCommand { id, child }) = running {
            let _ = self.sender.send(Response::new_ok(id, json!({ "text": "stopped" })).into());
            end(child);
        }
    }

    /// Stops the process whose result would be the answer to the request `id`. Answers instead that the request was cancelled.
    pub(super) fn cancel_request(&self, id: &RequestId) {
        let mut running = lock(&self.running);
        let token = running.iter().find(|(_, it)| it.id == *id).map(|(token, _)| token.clone());
        token
            .and_then(|token| running.remove(&token))
            .into_iter()
            .for_each(|it| self.answer_cancelled(it));
    }

    fn answer_cancelled(&self, RunningCommand { id, child }: RunningCommand) {
        let code = ErrorCode::RequestCanceled as i32;
        let _ = self.sender.send(Response::new_err(id, code, "cancelled".into()).into());
        end(child);
    }

    /// Stops all child processes.
    pub(super) fn end(&self) {
        lock(&self.running).drain().for_each(|(_, running)| self.answer_cancelled(running));
        lock(&self.watches).drain().for_each(|(_, child)| end(child));
    }
}

impl Drop for Commands {
    fn drop(&mut self) {
        self.end();
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(|broken| broken.into_inner())
}

fn end(mut child: Child) {
    let _ = child.kill();
    let _ = child.wait();
}

impl Server {
    /// Runs a command. The request `id` is answered when the command has ended.
    pub(super) fn execute(&mut self, id: RequestId, params: &Json) {
        let answer = match self.command(&id, params) {
            Ok(None) => return,
            Ok(Some(answer)) => Response::new_ok(id, answer),
            Err(why) => Response::new_err(id, ErrorCode::RequestFailed as i32, why),
        };
        let _ = self.sender.send(answer.into());
    }

    /// Runs a command. Returns its answer, or `None` if the answer comes later, from the process that the command started.
    fn command(&mut self, id: &RequestId, params: &Json) -> Result<Option<Json>, String> {
        let command = params["command"].as_str().unwrap_or_default();
        if command == APPLY {
            self.ask("workspace/applyEdit", json!({ "edit": params["arguments"][0] }));
            return Ok(Some(Json::Null));
        }
        fn argument(index: usize, params: &Json) -> Option<&str> {
            params["arguments"][index].as_str()
        }
        let path = argument(0, params)
            .and_then(|uri| path_of(&uri.into()))
            .map(|path| resolve_path(&path));
        let path = path.ok_or_else(|| {
            format!("`{command}` expects the URI of a graph as its first argument")
        })?;
        let text = self.text(&path);
        fn is_saved(path: &Path, text: &Arc<str>) -> bool {
            read_text(path).is_ok_and(|saved| *saved == **text)
        }
        if command != "maquette.stop" && !is_saved(&path, &text) {
            return Err("save the graph first: the file on disk is run".into());
        }
        let roots = self.choices.roots.iter().map(|root| root.display().to_string());
        let roots: Vec<_> = roots.flat_map(|root| ["--root".to_owned(), root]).collect();
        let first: &[&str] = match command {
            "maquette.run" => match first_word(&text) {
                "Sweep" => &["batch"],
                "Test" => &["test"],
                _ => &["run", "--json"],
            },
            "maquette.inspect" => &["inspect"],
            "maquette.why" => &["why"],
            "maquette.watch" => {
                let link = self.commands.watch(&path, &roots)?;
                self.show(&link, true);
                self.commands.notifier.notify();
                return Ok(Some(json!({ "url": link })));
            }
            "maquette.stop" => {
                let watch = lock(&self.commands.watches).remove(&path);
                let text = watch.as_ref().map_or("there was no watch", |_| "the watch has ended");
                watch.into_iter().for_each(end);
                self.commands.notifier.notify();
                return Ok(Some(json!({ "text": text })));
            }
            _ => return Err(format!("there is no command `{command}`")),
        };
        let name = path.display().to_string();
        let words = first.iter().copied().chain([&name[..]]).chain(argument(1, params));
        let words: Vec<_> = words.map(str::to_owned).chain(roots).collect();
        let job = CommandProcess { words, path, text, shows: self.choices.shows };
        self.commands.start(id.clone(), first[0], job)?;
        Ok(None)
    }
}

/// The arguments and the graph of a process that is to be started for the editor.
struct CommandProcess {
    words: Vec<String>,
    /// The path of the graph and its text at the start of the process.
    path: PathBuf,
    text: Arc<str>,
    /// True if the editor itself shows the result, not the server.
    shows: bool,
}

impl Commands {
    /// Returns the command that starts the program in the project folder of a graph. Outputs are written to `out` in that folder.
    fn program_in(&self, graph: &Path) -> Command {
        let mut program = Command::new(&self.program);
        program.current_dir(project_root(graph.parent().unwrap_or(Path::new("/"))));
        program.stdin(Stdio::null()).stdout(Stdio::piped());
        // Tell the child process the id of this server, so that it ends when the server ends.
        program.env(PARENT, std::process::id().to_string());
        program
    }

    /// Starts a child process. Its result answers the request `id` when the process has ended.
    fn start(&mut self, id: RequestId, verb: &str, work: CommandProcess) -> Result<(), String> {
        let CommandProcess { words, path, text, shows } = work;
        self.next += 1;
        let token = format!("maquette-run-{}", self.next);
        let mut program = self.program_in(&path);
        program.args(&words).args(&self.arguments).stderr(Stdio::piped());
        let mut child = program.spawn().map_err(|error| self.spawn_error(&error))?;
        let (out, err) = (child.stdout.take(), child.stderr.take());
        lock(&self.running).insert(token.clone(), RunningCommand { id: id.clone(), child });
        let (client, sender, checks) = (self.client, self.sender.clone(), self.checks.clone());
        let (running, news, is_run) = (self.running.clone(), self.notifier.clone(), verb == "run");
        let title = format!("{verb} {}", path.file_name().unwrap_or_default().display());
        std::thread::spawn(move || {
            fn notify(method: &str, params: Json, sender: &crossbeam_channel::Sender<Message>) {
                let _ = sender.send(Notification { method: method.to_owned(), params }.into());
            }
            if client.progress {
                let params = json!({ "token": token });
                let method = "window/workDoneProgress/create".to_owned();
                let _ = sender.send(Request { id: token.clone().into(), method, params }.into());
                let value = json!({ "kind": "begin", "title": title, "cancellable": true });
                notify("$/progress", json!({ "token": token, "value": value }), &sender);
            }
            let error = std::thread::spawn(move || read_stream(err));
            let (out, error) = (read_stream(out), error.join().unwrap_or_default());
            // If the process is missing from the list of running processes, it was cancelled and its request is already answered.
            let running = lock(&running).remove(&token);
            let is_cancelled = running.is_none();
            running.into_iter().for_each(|mut it| drop(it.child.wait()));
            let words = match (is_run, serde_json::from_str::<Json>(&out)) {
                (true, Ok(document)) => {
                    let diagnostics = diagnostics(&document, &path, &text, client);
                    let _ = checks.send(Job::Found { path, text, diagnostics });
                    summarize_run(&document)
                }
                _ => format!("{out}{error}"),
            };
            if client.progress {
                notify(
                    "$/progress",
                    json!({ "token": token, "value": { "kind": "end" } }),
                    &sender,
                );
            }
            news.notify();
            let words = if is_cancelled { "stopped".to_owned() } else { words };
            let first = words.lines().find(|line| !line.trim().is_empty()).unwrap_or_default();
            if !shows {
                notify("window/logMessage", json!({ "type": 3, "message": words }), &sender);
                notify("window/showMessage", json!({ "type": 3, "message": first }), &sender);
            }
            if !is_cancelled {
                let _ = sender.send(Response::new_ok(id, json!({ "text": words })).into());
            }
        });
        Ok(())
    }

    fn spawn_error(&self, error: &std::io::Error) -> String {
        format!("cannot run {}: {error}", self.program.display())
    }

    /// Starts a watch of a graph, which serves the live page, and returns the URL of that page.
    fn watch(&self, path: &Path, roots: &[String]) -> Result<String, String> {
        if let Some(old) = lock(&self.watches).remove(path) {
            end(old);
        }
        let mut program = self.program_in(path);
        program
            .arg("watch")
            .arg(path)
            .args(["--preview", "--events", "--in-editor"])
            .args(roots)
            .args(&self.arguments);
        let mut child =
            program.stderr(Stdio::null()).spawn().map_err(|error| self.spawn_error(&error))?;
        let Some(out) = child.stdout.take() else { return Err("the watch has no output".into()) };
        let mut out = BufReader::new(out);
        let mut line = String::new();
        let link = loop {
            line.clear();
            match out.read_line(&mut line) {
                Ok(0) | Err(_) => break None,
                Ok(_) => {}
            }
            let event: Json = serde_json::from_str(&line).unwrap_or_default();
            if let Some(link) = event["link"].as_str() {
                break Some(link.to_owned());
            }
        };
        let Some(link) = link else {
            end(child);
            return Err(format!("{} cannot be watched: run it to see why", path.display()));
        };
        // Keep reading the output of the process: a watch ends when its output is closed.
        let news = self.notifier.clone();
        std::thread::spawn(move || {
            for line in out.lines().map_while(Result::ok) {
                if serde_json::from_str::<Json>(&line).is_ok_and(|event| event["event"] == "done") {
                    news.notify();
                }
            }
        });
        lock(&self.watches).insert(path.to_owned(), child);
        Ok(link)
    }
}

fn read_stream(stream: Option<impl Read>) -> String {
    let mut bytes = Vec::new();
    stream.into_iter().for_each(|mut stream| drop(stream.read_to_end(&mut bytes)));
    String::from_utf8_lossy(&bytes).into_owned()
}

/// Returns the diagnostics of a run that a check without evaluation cannot find: errors and warnings of nodes, and failed expectations.
fn diagnostics(
    document: &Json,
    graph: &Path,
    text: &str,
    client: ClientCapabilities,
) -> FileDiagnostics {
    const OF_RUNS: [&str; 5] = ["G016", "G017", "G018", "G019", "G020"];
    let problems = document["problems"].as_array().into_iter().flatten();
    let mut found = Vec::new();
    for problem in
        problems.filter(|it| it["code"].as_str().is_some_and(|code| OF_RUNS.contains(&code)))
    {
        let file = resolve_path(Path::new(problem["file"].as_str().unwrap_or_default()));
        let other = if file == graph { None } else { read_text(&file).ok() };
        let text = other.as_deref().unwrap_or(text);
        let lines = Lines::new(text, client.columns);
        fn number(name: &str, problem: &Json) -> usize {
            problem[name].as_u64().unwrap_or(1).max(1) as usize - 1
        }
        fn byte(line: usize, column: usize, text: &str) -> usize {
            let start = text.split_inclusive('\n').take(line).map(str::len).sum::<usize>();
            let line = text[start..].lines().next().unwrap_or_default();
            start + line.char_indices().nth(column).map_or(line.len(), |(at, _)| at)
        }
        let start = byte(number("line", problem), number("column", problem), text);
        let end = byte(number("end_line", problem), number("end_column", problem), text).max(start);
        found.push((
            file,
            json!({
                "range": lines.range(Span { start, end }),
                "severity": if problem["severity"] == "error" { 1 } else { 2 },
                "code": problem["code"],
                "source": "maquette run",
                "message": problem["message"],
            }),
        ));
    }
    found
}

/// Summarizes a run in a message: the number of diagnostics, the written files, and the time.
fn summarize_run(document: &Json) -> String {
    fn list(name: &str, document: &Json) -> Vec<Json> {
        document[name].as_array().cloned().unwrap_or_default()
    }
    let mut words = String::new();
    for problem in list("problems", document) {
        fn text(name: &str, problem: &Json) -> String {
            problem[name].as_str().unwrap_or_default().to_owned()
        }
        words += &format!(
            "{}: {}:{}:{}: {}\n",
            text("severity", &problem),
            text("file", &problem),
            problem["line"],
            problem["column"],
            text("message", &problem)
        );
    }
    for output in list("outputs", document) {
        let state = if output["changed"] == false { "unchanged" } else { "written" };
        words += &format!(
            "{}: {state}\n",
            output["path"].as_str().or(output["name"].as_str()).unwrap_or_default()
        );
    }
    let nodes = list("nodes", document);
    let computed = nodes.iter().filter(|node| node["state"] == "computed").count();
    let seconds = document["seconds"].as_f64().unwrap_or(0.0);
    words + &format!("{computed} of {} nodes computed in {seconds:.2} s\n", nodes.len())
}
