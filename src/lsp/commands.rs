//! Commands that an editor has run: each by a process of its own, so that nothing that a graph does can harm the server.
//!
//! A command runs in the project's folder, from what is saved. The server evaluates nothing: shapes, times and sizes come from the note on
//! disk that every evaluation leaves (`last`), and a forecast says which of them are still valid.

use std::collections::HashMap;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::Sender;
use std::sync::{Arc, Mutex, MutexGuard};

use lsp_server::{ErrorCode, Message, Notification, Request, RequestId, Response};
use maquette_edit::real;
use maquette_syntax::error::Span;
use maquette_syntax::first_word;
use maquette_syntax::paths::project_root;
use maquette_value::plain::read_text;
use serde_json::{Value as Json, json};

use super::checker::{Job, OfFiles};
use super::place::{Lines, path_of};
use super::{Client, Server};

/// The commands, as editors name them.
pub(super) const COMMANDS: [&str; 6] =
    ["maquette.run", "maquette.watch", "maquette.stop", "maquette.inspect", "maquette.why", APPLY];

/// Has the editor make the edit in its argument, for editors that know no other actions than commands.
pub(super) const APPLY: &str = "maquette.apply";

/// Names the variable by which a process is told the id of its parent, with which it ends.
pub const PARENT: &str = "MAQUETTE_PARENT";

/// What runs for an editor.
pub(super) struct Commands {
    program: PathBuf,
    /// What each command is told beside its own words.
    words: Vec<String>,
    client: Client,
    sender: crossbeam_channel::Sender<Message>,
    checks: Sender<Job>,
    running: Arc<Mutex<HashMap<String, Running>>>,
    watches: Arc<Mutex<HashMap<PathBuf, Child>>>,
    news: News,
    next: usize,
}

/// A process that answers a request when it ends.
struct Running {
    id: RequestId,
    child: Child,
}

/// Tells that something has been evaluated.
#[derive(Clone)]
struct News {
    client: Client,
    sender: crossbeam_channel::Sender<Message>,
    count: Arc<AtomicUsize>,
}

impl News {
    /// Has the editor ask for hints and lenses again.
    fn tell(&self) {
        let count = self.count.fetch_add(1, Ordering::Relaxed);
        let Client { refreshes_hints, refreshes_lenses, .. } = self.client;
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
        client: Client,
        sender: crossbeam_channel::Sender<Message>,
        checks: Sender<Job>,
    ) -> Self {
        let (running, watches) = (Arc::default(), Arc::default());
        let news = News { client, sender: sender.clone(), count: Arc::default() };
        Self { program, words, client, sender, checks, running, watches, news, next: 0 }
    }

    /// How often something has been evaluated.
    pub(super) fn evaluations(&self) -> usize {
        self.news.count.load(Ordering::Relaxed)
    }

    /// Whether a graph is being watched.
    pub(super) fn watches(&self, path: &Path) -> bool {
        let mut watches = lock(&self.watches);
        // One that has ended by itself is none any more.
        watches.retain(|_, child| matches!(child.try_wait(), Ok(None)));
        watches.contains_key(path)
    }

    /// Stops what was begun under this token.
    pub(super) fn cancel(&self, token: &Json) {
        let running = token.as_str().and_then(|token| lock(&self.running).remove(token));
        if let Some(Running { id, child }) = running {
            let _ = self.sender.send(Response::new_ok(id, json!({ "text": "stopped" })).into());
            end(child);
        }
    }

    /// Stops what answers a request, which is refused then.
    pub(super) fn cancel_request(&self, id: &RequestId) {
        let mut running = lock(&self.running);
        let token = running.iter().find(|(_, it)| it.id == *id).map(|(token, _)| token.clone());
        token.and_then(|token| running.remove(&token)).into_iter().for_each(|it| self.refuse(it));
    }

    fn refuse(&self, Running { id, child }: Running) {
        let code = ErrorCode::RequestCanceled as i32;
        let _ = self.sender.send(Response::new_err(id, code, "cancelled".into()).into());
        end(child);
    }

