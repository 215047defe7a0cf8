//! `maquette watch`: evaluates a graph, and again on every change of anything that it depends on.
//!
//! Whatever is wrong, the watch goes on, and outputs that cannot be made anew stay as they are. It ends by `q`, Ctrl-C or a
//! signal, with exit code 0, or when nobody reads what it prints any more.

use std::iter;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Sender, channel};

use clap::Args;
use maquette_format::camera;
use maquette_graph::catalog::Catalog;
use maquette_graph::files::named_in;
use maquette_graph::{LOCK_ENDING, PINS_ENDING, ReadFile};
use maquette_preview::{Page, Redirect, Wish};
use maquette_syntax::error::{Problem, code};
use maquette_syntax::paths::{MARKER, project_root};
use serde_json::json;

use super::caching::CacheOptions;
use super::events::Listener;
use super::inputs::InputOptions;
use super::replay::ProvenanceOptions;
use super::terminal::{Input, Screen};
use super::{Exit, GraphOptions, eprint, interrupt, print, report};
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

use on_done::{Ended, OnDone};
use session::Session;
use view::{Lines, Program, Terminal, View, WithPage};
use worker::{News, Wishes, Worker};

use crate::Shown;

#[derive(Args)]
pub(crate) struct Watch {
    /// The graph file.
    graph: PathBuf,
    /// The folder for the outputs; `out/GRAPH` if left out, `out/GRAPH-draft` with --draft.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Write only this output; may be given several times.
    #[arg(long, value_name = "OUTPUT")]
    only: Vec<String>,
    #[command(flatten)]
    inputs: InputOptions,
    #[command(flatten)]
    options: GraphOptions,
    #[command(flatten)]
    cache: CacheOptions,
    /// How many threads to use; 0 is all.
    #[arg(long, default_value_t = 0)]
    threads: usize,
    #[command(flatten)]
    provenance: ProvenanceOptions,
    /// Evaluate once, as a watch does, and end.
    #[arg(long)]
    once: bool,
    /// Print every path that would be watched, and why; run nothing.
    #[arg(long, conflicts_with = "once")]
    list: bool,
    /// Run this command by the shell after each successful run. MAQUETTE_OUT is the folder of the outputs. The watch does not
    /// wait for it (`--once` does); one that still runs is started again when it ends.
    #[arg(long, value_name = "COMMAND")]
    on_done: Option<String>,
    /// Look at the files twice a second instead of asking the system for changes.
    #[arg(long)]
    poll: bool,
    /// Print what happens as it happens, one JSON object a line.
    #[arg(long)]
    events: bool,
    /// Serve a live page of the graph to browsers on this machine, and print its link, which stays the same. The link is for your
    /// eyes: who has it sees the graph, and changes its parameters.
    #[arg(long, conflicts_with_all = ["once", "list"])]
    preview: bool,
    /// The same, and open the page in your browser: $BROWSER, or the system's.
    #[arg(long, conflicts_with_all = ["once", "list"])]
    open: bool,
    /// Let an editor on this machine show the live page in a frame of its own.
    #[arg(long, hide = true)]
    in_editor: bool,
}

/// What the listening thread hears.
enum Message {
    Files(Event),
    Input(Input),
    /// Somebody wants something on the live page.
    Page(Wish),
    /// What somebody wanted on the live page could not be done, and why.
    Refused(String),
    /// The page was not opened in a browser, and why.
    NotOpened(String),
    /// An evaluation has found something, or ended.
    Evaluation(News),
    /// The user's command ended.
    CommandEnded(Ended),
}

impl Watch {
    pub(super) fn run(&self, catalog: &Arc<Catalog>) -> Exit {
        if self.list {
            return self.print_list(catalog);
        }
        let (sender, receiver) = channel();
        let outputs = self.options.folder(self.out.as_deref(), &self.graph);
        let outputs = self.provenance.applied(outputs.keeping(self.inputs.files()));
        let folder = outputs.path().to_owned();
        let stop = sender.clone();
        interrupt::handle(move || drop(stop.send(Message::Input(Input::Stop))));
        let page = match (self.preview || self.open).then(|| self.open_page(&sender)).transpose() {
            Ok(page) => page,
            Err(why) => return Exit::Usage(format!("there can be no live page: {why}")),
        };
        let link = page.as_ref().map(Page::link);
        let screen = !self.events && !self.once && Screen::is_possible();
        let input = sender.clone();
        let terminal = screen
            .then(|| {
                Terminal::open(&self.graph, &folder, link.clone(), move |heard| {
                    drop(input.send(Message::Input(heard)))
                })
                .ok()
            })
            .flatten();
        let quiet = terminal.is_some();
        if let Some(link) = link.as_ref().filter(|_| !quiet) {
            self.tell_link(link);
        }
        // Gone with the watch.
        let _redirect = page.as_ref().filter(|_| self.open).map(|page| open_browser(page, &sender));
        let view: Box<dyn View> = match terminal {
            Some(terminal) => Box::new(terminal),
            None if self.events => Box::new(Program(Listener::of_stdout())),
            None => Box::new(Lines::default()),
        };
        let view: Box<dyn View> = match page {
            Some(page) => Box::new(WithPage::new(page, catalog.clone(), view)),
            None => view,
        };
        let done = sender.clone();
        let session = match self.cache.session(self.threads, catalog) {
            Ok(session) => session,
            Err(why) => return Exit::Usage(why),
        };
        let worker = Worker::new(
            session,
            Wishes { folder: outputs, only: self.only.clone(), inputs: self.inputs.clone() },
            view.observe(),
            move |news| drop(done.send(Message::Evaluation(news))),
        );
        let events = sender.clone();
        let sink = Arc::new(move |event| drop(events.send(Message::Files(event))));
        let sources = if self.once { Sources::none() } else { Sources::new(sink, self.poll) };
        let on_done = self.on_done.clone();
        let on_done = on_done.map(|command| OnDone::new(command, folder, quiet));
        Session::new(self, catalog, sources, worker, view, on_done, sender).run(&receiver)
    }

