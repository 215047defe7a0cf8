//! A running watch. The main thread handles messages, and another thread evaluates.
//!
//! A changed graph is checked at once. The evaluation waits until the change is complete ([`Batch`]). A newer change cancels it, unless
//! that change does not affect the meaning of the graph. After some time without changes, outputs are written and the user's command is
//! started ([`Series`]). Live pages show values before that.

use std::collections::BTreeSet;
use std::iter;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender};
use std::time::{Duration, Instant};

use maquette_engine::writing::is_writable;
use maquette_graph::catalog::Catalog;
use maquette_graph::{CheckedGraph, Graph, ReadFile};
use maquette_node::CancelToken;
use maquette_preview::{PageRequest, Views};
use maquette_syntax::error::{Diagnostic, Severity, code};
use maquette_value::Hash;

use super::drag::Drag;
use super::on_done::{CommandResult, OnDone};
use super::view::View;
use super::worker::{Job, Purpose, Report, ViewUpdate, Worker, WorkerEvent};
use super::{Message, Watch, editor, reads_outside};
use crate::listen::{Batch, Contents, Series, Sources};
use crate::terminal::Input;
use crate::{Exit, has_errors, stdout_is_closed};

mod files;
mod page;
mod state;

use page::Change;
use state::{Check, Running, is_partial, return_to};

/// The state of a running `maquette watch`.
pub(super) struct Session<'a> {
    command: &'a Watch,
    catalog: &'a Catalog,
    sources: Sources,
    /// The input files of the graph, as of the last time when the graph could be read.
    files: Vec<ReadFile>,
    /// The graphs that the watched graph uses.
    subgraphs: Vec<PathBuf>,
    /// True if the graph reads files outside of its project.
    has_outside_files: bool,
    /// The last report to the user: the list of watched files, and the reason why files are polled (`None` if they are not).
    reported_files: Option<(Vec<PathBuf>, Option<String>)>,
    contents: Contents,
    batch: Batch,
    series: Series,
    /// The folder in which the watch was started.
    start_folder: PathBuf,
    /// True if the graph has errors, and the end of the run that these errors prevented has not been reported yet.
    has_unreported_errors: bool,
    /// The time at which the user's command is started, unless a newer change arrives before.
    command_time: Option<Instant>,
    /// True if the graph has had only nodes of known types at some time. Then pages keep showing that version of the graph while the user
    /// types the name of a node type.
    was_complete: bool,
    check: Check,
    /// True if the next run must compute all nodes and use no cached results.
    recompute: bool,
    /// The changed files that require a new run; `None` if no run is required.
    requested: Option<Vec<PathBuf>>,
    /// The running evaluation.
    running: Option<Running>,
    /// The outputs whose values live pages show.
    views: Views,
    /// True if the values for live pages must be evaluated again.
    has_due_views: bool,
    /// The drag of a parameter on a live page. Other evaluations wait until it ends.
    drag: Drag,
    /// The changes of the graph file that live pages have made, the latest last.
    changes: Vec<Change>,
    /// The hash of the graph that live pages show.
    shown_graph: Option<Hash>,
    /// The last graph that could run, and the number of its run. A graph whose nodes all have known types is preferred.
    last_good: Option<(usize, Arc<Graph>)>,
    /// The number of runs so far.
    runs: usize,
    /// True if the last run had errors.
    has_failed: bool,
    /// The output folder into which the last run could not write, and the time at which to check again if the folder is writable.
    failed_folder: Option<(PathBuf, Instant)>,
    on_done: Option<OnDone>,
    worker: Worker,
    view: Box<dyn View>,
    sender: Sender<Message>,
}

fn is_stop(message: &Message) -> bool {
    matches!(message, Message::Input(Input::Stop | Input::Key('q')))
}

/// The interval at which it is checked if an output folder has become writable.
const RETRY_INTERVAL: Duration = Duration::from_secs(1);

/// The interval at which the display is updated during an evaluation.
const FRAME_INTERVAL: Duration = Duration::from_millis(100);

