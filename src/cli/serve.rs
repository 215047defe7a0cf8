//! `maquette serve --stdio`: graphs for another program, by lines of JSON on stdin and stdout. `docs/serve.md` has every message.
//!
//! One thread listens and answers what is quick; another one evaluates. Large columns of numbers go through files of a folder that both
//! processes see.

use std::collections::VecDeque;
use std::io::{self, BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Sender, channel};
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

use clap::Args;
use maquette_diagram::Places;
use maquette_edit::Edited;
use maquette_engine::writing::Shelf;
use maquette_graph::catalog::{Catalog, Entry};
use maquette_graph::{Graph, Options, PINS_ENDING};
use maquette_node::CancelToken;
use maquette_value::ValueType;
use maquette_value::plain;
use serde_json::{Value as Json, json};

use self::columns::Columns;
pub(super) use self::layout::ENDING as LAYOUT_ENDING;
use self::layout::Layout;
use self::request::{EditWish, Line, Load, Outline, Wish};
use self::runner::{Job, Refused, Runner, Runs, options};
use super::caching::CacheOptions;
use super::edit::{EditError, GraphFile};
use super::events::Listener;
use super::{Exit, put_problems, stdout_is_closed};

mod columns;
mod layout;
mod materials;
mod request;
mod runner;

/// The version of the protocol. New messages and fields do not change it.
const PROTOCOL: u32 = 1;

/// A line may have so many bytes: far more than any graph.
const LONGEST: u64 = 64 << 20;

/// A run that was stopped has this long to end before the program ends without it.
const PATIENCE: Duration = Duration::from_secs(2);

#[derive(Args)]
pub(crate) struct Serve {
    /// Hear requests on stdin and answer on stdout, one JSON object a line, until stdin ends.
    #[arg(long, required = true)]
    stdio: bool,
    /// Put the folder for columns of numbers into this one; else it is in memory, where the system has such files.
    #[arg(long = "folder", value_name = "DIR")]
    shelf: Option<PathBuf>,
    /// How many threads; 0 for as many as the machine has.
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
        let shelf = match Shelf::new(self.shelf.as_deref()) {
            Ok(shelf) => shelf,
            Err(error) => {
                return Exit::Usage(format!("there can be no folder for columns: {error}"));
            }
        };
        let columns = Columns::new(shelf);
        let listener = Listener::of_stdout();
        listener.tell(
            "ready",
            json!({
                "protocol": PROTOCOL,
                "version": env!("CARGO_PKG_VERSION"),
                "folder": columns.folder().display().to_string(),
            }),
        );
        let (sender, jobs) = channel();
        let (over, ended) = channel::<()>();
        let runs = Runs::default();
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
        // Ended, it has dropped its end.
        let _ = ended.recv_timeout(PATIENCE);
        Exit::Done
    }
}

struct Server<'a> {
    catalog: &'a Arc<Catalog>,
    listener: Listener,
    runs: Runs,
    jobs: Sender<(Json, Job)>,
}

