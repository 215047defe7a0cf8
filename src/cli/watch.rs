//! `maquette watch`: evaluates a graph again whenever one of the files changes on which it depends.
//!
//! The watch continues after errors; outputs that cannot be computed stay as they are. It ends with exit code 0 at `q`, Ctrl-C or a
//! termination signal, or when its standard output is closed.

use std::iter;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Sender, channel};

use clap::Args;
use maquette_format::camera;
use maquette_graph::catalog::Catalog;
use maquette_graph::files::companion_paths;
use maquette_graph::{LOCK_ENDING, PINS_ENDING, ReadFile};
use maquette_preview::{Page, PageRequest, Redirect};
use maquette_syntax::error::{Diagnostic, code};
use maquette_syntax::paths::{MARKER, project_root};
use serde_json::json;

use super::events::Listener;
use super::replay::ProvenanceOptions;
use super::terminal::{Input, Screen};
use super::{EvaluationOptions, Exit, eprint, interrupt, print, report};
use crate::listen as watch;
use crate::listen::{Event, Sources, WatchList};

mod block;
mod browser;
mod drag;
mod editor;
mod launch;
mod on_done;
mod session;
mod view;
mod worker;

use on_done::{CommandResult, OnDone};
use session::Session;
use view::{EventView, LineView, PageView, TerminalView, View};
use worker::{OutputOptions, Worker, WorkerEvent};

use crate::DisplayPath;

#[derive(Args)]
pub(crate) struct Watch {
    /// The graph file.
    graph: PathBuf,
    /// The folder for the outputs [default: `out/GRAPH`; with --draft `out/GRAPH-draft`].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Write only this output. May be repeated.
    #[arg(long, value_name = "OUTPUT")]
    only: Vec<String>,
    #[command(flatten)]
    evaluation: EvaluationOptions,
    /// The number of threads; 0 for all.
    #[arg(long, default_value_t = 0)]
    threads: usize,
    #[command(flatten)]
    provenance: ProvenanceOptions,
    /// Evaluate once and end.
    #[arg(long)]
    once: bool,
    /// List all watched paths with the reasons; run nothing.
    #[arg(long, conflicts_with = "once")]
    list: bool,
    /// Run this shell command after each successful run. MAQUETTE_OUT is the folder of the outputs. The watch does not wait for the command
    /// (`--once` does). If it is still running at the next run, it is started again when it ends.
    #[arg(long, value_name = "COMMAND")]
    on_done: Option<String>,
    /// Poll the files twice a second instead of using file events of the system.
    #[arg(long)]
    poll: bool,
    /// Print events while the command runs, one JSON object per line.
    #[arg(long)]
    events: bool,
    /// Serve a live page of the graph to browsers on this machine, and print its permanent link. Keep the link secret: it gives access to
    /// the graph and its parameters.
    #[arg(long, conflicts_with_all = ["once", "list"])]
    preview: bool,
    /// Serve the live page and open it in a browser: $BROWSER, or the default browser.
    #[arg(long, conflicts_with_all = ["once", "list"])]
    open: bool,
    /// Let an editor on this machine embed the live page.
    #[arg(long, hide = true)]
    in_editor: bool,
}

/// A message to the main thread of a watch.
enum Message {
    Files(Event),
    Input(Input),
    /// A request from the live page.
    Page(PageRequest),
    /// The reason why a request from the live page failed.
    Refused(String),
    /// The reason why the live page could not be opened in a browser.
    NotOpened(String),
    /// An event of the thread that evaluates.
    Evaluation(WorkerEvent),
    /// The user's command has ended.
    CommandEnded(CommandResult),
}

impl Watch {
    pub(super) fn run(&self, catalog: &Arc<Catalog>) -> Exit {
        if self.list {
            return self.print_list(catalog);
        }
        let (sender, receiver) = channel();
        let outputs = self.evaluation.graph.output_folder(self.out.as_deref(), &self.graph);
        let outputs = self.provenance.apply_to(outputs.keeping(self.evaluation.inputs.files()));
        let folder = outputs.path().to_owned();
        let stop = sender.clone();
        interrupt::on_interrupt(move || drop(stop.send(Message::Input(Input::Stop))));
        let page = match (self.preview || self.open).then(|| self.open_page(&sender)).transpose() {
            Ok(page) => page,
            Err(why) => return Exit::Usage(format!("cannot serve the live page: {why}")),
        };
        let link = page.as_ref().map(Page::link);
        let screen = !self.events && !self.once && Screen::is_possible();
        let input = sender.clone();
        let terminal = screen
            .then(|| {
                TerminalView::open(&self.graph, &folder, link.clone(), move |heard| {
                    drop(input.send(Message::Input(heard)));
                })
                .ok()
            })
            .flatten();
        let quiet = terminal.is_some();
        if let Some(link) = link.as_ref().filter(|_| !quiet) {
            self.print_link(link);
        }
        // Keep the file that redirects the browser to the page until the watch ends.
        let _redirect = page.as_ref().filter(|_| self.open).map(|page| open_browser(page, &sender));
        let view: Box<dyn View> = match terminal {
            Some(terminal) => Box::new(terminal),
            None if self.events => Box::new(EventView(Listener::of_stdout())),
            None => Box::new(LineView::default()),
        };
        let view: Box<dyn View> = match page {
            Some(page) => Box::new(PageView::new(page, catalog.clone(), view)),
            None => view,
        };
        let done = sender.clone();
        let session = match self.evaluation.cache.session(self.threads, catalog) {
            Ok(session) => session,
            Err(why) => return Exit::Usage(why),
        };
        let worker = Worker::new(
            session,
            OutputOptions {
                folder: outputs,
                only: self.only.clone(),
                inputs: self.evaluation.inputs.clone(),
            },
            view.observe(),
            move |news| drop(done.send(Message::Evaluation(news))),
        );
        let events = sender.clone();
        let sink = Arc::new(move |event| drop(events.send(Message::Files(event))));
        let sources = if self.once { Sources::empty() } else { Sources::new(sink, self.poll) };
        let on_done = self.on_done.clone();
        let on_done = on_done.map(|command| OnDone::new(command, folder, quiet));
        Session::new(self, catalog, sources, worker, view, on_done, sender).run(&receiver)
    }