/// The time that a cancelled evaluation gets to stop before the program ends.
const STOP_TIMEOUT: Duration = Duration::from_secs(2);

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
            has_outside_files: false,
            reported_files: None,
            contents: Contents::default(),
            batch: Batch::default(),
            series: Series::default(),
            start_folder: std::env::current_dir().unwrap_or_default(),
            has_unreported_errors: false,
            command_time: None,
            was_complete: false,
            check: Check::Due,
            recompute: false,
            requested: None,
            running: None,
            views: Views::new(),
            has_due_views: false,
            drag: Drag::default(),
            changes: Vec::new(),
            shown_graph: None,
            last_good: None,
            runs: 0,
            has_failed: false,
            failed_folder: None,
            on_done,
            worker,
            view,
            sender,
        }
    }

    pub(super) fn run(mut self, receiver: &Receiver<Message>) -> Exit {
        self.rewatch();
        self.check_graph();
        self.apply_changes(Vec::new());
        loop {
            if self.command.once && self.running.is_none() && self.requested.is_none() {
                return self.end_once();
            }
            let now = Instant::now();
            let frame = self.running.as_ref().map(|_| now + FRAME_INTERVAL);
            let retry = self.failed_folder.as_ref().map(|(_, due)| *due);
            let rest = self.abandon_at();
            let growth = self.series.growth_due();
            let broken = self.series.outputs_due().filter(|_| self.has_unreported_errors);
            let command = self.command_time.filter(|_| self.is_idle());
            let due = [self.batch.due(), frame, retry, rest, growth, broken, command];
            let due = due.into_iter().flatten().min();
            let received = match due {
                None => receiver.recv().map_err(|_| RecvTimeoutError::Disconnected),
                Some(due) => receiver.recv_timeout(due.saturating_duration_since(now)),
            };
            match received {
                Ok(message) => {
                    // Handle all pending messages together, so that a thousand files saved at once are one change.
                    let messages: Vec<_> = iter::once(message).chain(receiver.try_iter()).collect();
                    if messages.iter().any(is_stop) {
                        return self.stop(receiver);
                    }
                    self.handle_messages(messages);
                }
                Err(RecvTimeoutError::Timeout) if self.running.is_some() => self.view.refresh(),
                Err(_) => {}
            }
            let grown = self.series.take_grown(Instant::now());
            self.reread_files(&BTreeSet::from_iter(grown), false);
            if let Some(touched) = self.batch.take(Instant::now()) {
                let changed = self.contents.take_changed(touched);
                if !changed.is_empty() || self.requested.is_some() {
                    self.apply_changes(changed);
                }
            }
            self.retry_writing();
            if self.abandon_at().is_some_and(|due| due <= Instant::now()) {
                self.abandon_view();
            }
            self.start();
            self.worker.write_delay.set(self.series.outputs_due());
            self.end_broken();
            self.start_command();
            if stdout_is_closed() {
                return self.stop(receiver);
            }
        }
    }

    fn handle_messages(&mut self, messages: Vec<Message>) {
        let (mut events, mut others) = (Vec::new(), Vec::new());
        for message in messages {
            match message {
                Message::Files(event) => events.push(event),
                other => others.push(other),
            }
        }
        // Handle file events first. Otherwise a run whose input files have already changed could be taken for the final one.
        self.handle_events(&events);
        others.into_iter().for_each(|message| self.handle_message(message));
    }

    fn handle_message(&mut self, message: Message) {
        match message {
            Message::Input(Input::Key('r')) => self.run_again(false),
            Message::Input(Input::Key('f')) => self.run_again(true),
            Message::Input(Input::Key('p')) => self.view.toggle_profile(),
            Message::Input(Input::Resized) => self.view.redraw(),
            Message::Input(_) | Message::Files(_) => {}
            Message::Page(PageRequest::SetViews(views)) => {
                self.has_due_views = !views.is_empty();
                self.views = views;
            }
            Message::Page(PageRequest::Set(page, values)) => self.set(page, &values),
            Message::Page(PageRequest::Undo) => self.undo(),
            Message::Page(PageRequest::Drag(page, values)) => self.drag_to(page, values),
            Message::Page(PageRequest::EndDrag(page)) => {
                if self.drag.release(page) {
                    self.show_file();
                }
            }
            Message::Page(PageRequest::Open(place)) => {
                let sender = self.sender.clone();
                editor::open(&place, move |why| drop(sender.send(Message::Refused(why))));
            }
            Message::Refused(why) => self.view.show_refusal(&why),
            Message::NotOpened(why) => self.view.show_browser_failure(&why),
            Message::Evaluation(WorkerEvent::View(update)) => self.show_values(update),
            Message::Evaluation(WorkerEvent::Report(report)) => self.finish_run(report),
            Message::CommandEnded(ended) => {
                if let Some(why) = ended.failure() {
                    self.view.show_command_failure(&why);
                }
                if self.on_done.as_mut().is_some_and(OnDone::finish) {
                    self.command_time.get_or_insert_with(Instant::now);
                }
            }
        }
    }

    /// Cancels the running evaluation, and requests another one.
    fn cancel(&mut self) {
        if let Some(running) = &self.running {
            running.cancel.cancel();
            self.requested.get_or_insert_default();
        }
    }

    /// Reads and checks the graph. Shows its errors at once, unless the file may still be incomplete.
    fn check_graph(&mut self) {
        return_to(&self.start_folder);
        let CheckedGraph { graph, partial, diagnostics, files, subgraphs } = self
            .command
            .evaluation
            .graph
            .load(&self.command.graph, self.catalog)
            .without_missing_files();
        let readable = !diagnostics
            .iter()
            .any(|diagnostic| diagnostic.code == code::SYNTAX || diagnostic.source.text.is_empty());
        if readable {
            self.files = files;
            self.subgraphs = subgraphs;
            self.has_outside_files = reads_outside(&diagnostics);
        } else {
            // Watch new used graphs even if they have errors, because they may be incomplete. Then their next save is noticed.
            let new = subgraphs.into_iter().filter(|path| !self.subgraphs.contains(path));
            let new = Vec::from_iter(new);
            self.subgraphs.extend(new);
        }
        let is_whole = graph.is_some();
        self.check = match graph.or(partial) {
            Some(graph) => {
                if is_whole || !self.was_complete {
                    self.view.show_graph(&graph);
                    self.shown_graph = Some(graph.topology().identity);
                }
                self.was_complete |= is_whole;
                self.view.show_check(self.runs + 1, &diagnostics);
                Check::Good { graph: Arc::new(graph), diagnostics }
            }
            None => Check::Bad { diagnostics, shown: false },
        };
        self.rewatch();
        if readable {
            self.show_errors();
        }
    }

    fn show_errors(&mut self) {
        if let Check::Bad { diagnostics, shown: shown @ false } = &mut self.check {
            *shown = true;
            self.view.show_check(self.runs + 1, diagnostics);
            // Request a run even if the user only undoes a change that caused errors, so that these errors disappear from the display.
            self.requested.get_or_insert_default();
        }
    }

    /// Requests a run after complete changes. If the graph has errors, reports these instead.
    fn apply_changes(&mut self, changed: Vec<PathBuf>) {
        if matches!(self.check, Check::Due) {
            self.check_graph();
        }
        self.report_watch_list();
        self.show_errors();
        match &self.check {
            Check::Good { .. } => {
                self.requested.get_or_insert_default().extend(changed);
                self.start();
            }
            Check::Bad { .. } => {
                self.cancel();
                self.requested = None;
                self.has_unreported_errors = true;
                self.end_broken();
            }
            Check::Due => {}
        }
    }

    /// Reports the end of a run whose graph has errors, after some time without changes.
    fn end_broken(&mut self) {
        if !self.has_unreported_errors
            || self.series.outputs_due().is_some_and(|due| Instant::now() < due)
        {
            return;
        }
        self.has_unreported_errors = false;
        if let Check::Bad { diagnostics, .. } = &self.check {
            self.runs += 1;
            self.view.show_broken(self.runs, diagnostics);
            self.has_failed = true;
            self.command_time = None;
            self.series.end();
        }
    }

    /// Starts the requested run, if nothing is running and no change is in progress. If no run is requested, evaluates the values for live
    /// pages with the last graph that could run. During a drag, only the values of the drag are evaluated.
    fn start(&mut self) {
        if self.running.is_some() || self.batch.due().is_some() {
            return;
        }
        if self.drag.is_active() {
            return self.start_drag();
        }
        if let Check::Good { graph, diagnostics } = &self.check
            && let Some(changed) = self.requested.take()
        {
            let (graph, diagnostics) = (graph.clone(), diagnostics.clone());
            self.runs += 1;
            self.view.show_begin(self.runs, &changed);
            if !(self.was_complete && is_partial(&diagnostics)) {
                self.last_good = Some((self.runs, graph.clone()));
            }
            self.has_unreported_errors = false;
            self.worker.write_delay.set(self.series.outputs_due());
            let recompute = std::mem::take(&mut self.recompute);
            self.start_job(self.runs, graph, diagnostics, recompute, Purpose::Outputs);
        } else if self.has_due_views
            && let Some((run, graph)) = self.last_good.clone()
        {
            self.start_job(run, graph, Vec::new(), false, Purpose::View);
        }
    }

    /// Starts an evaluation in the worker thread.
    fn start_job(
        &mut self,
        run: usize,
        graph: Arc<Graph>,
        diagnostics: Vec<Diagnostic>,
        recompute: bool,
        purpose: Purpose,
    ) {
        let cancel = CancelToken::default();
        let is_part = is_partial(&diagnostics);
        let (of, stop) = (graph.clone(), cancel.clone());
        self.running = Some(Running { graph: of, cancel: stop, purpose, is_partial: is_part });
        self.has_due_views = false;
        let views = self.views.clone();
        self.worker.start(Job { run, graph, diagnostics, cancel, recompute, purpose, views });
    }

    /// Returns true if live pages already show a graph with the same nodes and links, including the elements of each loop.
    fn is_shown(&self, graph: &Graph) -> bool {
        self.shown_graph == Some(graph.topology().identity)
    }

    /// Shows values on live pages before the rest of the run is done.
    fn show_values(&mut self, update: ViewUpdate) {
        let Some(running) = self.running.as_ref().filter(|running| !running.is_abandoned()) else {
            return;
        };
        let stays = self.was_complete && running.is_partial;
        if let Some(graph) = update.graph.as_ref().filter(|it| !stays && !self.is_shown(it)) {
            self.view.show_graph(graph);
            self.shown_graph = Some(graph.topology().identity);
        }
        self.view.show_values(update.run, running.purpose == Purpose::Drag, &update.values);
    }

    fn finish_run(&mut self, report: Report) {
        let is_abandoned = self.running.take().is_some_and(|running| running.is_abandoned());
        if report.cancelled || is_abandoned {
            // Evaluate the values for live pages again, except after a drag that has ended: then another evaluation shows the values of the
            // graph file.
            if report.purpose != Purpose::Drag || self.drag.is_active() {
                self.has_due_views = !self.views.is_empty();
            }
            match report.purpose {
                Purpose::Outputs => self.view.show_cancel(report.run),
                Purpose::View | Purpose::Drag => self.view.show_abandon(report.run),
            }
            return;
        }
        match report.purpose {
            Purpose::Outputs => {}
            Purpose::View => return,
            Purpose::Drag => {
                let failed = report.diagnostics.iter().find(|p| p.severity == Severity::Error);
                if failed.is_some() && self.drag.note_refusal() {
                    failed
                        .into_iter()
                        .for_each(|diagnostic| self.view.show_refusal(&diagnostic.message));
                }
                return;
            }
        }
        let failed = has_errors(&report.diagnostics);
        // Check the folder again later only if it is not writable now. If it is writable, the write failed for another reason.
        let folder = report.unwritten.clone().filter(|folder| !is_writable(folder));
        self.failed_folder = folder.map(|folder| (folder, Instant::now() + RETRY_INTERVAL));
        self.view.show_end(&report);
        self.has_failed = failed;
        let due = self.series.command_due().unwrap_or_else(Instant::now);
        self.command_time = (!failed && !self.command.once).then_some(due);
        if self.requested.is_none() && self.batch.due().is_none() {
            self.series.end();
        }
    }

    /// Requests a run as soon as the folder of a failed write is writable. It is checked at regular intervals, because the system reports
    /// no event for this.
    fn retry_writing(&mut self) {
        let now = Instant::now();
        match &mut self.failed_folder {
            Some((folder, due)) if *due <= now => {
                if is_writable(folder) {
                    self.failed_folder = None;
                    self.requested.get_or_insert_default();
                } else {
                    *due = now + RETRY_INTERVAL;
                }
            }
            _ => {}
        }
    }

    /// Returns true if no run is requested or in progress, and no change of files is in progress.
    fn is_idle(&self) -> bool {
        let is_changing = self.batch.due().is_some() || self.has_unreported_errors;
        self.running.is_none() && self.requested.is_none() && !is_changing
    }

    /// Starts the user's command if it is time for it and no newer change is in progress.
    fn start_command(&mut self) {
        let is_due = self.command_time.is_some_and(|due| due <= Instant::now());
        if !is_due || !self.is_idle() {
            return;
        }
        self.command_time = None;
        if let Some(on_done) = &mut self.on_done {
            let sender = self.sender.clone();
            on_done.start(move |message| drop(sender.send(message)));
        }
    }

    /// Starts a run at the request of the user. If `recompute` is true, no cached results are used.
    fn run_again(&mut self, recompute: bool) {
        self.recompute |= recompute;
        self.check = Check::Due;
        self.cancel();
        self.apply_changes(Vec::new());
    }

    /// Ends the watch after its only run (option `--once`).
    fn end_once(mut self) -> Exit {
        if self.has_failed {
            return Exit::Failed;
        }
        let ended = self.on_done.as_ref().map(OnDone::run_and_wait);
        match ended.as_ref().and_then(CommandResult::failure) {
            None => Exit::Done,
            Some(why) => {
                self.view.show_command_failure(&why);
                Exit::Failed
            }
        }
    }

    /// Ends the watch. The running evaluation gets some time to stop, so that it leaves no incomplete files.
    fn stop(mut self, receiver: &Receiver<Message>) -> Exit {
        self.cancel();
        let end = Instant::now() + STOP_TIMEOUT;
        while self.running.is_some() {
            match receiver.recv_timeout(end.saturating_duration_since(Instant::now())) {
                Ok(Message::Evaluation(WorkerEvent::Report(_))) => self.running = None,
                Ok(Message::Input(Input::Stop)) | Err(_) => break,
                Ok(_) => {}
            }
        }
        Exit::Done
    }
}