impl Server<'_> {
    /// Hears all requests, until the host is gone.
    fn listen(&self) {
        let mut input = BufReader::new(io::stdin());
        let mut line = Vec::new();
        while !stdout_is_closed() {
            line.clear();
            match input.by_ref().take(LONGEST).read_until(b'\n', &mut line) {
                Ok(0) | Err(_) => return,
                Ok(_) if line.trim_ascii().is_empty() => {}
                Ok(count) if count as u64 == LONGEST && !line.ends_with(b"\n") => {
                    let why = format!("a line has at most {LONGEST} bytes");
                    self.listener.answer(&Json::Null, Err(why.into()));
                    // What follows on this line is no request.
                    if input.skip_until(b'\n').is_err() {
                        return;
                    }
                }
                Ok(_) => self.hear(Line::read(&line)),
            }
        }
    }

    fn hear(&self, Line { id, wish }: Line) {
        let answer = match wish {
            Ok(Wish::Catalog {}) => {
                let nodes: Vec<_> = self.catalog.entries().map(Entry::to_json).collect();
                Ok(json!({ "nodes": nodes }))
            }
            Ok(Wish::Load(load)) => Ok(self.load(&load)),
            Ok(Wish::Outline(outline)) => self.outline(outline),
            Ok(Wish::Layout { graph, layout }) => {
                layout.keep(&graph).map(|()| json!({})).map_err(Refused::from)
            }
            Ok(Wish::Edit(wish)) => self.edit(&wish),
            Ok(Wish::Put { graph, was, text, theirs }) => self.put(&graph, was, text, theirs),
            Ok(Wish::Cancel { run }) => match lock(&self.runs).get(&run.to_string()) {
                Some(token) => {
                    token.cancel();
                    Ok(json!({ "found": true }))
                }
                // It may have ended meanwhile.
                None => Ok(json!({ "found": false })),
            },
            Ok(Wish::Run(run)) => {
                let token = CancelToken::default();
                lock(&self.runs).insert(id.to_string(), token.clone());
                return self.pass(id, Job::Run(run, token));
            }
            Ok(Wish::Input(input)) => return self.pass(id, Job::Input(input)),
            Ok(Wish::Why { graph, roots, set, draft, pins, locked, node }) => {
                let load = Load { graph, roots, set, draft, pins, locked };
                return self.pass(id, Job::Why(load, node));
            }
            Err(why) => Err(why.into()),
        };
        self.listener.answer(&id, answer);
    }

    fn pass(&self, id: Json, job: Job) {
        // The thread lives as long as this.
        let _ = self.jobs.send((id, job));
    }

    fn load(&self, load: &Load) -> Json {
        let checked = Graph::load(&load.graph, self.catalog, &options(load)).as_far_as_known();
        let pins = load.graph.with_extension(PINS_ENDING);
        let files = checked.files.iter().map(|file| &file.path).chain([&pins]);
        let files = files.map(|path| path.display().to_string());
        let files = Vec::from_iter(files);
        let graphs = checked.subgraphs.iter().map(|path| path.display().to_string());
        let mut told = json!({
            "ok": checked.graph.is_some(),
            "files": files,
            "graphs": Vec::from_iter(graphs),
        });
        put_problems(&mut told, &checked.problems);
        if let Some(graph) = checked.graph {
            told["doc"] = graph.doc().into();
            told["text"] = graph.source_text().into();
            told["schema"] = graph.schema().clone();
            told["inputs"] = graph
                .inputs()
                .iter()
                .map(|input| {
                    let kind = input.kind.name;
                    json!({ "name": input.name, "type": kind, "doc": input.doc })
                })
                .collect();
            told["outputs"] = graph.results().map(|(name, kind): (&str, Option<&ValueType>)| json!({ "name": name, "type": kind.map(|kind| kind.name) })).collect();
            told["nodes"] = graph.node_names().collect();
        }
        told
    }

    fn outline(&self, Outline { graph, roots, text }: Outline) -> Result<Json, Refused> {
        let read =
            || plain::read_text(&graph).map_err(|error| EditError::Read(graph.clone(), error));
        let text = match text {
            Some(text) => text,
            None => read().map_err(|error| error.to_string())?,
        };
        let options = Options { roots, ..Options::default() };
        let (checked, outline) =
            maquette_diagram::outline(&graph, text.clone(), self.catalog, &options);
        let checked = checked.as_far_as_known();
        let mut told = json!({ "ok": checked.graph.is_some(), "text": text, "outline": outline });
        match Layout::of(&graph) {
            Ok(layout) => told["layout"] = json!(layout),
            Err(why) => told["layout_why"] = why.into(),
        }
        if let Some(outline) = &outline {
            told["outline"]["places"] = json!(Places::of(outline));
        }
        put_problems(&mut told, &checked.problems);
        Ok(told)
    }

    fn edit(&self, wish: &EditWish) -> Result<Json, Refused> {
        let EditWish { graph, roots, edits, dry } = wish;
        let file = GraphFile { graph, roots, draft: false, dry_run: *dry };
        told_edit(file.done(edits, self.catalog))
    }

    /// Replaces the text of a file, which must be `was`. If `theirs` is given, the file may differ: what others changed is merged into the text.
    fn put(
        &self,
        graph: &Path,
        was: String,
        text: String,
        theirs: Option<Vec<[String; 2]>>,
    ) -> Result<Json, Refused> {
        let file = GraphFile { graph, roots: &[], draft: false, dry_run: false };
        told_edit(file.turn().and_then(|_turn| {
            let before = file.text()?;
            let text = match theirs {
                Some(mut theirs) => {
                    theirs.push([was, before.clone()]);
                    file.merged(text, theirs, self.catalog)?
                }
                None if before == was => text,
                None => return Err(EditError::Changed(graph.to_owned())),
            };
            let edited = Edited { text, before, changes: Vec::new() };
            file.write(&edited).map(|()| edited)
        }))
    }
}

fn told_edit(edited: Result<Edited, EditError>) -> Result<Json, Refused> {
    match edited {
        Ok(Edited { text, before, .. }) => Ok(json!({ "text": text, "before": before })),
        Err(error) => {
            let why = error.to_string();
            let problems = match error {
                EditError::Refused(problems) => problems,
                _ => Vec::new(),
            };
            Err(Refused { why, problems })
        }
    }
}

/// How requests are answered.
trait Answer {
    /// Answers the request of this id.
    fn answer(&self, id: &Json, answer: Result<Json, Refused>);
}

impl Answer for Listener {
    fn answer(&self, id: &Json, answer: Result<Json, Refused>) {
        let (event, mut fields) = match answer {
            Ok(fields) => ("answer", fields),
            Err(Refused { why, problems }) => {
                let mut fields = json!({ "why": why });
                put_problems(&mut fields, &problems);
                ("refused", fields)
            }
        };
        fields["id"] = id.clone();
        self.tell(event, fields);
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(|broken| broken.into_inner())
}
