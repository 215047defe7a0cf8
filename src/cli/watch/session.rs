//! A watch under way: one thread listens and decides, one evaluates.
//!
//! A change of the graph is checked at once; the evaluation waits until the change is complete ([`Batch`]). A newer change stops an
//! evaluation under way, unless it means the same. Outputs are written, and the user's command is started, when no more changes
//! come ([`Series`]): pages show values before.

use std::collections::BTreeSet;
use std::iter;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender};
use std::time::{Duration, Instant};

use maquette_engine::writing::is_writable;
use maquette_graph::catalog::Catalog;
use maquette_graph::{Checked, Graph, ReadFile};
use maquette_node::CancelToken;
use maquette_preview::{Views, Wish};
use maquette_syntax::error::{Problem, Severity, code};
use maquette_value::Hash;

use super::drag::Drag;
use super::on_done::{Ended, OnDone};
use super::view::View;
use super::worker::{Job, News, Purpose, Report, Sight, Worker};
use super::{Message, Watch, editor, reads_outside};
use crate::listen::{Batch, Contents, Series, Sources};
use crate::terminal::Input;
use crate::{Exit, stdout_is_closed};

mod files;
mod page;
mod state;

use page::Change;
use state::{Check, Running, is_part, return_to};

/// A watch under way.
pub(super) struct Session<'a> {
    command: &'a Watch,
    catalog: &'a Catalog,
    sources: Sources,
    /// The files that the graph reads, as of the last time that they could be found out.
    files: Vec<ReadFile>,
    /// The graphs that it uses.
    subgraphs: Vec<PathBuf>,
    /// Whether it wants to read files outside of its project.
    outside: bool,
    /// The files that were last reported as watched, and why they are polled.
    told: Option<(Vec<PathBuf>, Option<String>)>,
    contents: Contents,
    batch: Batch,
    series: Series,
    /// The folder in which the watch was started.
    here: PathBuf,
    /// Whether it is yet to be said that a run with errors in the graph is over.
    is_broken: bool,
    /// When the user's command is to be started, if no newer change comes.
    command_due: Option<Instant>,
    /// Whether the graph has been without unknown nodes: pages go on to show it as it was then while the name of a type is typed.
    was_whole: bool,
    check: Check,
    /// Whether the next run has to compute everything.
    recompute: bool,
    /// A run has to be made, because these files changed.
    wanted: Option<Vec<PathBuf>>,
    /// The run under way.
    running: Option<Running>,
    /// What somebody looks at on the live page.
    views: Views,
    /// Whether values for them have to be found.
    look: bool,
    /// What somebody drags there. What is not of the drag waits for its end.
    drag: Drag,
    /// What was put into the graph's file for pages, the last change last.
    changes: Vec<Change>,
    /// The identity of the graph that pages show.
    shown: Option<Hash>,
    /// The last graph that could be run, and when it was; one without unknown nodes if there has been such.
    good: Option<(usize, Arc<Graph>)>,
    /// How many runs there have been.
    runs: usize,
    /// Whether the last run had errors.
    failed: bool,
    /// The folder that the last run could not write to, and when to try it again.
    unwritten: Option<(PathBuf, Instant)>,
    on_done: Option<OnDone>,
    worker: Worker,
    view: Box<dyn View>,
    sender: Sender<Message>,
}

fn is_stop(message: &Message) -> bool {
    matches!(message, Message::Input(Input::Stop | Input::Key('q')))
}

/// How often a folder that could not be written to is tried again.
const RETRY: Duration = Duration::from_secs(1);

/// How often a run under way is drawn.
const FRAME: Duration = Duration::from_millis(100);

/// An evaluation that was cancelled has this long to end before the program ends without it.
const PATIENCE: Duration = Duration::from_secs(2);

impl<'a> Session<'a> {
    pub(super) fn new(
        command: &'a Watch,
        catalog: &'a Catalog,
        sources: Sources,
        worker: Worker,
        view: Box<dyn View>,
        on_done: Option<OnDone>,
        sender: Sender<Message>,
    ) -> Self {
        Self {
            command,
            catalog,
            sources,
            files: Vec::new(),
            subgraphs: Vec::new(),
            outside: false,
            told: None,
            contents: Contents::default(),
            batch: Batch::default(),
            series: Series::default(),
            here: std::env::current_dir().unwrap_or_default(),
            is_broken: false,
            command_due: None,
            was_whole: false,
            check: Check::Due,
            recompute: false,
            wanted: None,
            running: None,
            views: Views::new(),
            look: false,
            drag: Drag::default(),
            changes: Vec::new(),
            shown: None,
            good: None,
            runs: 0,
            failed: false,
            unwritten: None,
            on_done,
            worker,
            view,
            sender,
        }
    }