    /// Stops everything.
    pub(super) fn end(&self) {
        lock(&self.running).drain().for_each(|(_, running)| self.refuse(running));
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
    /// Runs a command; its answer comes when it has ended.
    pub(super) fn execute(&mut self, id: RequestId, params: &Json) {
        let answer = match self.command(&id, params) {
            Ok(None) => return,
            Ok(Some(told)) => Response::new_ok(id, told),
            Err(why) => Response::new_err(id, ErrorCode::RequestFailed as i32, why),
        };
        let _ = self.sender.send(answer.into());
    }

    /// The answer to a command; none yet if a process has been started that gives it.
    fn command(&mut self, id: &RequestId, params: &Json) -> Result<Option<Json>, String> {
        let command = params["command"].as_str().unwrap_or_default();
        if command == APPLY {
            self.ask("workspace/applyEdit", json!({ "edit": params["arguments"][0] }));
            return Ok(Some(Json::Null));
        }
        fn argument(index: usize, params: &Json) -> Option<&str> {
            params["arguments"][index].as_str()
        }
        let path = argument(0, params).and_then(|uri| path_of(&uri.into())).map(|path| real(&path));
        let path = path.ok_or_else(|| format!("`{command}` wants the URI of a graph first"))?;
        let text = self.text(&path);
        fn is_saved(path: &Path, text: &Arc<str>) -> bool {
            read_text(path).is_ok_and(|saved| *saved == **text)
        }
        if command != "maquette.stop" && !is_saved(&path, &text) {
            return Err("save the graph first: what is on disk is run".into());
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
                self.commands.news.tell();
                return Ok(Some(json!({ "url": link })));
            }
            "maquette.stop" => {
                let watch = lock(&self.commands.watches).remove(&path);
                let told = watch.as_ref().map_or("there was no watch", |_| "the watch has ended");
                watch.into_iter().for_each(end);
                self.commands.news.tell();
                return Ok(Some(json!({ "text": told })));
            }
            _ => return Err(format!("there is no command `{command}`")),
        };
        let name = path.display().to_string();
        let words = first.iter().copied().chain([&name[..]]).chain(argument(1, params));
        let words: Vec<_> = words.map(str::to_owned).chain(roots).collect();
        let job = Work { words, path, text, shows: self.choices.shows };
        self.commands.start(id.clone(), first[0], job)?;
        Ok(None)
    }
}

/// What a process does for an editor.
struct Work {
    words: Vec<String>,
    /// The graph, and its text.
    path: PathBuf,
    text: Arc<str>,
    /// Whether the editor shows the answer by itself.
    shows: bool,
}

impl Commands {
    /// The program, in the folder of a graph's project: an editor may have been started anywhere, and outputs go to `out` there.
    fn program_in(&self, graph: &Path) -> Command {
        let mut program = Command::new(&self.program);
        program.current_dir(project_root(graph.parent().unwrap_or(Path::new("/"))));
        program.stdin(Stdio::null()).stdout(Stdio::piped());
        // It ends with this process, however that ends.
        program.env(PARENT, std::process::id().to_string());
        program
    }

