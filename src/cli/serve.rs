//! `maquette serve --stdio`: runs graphs for another program (the host), with lines of JSON on stdin and stdout. `docs/serve.md` describes
//! all messages.
//!
//! One thread reads requests and answers those that take little time. Another thread evaluates graphs. Large columns of numbers are
//! exchanged as files in a shared folder.

use std::collections::VecDeque;
use std::io::{self, BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Sender, channel};
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

use clap::Args;
use maquette_diagram::RowPositions;
use maquette_edit::EditedText;
use maquette_engine::writing::ExchangeFolder;
use maquette_graph::catalog::{Catalog, Entry};
use maquette_graph::{Graph, Options, PINS_ENDING};
use maquette_node::CancelToken;
use maquette_value::ValueType;
use maquette_value::fs;
use serde_json::{Value as Json, json};

use self::columns::Columns;
pub(super) use self::layout::ENDING as LAYOUT_ENDING;
use self::layout::Layout;
use self::request::{EditRequest, Line, Load, Outline, Request};
use self::runner::{Job, RequestError, RunTokens, Runner, load_options};
use super::cache_options::CacheOptions;
use super::edit::graph_file::{EditError, GraphFile};
use super::events::Listener;
use super::{Exit, put_problems, stdout_is_closed};

mod columns;
mod layout;
mod materials;
mod request;
mod runner;

/// The version of the protocol. It stays the same if messages or fields are only added.
const PROTOCOL: u32 = 1;

/// The maximum length of a line in bytes, much longer than any graph.
const MAX_LINE: u64 = 64 << 20;

/// The time that a cancelled run gets to stop before the program ends.
const STOP_TIMEOUT: Duration = Duration::from_secs(2);

#[derive(Args)]
pub(crate) struct Serve {
    /// Read requests from stdin and answer on stdout, one JSON object per line, until stdin ends.
    #[arg(long, required = true)]
    stdio: bool,
    /// The parent folder of the folder for columns of numbers [default: in memory, if the system has such files].
    #[arg(long = "folder", value_name = "DIR")]
    folder: Option<PathBuf>,
    /// The number of threads; 0 for all.
    #[arg(long, value_name = "N", default_value_t = 0)]
    threads: usize,
    #[command(flatten)]
    cache: CacheOptions,
}

impl Serve {
    pub(super) fn run(&self, catalog: &Arc<Catalog>) -> Exit {
        let session = match self.cache.session(self.threads, catalog) {
            Ok(session) => session,
            Err(why) => return Exit::Usage(why),
        };
        let folder = match ExchangeFolder::new(self.folder.as_deref()) {
            Ok(folder) => folder,
            Err(error) => {
                return Exit::Usage(format!("cannot create the folder for columns: {error}"));
            }
        };
        let columns = Columns::new(folder);
        let listener = Listener::of_stdout();
        listener.send(
            "ready",
            json!({
                "protocol": PROTOCOL,
                "version": env!("CARGO_PKG_VERSION"),
                "folder": columns.folder().display().to_string(),
            }),
        );
        let (sender, jobs) = channel();
        let (over, ended) = channel::<()>();
        let runs = RunTokens::default();
        let runner = Runner {
            session,
            catalog: catalog.clone(),
            columns,
            listener: listener.clone(),
            runs: runs.clone(),
            values: VecDeque::new(),
        };
        std::thread::spawn(move || {
            runner.work(&jobs);
            drop(over);
        });
        let server = Server { catalog, listener, runs, jobs: sender };
        server.listen();
        lock(&server.runs).values().for_each(CancelToken::cancel);
        drop(server.jobs);
        // Wait for the thread: it closes its end of the channel when it ends.
        let _ = ended.recv_timeout(STOP_TIMEOUT);
        Exit::Done
    }
}

struct Server<'a> {
    catalog: &'a Arc<Catalog>,
    listener: Listener,
    runs: RunTokens,
    jobs: Sender<(Json, Job)>,
}