    fn open_page(&self, sender: &Sender<Message>) -> std::io::Result<Page> {
        let sender = sender.clone();
        Page::open(&self.graph, self.evaluation.graph.draft, self.in_editor, move |wish| {
            drop(sender.send(Message::Page(wish)));
        })
    }

    fn print_link(&self, link: &str) {
        if self.events {
            Listener::of_stdout().send("page", json!({ "link": link }));
        } else {
            eprint(&format!("live page: {link}\n"));
        }
    }

    fn print_list(&self, catalog: &Catalog) -> Exit {
        let checked = self.evaluation.graph.load(&self.graph, catalog);
        report(&checked.diagnostics);
        let outside = reads_outside(&checked.diagnostics);
        let here = std::env::current_dir().unwrap_or_default();
        let list = self.watch_list(&here, &checked.files, &checked.subgraphs, outside, catalog);
        for file in list.files() {
            let path = file.path.strip_prefix(&here).unwrap_or(&file.path);
            let missing = if file.path.exists() { "" } else { " (not there)" };
            print(&format!("{}{missing}  {}\n", path.for_display(), file.reason));
        }
        Exit::Done
    }

    /// Returns all files on which the result depends: the graph, the graphs that it uses, the files that nodes read (`files`), and the
    /// marker files that determine the root of the project. `here` is the folder in which the watch was started; it may have been deleted.
    fn watch_list(
        &self,
        here: &Path,
        files: &[ReadFile],
        subgraphs: &[PathBuf],
        outside: bool,
        catalog: &Catalog,
    ) -> WatchList {
        let readers = catalog.readers();
        let path = here.join(&self.graph);
        let folder = path.parent().unwrap_or(&path);
        let folder = std::fs::canonicalize(folder).unwrap_or_else(|_| folder.to_owned());
        let root = project_root(&folder);
        let mut requests = vec![watch::WatchRequest { path, reason: "the graph".into() }];
        requests.extend(subgraphs.iter().map(|path| watch::WatchRequest {
            path: here.join(path),
            reason: "a graph that it uses".into(),
        }));
        for (ending, why) in [(LOCK_ENDING, "its lock file"), (PINS_ENDING, "its pins")] {
            let path = here.join(self.graph.with_extension(ending));
            requests.push(watch::WatchRequest { path, reason: format!("{why} if it exists") });
        }
        requests.extend(files.iter().map(|file| {
            let optional = if file.optional { " if it exists" } else { "" };
            watch::WatchRequest {
                path: here.join(&file.path),
                reason: format!("read by `{}`{optional}", file.node),
            }
        }));
        let roots = [root.clone()];
        for path in self.evaluation.inputs.files() {
            let path = here.join(path);
            let beside = iter::once(path.with_file_name(camera::NAME));
            let named = beside.chain(companion_paths(&path, &roots, readers));
            requests.extend(named.map(|path| watch::WatchRequest {
                path,
                reason: "read with an input if it exists".into(),
            }));
            requests.push(watch::WatchRequest { path, reason: "an input".into() });
        }
        for file in files {
            let name = file.path.file_name().unwrap_or_default().to_string_lossy();
            let why = format!("named by {name}");
            let named = companion_paths(&file.path, &roots, readers).into_iter();
            requests.extend(named.map(|path| watch::WatchRequest { path, reason: why.clone() }));
        }
        // The root of the project changes if a marker file is created nearer to the graph, or if the present one is deleted. Without a
        // marker file, the root matters only if the graph reads files outside of its own folder.
        if outside || root.join(MARKER).is_file() {
            let above = folder.ancestors().take_while(|above| outside || above.starts_with(&root));
            requests.extend(above.map(|above| watch::WatchRequest {
                path: above.join(MARKER),
                reason: "marks the root of the project".into(),
            }));
        }
        WatchList::new(&requests, &root)
    }
}

/// Opens the page in a browser, through a file that redirects to it. The secret link itself must not appear in lists of processes.
fn open_browser(page: &Page, sender: &Sender<Message>) -> Option<Redirect> {
    let (sender, link) = (sender.clone(), page.link());
    let failed = move |why: &str| {
        let words = format!("no browser was opened ({why}); open {link} yourself");
        let _ = sender.send(Message::NotOpened(words));
    };
    match page.redirect() {
        Ok(redirect) => {
            browser::open(redirect.path(), failed);
            Some(redirect)
        }
        Err(why) => {
            failed(&why.to_string());
            None
        }
    }
}

/// Returns true if one of the diagnostics is that the graph reads a file outside of its project.
fn reads_outside(diagnostics: &[Diagnostic]) -> bool {
    diagnostics.iter().any(|diagnostic| diagnostic.code == code::OUTSIDE)
}