    /// Starts a process, which answers when it has ended.
    fn start(&mut self, id: RequestId, verb: &str, work: Work) -> Result<(), String> {
        let Work { words, path, text, shows } = work;
        self.next += 1;
        let token = format!("maquette-run-{}", self.next);
        let mut program = self.program_in(&path);
        program.args(&words).args(&self.words).stderr(Stdio::piped());
        let mut child = program.spawn().map_err(|error| self.not_run(&error))?;
        let (out, err) = (child.stdout.take(), child.stderr.take());
        lock(&self.running).insert(token.clone(), Running { id: id.clone(), child });
        let (client, sender, checks) = (self.client, self.sender.clone(), self.checks.clone());
        let (running, news, is_run) = (self.running.clone(), self.news.clone(), verb == "run");
        let title = format!("{verb} {}", path.file_name().unwrap_or_default().display());
        std::thread::spawn(move || {
            fn tell(method: &str, params: Json, sender: &crossbeam_channel::Sender<Message>) {
                let _ = sender.send(Notification { method: method.to_owned(), params }.into());
            }
            if client.progress {
                let params = json!({ "token": token });
                let method = "window/workDoneProgress/create".to_owned();
                let _ = sender.send(Request { id: token.clone().into(), method, params }.into());
                let value = json!({ "kind": "begin", "title": title, "cancellable": true });
                tell("$/progress", json!({ "token": token, "value": value }), &sender);
            }
            let error = std::thread::spawn(move || all(err));
            let (out, error) = (all(out), error.join().unwrap_or_default());
            // Who has taken it away has answered.
            let running = lock(&running).remove(&token);
            let is_cancelled = running.is_none();
            running.into_iter().for_each(|mut it| drop(it.child.wait()));
            let words = match (is_run, serde_json::from_str::<Json>(&out)) {
                (true, Ok(document)) => {
                    let diagnostics = diagnostics(&document, &path, &text, client);
                    let _ = checks.send(Job::Found { path, text, diagnostics });
                    in_words(&document)
                }
                _ => format!("{out}{error}"),
            };
            if client.progress {
                tell("$/progress", json!({ "token": token, "value": { "kind": "end" } }), &sender);
            }
            news.tell();
            let words = if is_cancelled { "stopped".to_owned() } else { words };
            let first = words.lines().find(|line| !line.trim().is_empty()).unwrap_or_default();
            if !shows {
                tell("window/logMessage", json!({ "type": 3, "message": words }), &sender);
                tell("window/showMessage", json!({ "type": 3, "message": first }), &sender);
            }
            if !is_cancelled {
                let _ = sender.send(Response::new_ok(id, json!({ "text": words })).into());
            }
        });
        Ok(())
    }

    fn not_run(&self, error: &std::io::Error) -> String {
        format!("cannot run {}: {error}", self.program.display())
    }

    /// Starts a watch with the live page, and gives its link.
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
            .args(&self.words);
        let mut child =
            program.stderr(Stdio::null()).spawn().map_err(|error| self.not_run(&error))?;
        let Some(out) = child.stdout.take() else { return Err("the watch says nothing".into()) };
        let mut out = BufReader::new(out);
        let mut line = String::new();
        let link = loop {
            line.clear();
            match out.read_line(&mut line) {
                Ok(0) | Err(_) => break None,
                Ok(_) => {}
            }
            let told: Json = serde_json::from_str(&line).unwrap_or_default();
            if let Some(link) = told["link"].as_str() {
                break Some(link.to_owned());
            }
        };
        let Some(link) = link else {
            end(child);
            return Err(format!("{} cannot be watched: run it to see why", path.display()));
        };
        // It ends when nobody reads what it prints.
        let news = self.news.clone();
        std::thread::spawn(move || {
            for line in out.lines().map_while(Result::ok) {
                if serde_json::from_str::<Json>(&line).is_ok_and(|told| told["event"] == "done") {
                    news.tell();
                }
            }
        });
        lock(&self.watches).insert(path.to_owned(), child);
        Ok(link)
    }
}

fn all(stream: Option<impl Read>) -> String {
    let mut bytes = Vec::new();
    stream.into_iter().for_each(|mut stream| drop(stream.read_to_end(&mut bytes)));
    String::from_utf8_lossy(&bytes).into_owned()
}

/// What a run found that the check cannot know: failures and warnings of nodes, expectations that do not hold.
fn diagnostics(document: &Json, graph: &Path, text: &str, client: Client) -> OfFiles {
    const OF_RUNS: [&str; 5] = ["G016", "G017", "G018", "G019", "G020"];
    let problems = document["problems"].as_array().into_iter().flatten();
    let mut found = Vec::new();
    for problem in
        problems.filter(|it| it["code"].as_str().is_some_and(|code| OF_RUNS.contains(&code)))
    {
        let file = real(Path::new(problem["file"].as_str().unwrap_or_default()));
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

/// What a run came to: problems, files, time.
fn in_words(document: &Json) -> String {
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