impl Server<'_> {
    /// Handles all requests until the host closes stdin.
    fn listen(&self) {
        let mut input = BufReader::new(io::stdin());
        let mut line = Vec::new();
        while !stdout_is_closed() {
            line.clear();
            match input.by_ref().take(MAX_LINE).read_until(b'\n', &mut line) {
                Ok(0) | Err(_) => return,
                Ok(_) if line.trim_ascii().is_empty() => {}
                Ok(count) if count as u64 == MAX_LINE && !line.ends_with(b"\n") => {
                    let why = format!("expected a line of at most {MAX_LINE} bytes");
                    self.listener.answer(&Json::Null, Err(why.into()));
                    // The line is too long, so skip the rest of it.
                    if input.skip_until(b'\n').is_err() {
                        return;
                    }
                }
                Ok(_) => self.handle(Line::read(&line)),
            }
        }
    }

    fn handle(&self, Line { id, request }: Line) {
        let answer = match request {
            Ok(Request::Catalog {}) => {
                let nodes: Vec<_> = self.catalog.entries().map(Entry::to_json).collect();
                Ok(json!({ "nodes": nodes }))
            }
            Ok(Request::Load(load)) => Ok(self.load(&load)),
            Ok(Request::Outline(outline)) => self.outline(outline),
            Ok(Request::Layout { graph, layout }) => {
                layout.write(&graph).map(|()| json!({})).map_err(RequestError::from)
            }
            Ok(Request::Edit(request)) => self.edit(&request),
            Ok(Request::Put { graph, was, text, theirs }) => self.put(&graph, was, text, theirs),
            Ok(Request::Cancel { run }) => match lock(&self.runs).get(&run.to_string()) {
                Some(token) => {
                    token.cancel();
                    Ok(json!({ "found": true }))
                }
                // The run is unknown. It may have ended before this request arrived.
                None => Ok(json!({ "found": false })),
            },
            Ok(Request::Run(run)) => {
                let token = CancelToken::default();
                lock(&self.runs).insert(id.to_string(), token.clone());
                return self.enqueue(id, Job::Run(run, token));
            }
            Ok(Request::Input(input)) => return self.enqueue(id, Job::Input(input)),
            Ok(Request::Why { graph, roots, set, draft, pins, locked, node }) => {
                let load = Load { graph, roots, set, draft, pins, locked };
                return self.enqueue(id, Job::Why(load, node));
            }
            Err(why) => Err(why.into()),
        };
        self.listener.answer(&id, answer);
    }

    fn enqueue(&self, id: Json, job: Job) {
        // Sending cannot fail, because the thread runs until the sender is dropped.
        let _ = self.jobs.send((id, job));
    }

    fn load(&self, load: &Load) -> Json {
        let checked =
            Graph::load(&load.graph, self.catalog, &load_options(load)).without_unknown_nodes();
        let pins = load.graph.with_extension(PINS_ENDING);
        let files = checked.files.iter().map(|file| &file.path).chain([&pins]);
        let files = files.map(|path| path.display().to_string());
        let files = Vec::from_iter(files);
        let graphs = checked.subgraphs.iter().map(|path| path.display().to_string());
        let mut answer = json!({
            "ok": checked.graph.is_some(),
            "files": files,
            "graphs": Vec::from_iter(graphs),
        });
        put_problems(&mut answer, &checked.diagnostics);
        if let Some(graph) = checked.graph {
            answer["doc"] = graph.doc().into();
            answer["text"] = graph.source_text().into();
            answer["schema"] = graph.schema().clone();
            answer["inputs"] = graph
                .inputs()
                .iter()
                .map(|input| {
                    let kind = input.kind.name;
                    json!({ "name": input.name, "type": kind, "doc": input.doc })
                })
                .collect();
            answer["outputs"] = graph.results().map(|(name, kind): (&str, Option<&ValueType>)| json!({ "name": name, "type": kind.map(|kind| kind.name) })).collect();
            answer["nodes"] = graph.node_names().collect();
        }
        answer
    }

    fn outline(&self, Outline { graph, roots, text }: Outline) -> Result<Json, RequestError> {
        let text = match text {
            Some(text) => text,
            None => fs::read_text(&graph)
                .map_err(|error| EditError::Read(graph.clone(), error).to_string())?,
        };
        let options = Options { roots, ..Options::default() };
        let (checked, outline) =
            maquette_diagram::outline(&graph, text.clone(), self.catalog, &options);
        let checked = checked.without_unknown_nodes();
        let mut answer = json!({ "ok": checked.graph.is_some(), "text": text, "outline": outline });
        match Layout::read(&graph) {
            Ok(layout) => answer["layout"] = json!(layout),
            Err(why) => answer["layout_why"] = why.into(),
        }
        if let Some(outline) = &outline {
            answer["outline"]["places"] = json!(RowPositions::from_outline(outline));
        }
        put_problems(&mut answer, &checked.diagnostics);
        Ok(answer)
    }

    fn edit(&self, request: &EditRequest) -> Result<Json, RequestError> {
        let EditRequest { graph, roots, edits, dry } = request;
        let file = GraphFile { graph, roots, draft: false, dry_run: *dry };
        edit_answer(file.apply(edits, self.catalog))
    }

    /// Replaces the text of a graph file by `text`. Without `theirs`, this fails unless the file contains the text `was`. `theirs` are
    /// changes by other programs; if it is given, they are merged into `text`.
    fn put(
        &self,
        graph: &Path,
        was: String,
        text: String,
        theirs: Option<Vec<[String; 2]>>,
    ) -> Result<Json, RequestError> {
        let file = GraphFile { graph, roots: &[], draft: false, dry_run: false };
        edit_answer(file.acquire_lock().and_then(|_turn| {
            let before = file.text()?;
            let text = match theirs {
                Some(mut theirs) => {
                    theirs.push([was, before.clone()]);
                    file.merge(text, theirs, self.catalog)?
                }
                None if before == was => text,
                None => return Err(EditError::Changed(graph.to_owned())),
            };
            let edited = EditedText { text, before, changes: Vec::new() };
            file.write(&edited).map(|()| edited)
        }))
    }
}

fn edit_answer(edited: Result<EditedText, EditError>) -> Result<Json, RequestError> {
    match edited {
        Ok(EditedText { text, before, .. }) => Ok(json!({ "text": text, "before": before })),
        Err(error) => {
            let why = error.to_string();
            let diagnostics = match error {
                EditError::Refused(diagnostics) => diagnostics,
                _ => Vec::new(),
            };
            Err(RequestError { message: why, diagnostics })
        }
    }
}

/// Sends answers to the host.
trait Answer {
    /// Sends the answer to the request with this id.
    fn answer(&self, id: &Json, answer: Result<Json, RequestError>);
}

impl Answer for Listener {
    fn answer(&self, id: &Json, answer: Result<Json, RequestError>) {
        let (event, mut fields) = match answer {
            Ok(fields) => ("answer", fields),
            Err(RequestError { message: why, diagnostics }) => {
                let mut fields = json!({ "why": why });
                put_problems(&mut fields, &diagnostics);
                ("refused", fields)
            }
        };
        fields["id"] = id.clone();
        self.send(event, fields);
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(|broken| broken.into_inner())
}