    pub(super) fn run(mut self, receiver: &Receiver<Message>) -> Exit {
        self.rewatch();
        self.check_graph();
        self.settle(Vec::new());
        loop {
            if self.command.once && self.running.is_none() && self.wanted.is_none() {
                return self.end_once();
            }
            let now = Instant::now();
            let frame = self.running.as_ref().map(|_| now + FRAME);
            let retry = self.unwritten.as_ref().map(|(_, due)| *due);
            let rest = self.gives_up();
            let growth = self.series.growth_due();
            let broken = self.series.settles().filter(|_| self.is_broken);
            let command = self.command_due.filter(|_| self.is_idle());
            let due = [self.batch.due(), frame, retry, rest, growth, broken, command];
            let due = due.into_iter().flatten().min();
            let heard = match due {
                None => receiver.recv().map_err(|_| RecvTimeoutError::Disconnected),
                Some(due) => receiver.recv_timeout(due.saturating_duration_since(now)),
            };
            match heard {
                Ok(message) => {
                    // All that came meanwhile is heard at once: a thousand files saved together are one change.
                    let messages: Vec<_> = iter::once(message).chain(receiver.try_iter()).collect();
                    if messages.iter().any(is_stop) {
                        return self.stop(receiver);
                    }
                    self.hear(messages);
                }
                Err(RecvTimeoutError::Timeout) if self.running.is_some() => self.view.refresh(),
                Err(_) => {}
            }
            let grown = self.series.take_grown(Instant::now());
            self.files_changed(&BTreeSet::from_iter(grown), false);
            if let Some(touched) = self.batch.take(Instant::now()) {
                let changed = self.contents.act_on(touched);
                if !changed.is_empty() || self.wanted.is_some() {
                    self.settle(changed);
                }
            }
            self.try_to_write_again();
            if self.gives_up().is_some_and(|due| due <= Instant::now()) {
                self.leave();
            }
            self.start();
            self.worker.hold.set(self.series.settles());
            self.end_broken();
            self.start_command();
            if stdout_is_closed() {
                return self.stop(receiver);
            }
        }
    }

    fn hear(&mut self, messages: Vec<Message>) {
        let (mut events, mut others) = (Vec::new(), Vec::new());
        for message in messages {
            match message {
                Message::Files(event) => events.push(event),
                other => others.push(other),
            }
        }
        // Files come first: a run whose files have changed is not the last one.
        self.files_touched(&events);
        others.into_iter().for_each(|message| self.hear_one(message));
    }

    fn hear_one(&mut self, message: Message) {
        match message {
            Message::Input(Input::Key('r')) => self.run_again(false),
            Message::Input(Input::Key('f')) => self.run_again(true),
            Message::Input(Input::Key('p')) => self.view.toggle_profile(),
            Message::Input(Input::Resized) => self.view.resized(),
            Message::Input(_) | Message::Files(_) => {}
            Message::Page(Wish::Look(views)) => {
                self.look = !views.is_empty();
                self.views = views;
            }
            Message::Page(Wish::Set(page, values)) => self.set(page, &values),
            Message::Page(Wish::Undo) => self.undo(),
            Message::Page(Wish::Drag(page, values)) => self.dragged(page, values),
            Message::Page(Wish::Drop(page)) => {
                if self.drag.let_go(page) {
                    self.show_file();
                }
            }
            Message::Page(Wish::Open(place)) => {
                let sender = self.sender.clone();
                editor::open(&place, move |why| drop(sender.send(Message::Refused(why))));
            }
            Message::Refused(why) => self.view.refused(&why),
            Message::NotOpened(why) => self.view.not_opened(&why),
            Message::Evaluation(News::Sight(sight)) => self.seen(sight),
            Message::Evaluation(News::Report(report)) => self.evaluated(report),
            Message::CommandEnded(ended) => {
                if let Some(why) = ended.failure() {
                    self.view.command_failed(&why);
                }
                if self.on_done.as_mut().is_some_and(OnDone::ended) {
                    self.command_due.get_or_insert_with(Instant::now);
                }
            }
        }
    }