    fn open_page(&self, sender: &Sender<Message>) -> std::io::Result<Page> {
        let sender = sender.clone();
        Page::open(&self.graph, self.options.draft, self.in_editor, move |wish| {
            drop(sender.send(Message::Page(wish)))
        })
    }

    fn tell_link(&self, link: &str) {
        if self.events {
            Listener::of_stdout().tell("page", json!({ "link": link }));
        } else {
            eprint(&format!("live page: {link}\n"));
        }
    }

    fn print_list(&self, catalog: &Catalog) -> Exit {
        let checked = self.options.load(&self.graph, catalog);
        report(&checked.problems);
        let outside = reads_outside(&checked.problems);
        let here = std::env::current_dir().unwrap_or_default();
        let list = self.watch_list(&here, &checked.files, &checked.subgraphs, outside, catalog);
        for file in list.files() {
            let path = file.path.strip_prefix(&here).unwrap_or(&file.path);
            let missing = if file.path.exists() { "" } else { " (not there)" };
            print(&format!("{}{missing}  {}\n", path.shown(), file.why));
        }
        Exit::Done
    }

    /// Everything that the outcome depends on: the graph, those that it uses, the files that their nodes read (`files`), and what
    /// says which files they may read. The watch was started in the folder `here`, which may have gone meanwhile.
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
        let mut wishes = vec![watch::Wish { path, why: "the graph".into() }];
        wishes.extend(
            subgraphs.iter().map(|path| watch::Wish {
                path: here.join(path),
                why: "a graph that it uses".into(),
            }),
        );
        for (ending, why) in [(LOCK_ENDING, "its lock file"), (PINS_ENDING, "its pins")] {
            let path = here.join(self.graph.with_extension(ending));
            wishes.push(watch::Wish { path, why: format!("{why} if there is one") });
        }
        wishes.extend(files.iter().map(|file| {
            let optional = if file.optional { " if it is there" } else { "" };
            watch::Wish {
                path: here.join(&file.path),
                why: format!("read by `{}`{optional}", file.node),
            }
        }));
        let roots = [root.clone()];
        for path in self.inputs.files() {
            let path = here.join(path);
            let beside = iter::once(path.with_file_name(camera::NAME));
            let named = beside.chain(named_in(&path, &roots, readers));
            fn why() -> String {
                "read with an input if it is there".into()
            }
            wishes.extend(named.map(|path| watch::Wish { path, why: why() }));
            wishes.push(watch::Wish { path, why: "an input".into() });
        }
        for file in files {
            let name = file.path.file_name().unwrap_or_default().to_string_lossy();
            let why = format!("named by {name}");
            let named = named_in(&file.path, &roots, readers).into_iter();
            wishes.extend(named.map(|path| watch::Wish { path, why: why.clone() }));
        }
        // A marker that appears nearer, or goes away, makes another root. Where there is none it matters only to a graph that reads
        // outside of its folder.
        if outside || root.join(MARKER).is_file() {
            let above = folder.ancestors().take_while(|above| outside || above.starts_with(&root));
            wishes.extend(above.map(|above| watch::Wish {
                path: above.join(MARKER),
                why: "marks the root of the project".into(),
            }));
        }
        WatchList::new(&wishes, &root)
    }
}

/// Opens the page in a browser, which is given a file that leads there: the link is nothing for lists of processes.
fn open_browser(page: &Page, sender: &Sender<Message>) -> Option<Redirect> {
    let (sender, link) = (sender.clone(), page.link());
    let failed = move |why: &str| {
        let words = format!("no browser was opened ({why}): open {link} yourself");
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

/// Whether a graph wants to read files that it may not read where the root of its project is now.
fn reads_outside(problems: &[Problem]) -> bool {
    problems.iter().any(|problem| problem.code == code::OUTSIDE)
}