    /// Stops the run under way; another one has to be made for it.
    fn cancel(&mut self) {
        if let Some(running) = &self.running {
            running.cancel.cancel();
            self.wanted.get_or_insert_default();
        }
    }

    /// Reads and checks the graph; shows its errors at once, unless it may be half a file.
    fn check_graph(&mut self) {
        return_to(&self.here);
        let Checked { graph, partial, problems, files, subgraphs } =
            self.command.options.load(&self.command.graph, self.catalog).without_missing_files();
        let readable = !problems
            .iter()
            .any(|problem| problem.code == code::SYNTAX || problem.source.text.is_empty());
        if readable {
            self.files = files;
            self.subgraphs = subgraphs;
            self.outside = reads_outside(&problems);
        } else {
            // Half a graph may be one that it uses: then its next save has to be noticed.
            let new = subgraphs.into_iter().filter(|path| !self.subgraphs.contains(path));
            let new = Vec::from_iter(new);
            self.subgraphs.extend(new);
        }
        let is_whole = graph.is_some();
        self.check = match graph.or(partial) {
            Some(graph) => {
                if is_whole || !self.was_whole {
                    self.view.graph(&graph);
                    self.shown = Some(graph.shape().identity);
                }
                self.was_whole |= is_whole;
                self.view.checked(self.runs + 1, &problems);
                Check::Good { graph: Arc::new(graph), problems }
            }
            None => Check::Bad { problems, shown: false },
        };
        self.rewatch();
        if readable {
            self.show_errors();
        }
    }

    fn show_errors(&mut self) {
        if let Check::Bad { problems, shown: shown @ false } = &mut self.check {
            *shown = true;
            self.view.checked(self.runs + 1, problems);
            // If the change is taken back the errors have to go away, too.
            self.wanted.get_or_insert_default();
        }
    }

    /// The changes are complete: evaluates, or says why not.
    fn settle(&mut self, changed: Vec<PathBuf>) {
        if matches!(self.check, Check::Due) {
            self.check_graph();
        }
        self.tell_watched();
        self.show_errors();
        match &self.check {
            Check::Good { .. } => {
                self.wanted.get_or_insert_default().extend(changed);
                self.start();
            }
            Check::Bad { .. } => {
                self.cancel();
                self.wanted = None;
                self.is_broken = true;
                self.end_broken();
            }
            Check::Due => {}
        }
    }

    /// Says that a run with errors in the graph is over, as soon as the changes have settled.
    fn end_broken(&mut self) {
        if !self.is_broken || self.series.settles().is_some_and(|due| Instant::now() < due) {
            return;
        }
        self.is_broken = false;
        if let Check::Bad { problems, .. } = &self.check {
            self.runs += 1;
            self.view.end_broken(self.runs, problems);
            self.failed = true;
            self.command_due = None;
            self.series.end();
        }
    }

    /// Starts the run that is wanted, if nothing else runs and nothing more is about to change; or finds what somebody looks at, in
    /// the last graph that could be run. While somebody drags only the values of the drag are evaluated.
    fn start(&mut self) {
        if self.running.is_some() || self.batch.due().is_some() {
            return;
        }
        if self.drag.is_on() {
            return self.start_drag();
        }
        if let Check::Good { graph, problems } = &self.check
            && let Some(changed) = self.wanted.take()
        {
            let (graph, problems) = (graph.clone(), problems.clone());
            self.runs += 1;
            self.view.begin(self.runs, &changed);
            if !(self.was_whole && is_part(&problems)) {
                self.good = Some((self.runs, graph.clone()));
            }
            self.is_broken = false;
            self.worker.hold.set(self.series.settles());
            let recompute = std::mem::take(&mut self.recompute);
            self.give(self.runs, graph, problems, recompute, Purpose::Outputs);
        } else if self.look
            && let Some((run, graph)) = self.good.clone()
        {
            self.give(run, graph, Vec::new(), false, Purpose::Look);
        }
    }

    /// Gives the worker something to do.
    fn give(
        &mut self,
        run: usize,
        graph: Arc<Graph>,
        problems: Vec<Problem>,
        recompute: bool,
        purpose: Purpose,
    ) {
        let cancel = CancelToken::default();
        let is_part = is_part(&problems);
        let (of, stop) = (graph.clone(), cancel.clone());
        self.running = Some(Running { graph: of, cancel: stop, purpose, is_part });
        self.look = false;
        let views = self.views.clone();
        self.worker.start(Job { run, graph, problems, cancel, recompute, purpose, views });
    }

    /// Whether pages show this graph, with as many elements as it has.
    fn is_shown(&self, graph: &Graph) -> bool {
        self.shown == Some(graph.shape().identity)
    }

    /// Shows what somebody looks at, before all else of a run is done.
    fn seen(&mut self, sight: Sight) {
        let Some(running) = self.running.as_ref().filter(|running| !running.is_left()) else {
            return;
        };
        let stays = self.was_whole && running.is_part;
        if let Some(graph) = sight.graph.as_ref().filter(|it| !stays && !self.is_shown(it)) {
            self.view.graph(graph);
            self.shown = Some(graph.shape().identity);
        }
        self.view.values(sight.run, running.purpose == Purpose::Drag, &sight.values);
    }

    fn evaluated(&mut self, report: Report) {
        let left = self.running.take().is_some_and(|running| running.is_left());
        if report.cancelled || left {
            // Of a drag that is over the file is shown, or about to change.
            if report.purpose != Purpose::Drag || self.drag.is_on() {
                self.look = !self.views.is_empty();
            }
            match report.purpose {
                Purpose::Outputs => self.view.cancelled(report.run),
                Purpose::Look | Purpose::Drag => self.view.left(report.run),
            }
            return;
        }
        match report.purpose {
            Purpose::Outputs => {}
            Purpose::Look => return,
            Purpose::Drag => {
                let failed = report.problems.iter().find(|p| p.severity == Severity::Error);
                if failed.is_some() && self.drag.refused() {
                    failed.into_iter().for_each(|problem| self.view.refused(&problem.message));
                }
                return;
            }
        }
        let failed = report.problems.iter().any(|problem| problem.severity == Severity::Error);
        // If it can be written to, something else was wrong, and would be again.
        let folder = report.unwritten.clone().filter(|folder| !is_writable(folder));
        self.unwritten = folder.map(|folder| (folder, Instant::now() + RETRY));
        self.view.end(&report);
        self.failed = failed;
        let due = self.series.command_due().unwrap_or_else(Instant::now);
        self.command_due = (!failed && !self.command.once).then_some(due);
        if self.wanted.is_none() && self.batch.due().is_none() {
            self.series.end();
        }
    }

    /// Makes a run as soon as files can be written again where the last one could not: no event tells of it.
    fn try_to_write_again(&mut self) {
        let now = Instant::now();
        match &mut self.unwritten {
            Some((folder, due)) if *due <= now => {
                if is_writable(folder) {
                    self.unwritten = None;
                    self.wanted.get_or_insert_default();
                } else {
                    *due = now + RETRY;
                }
            }
            _ => {}
        }
    }

    /// Returns true if neither a run nor a change is under way.
    fn is_idle(&self) -> bool {
        let is_changing = self.batch.due().is_some() || self.is_broken;
        self.running.is_none() && self.wanted.is_none() && !is_changing
    }

    /// Starts the user's command if it is due, and no newer change is there.
    fn start_command(&mut self) {
        let is_due = self.command_due.is_some_and(|due| due <= Instant::now());
        if !is_due || !self.is_idle() {
            return;
        }
        self.command_due = None;
        if let Some(on_done) = &mut self.on_done {
            let sender = self.sender.clone();
            on_done.start(move |message| drop(sender.send(message)));
        }
    }

    /// The user wants a run.
    fn run_again(&mut self, recompute: bool) {
        self.recompute |= recompute;
        self.check = Check::Due;
        self.cancel();
        self.settle(Vec::new());
    }

    /// The only run is over.
    fn end_once(mut self) -> Exit {
        if self.failed {
            return Exit::Failed;
        }
        let ended = self.on_done.as_ref().map(OnDone::run_to_the_end);
        match ended.as_ref().and_then(Ended::failure) {
            None => Exit::Done,
            Some(why) => {
                self.view.command_failed(&why);
                Exit::Failed
            }
        }
    }

    /// Ends the watch; the evaluation under way leaves nothing half-written if it has the time to end.
    fn stop(mut self, receiver: &Receiver<Message>) -> Exit {
        self.cancel();
        let end = Instant::now() + PATIENCE;
        while self.running.is_some() {
            match receiver.recv_timeout(end.saturating_duration_since(Instant::now())) {
                Ok(Message::Evaluation(News::Report(_))) => self.running = None,
                Ok(Message::Input(Input::Stop)) | Err(_) => break,
                Ok(_) => {}
            }
        }
        Exit::Done
    }
}
