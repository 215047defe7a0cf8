//! What pages want of a watch: values in the graph's file, and drags, which leave it alone.

use std::sync::Arc;
use std::time::Instant;

use super::{Running, Session};
use crate::cli::edit::GraphFile;
use crate::cli::watch::Watch;
use crate::cli::watch::drag::Values;
use crate::cli::watch::worker::Purpose;
use crate::error::Severity;
use crate::graph::{Checked, Edit, Edited, Graph, Put};
use crate::plain;

impl<'a> Session<'a> {
    /// Puts values into the file of the graph. Its change is noticed like one of anybody else.
    pub(super) fn set(&mut self, page: u64, values: &Values) {
        let was_dragged = self.drag.let_go(page);
        match self.edit(values, |_| true) {
            Ok(changes) if !changes.is_empty() => {
                // The run that follows shows all: until then nothing of the old file comes back.
                self.look = false;
                return self.changes.push(changes);
            }
            Ok(_) => {}
            Err(why) => self.view.refused(&why),
        }
        if was_dragged {
            self.show_file();
        }
    }

    /// Goes back from what was dragged to what the file says.
    pub(super) fn show_file(&mut self) {
        self.leave();
        self.look = true;
    }

    /// A page drags.
    pub(super) fn dragged(&mut self, page: u64, values: Values) {
        self.drag.moved(page, values, Instant::now());
        // Outputs would keep the hand waiting; they are made when it lets go.
        let makes_outputs = |running: &Running| running.purpose == Purpose::Outputs;
        if self.drag.is_on() && self.running.as_ref().is_some_and(makes_outputs) {
            self.cancel();
        }
    }

    /// When the evaluation under way is given up for newer values of a drag.
    pub(super) fn gives_up(&self) -> Option<Instant> {
        let running = self.running.as_ref()?;
        self.drag.gives_up().filter(|_| !running.cancel.is_cancelled())
    }

    /// Gives up what is evaluated only to be looked at.
    pub(super) fn leave(&mut self) {
        let running = self.running.as_ref();
        if let Some(running) = running.filter(|running| running.purpose != Purpose::Outputs) {
            running.cancel.cancel();
        }
    }

    /// Starts the evaluation of the newest values of the drag, if that has to be.
    pub(super) fn start_drag(&mut self) {
        if std::mem::take(&mut self.look) {
            self.drag.again();
        }
        let Some(values) = self.drag.take() else { return };
        match self.graph_with(&values) {
            Ok((graph, before)) => {
                self.drag.fits(before);
                let run = self.good.as_ref().map_or(self.runs, |(run, _)| *run);
                self.give(run, Arc::new(graph), Vec::new(), false, Purpose::Drag);
            }
            Err(why) if self.drag.refused() => self.view.refused(&why),
            Err(_) => {}
        }
    }

    /// The graph as it would be with these values in its file, and the text that is there.
    fn graph_with(&self, values: &Values) -> Result<(Graph, String), String> {
        let Watch { graph: path, options, .. } = self.command;
        let edited = self.edited(values)?;
        let options = options.all().with_text(path, edited.text);
        let Checked { graph, problems, .. } =
            Graph::load(path, self.catalog, &options).as_far_as_known();
        let wrong = problems.into_iter().find(|problem| problem.severity == Severity::Error);
        graph
            .map(|graph| (graph, edited.before))
            .ok_or_else(|| wrong.map_or_else(String::new, |problem| problem.message))
    }

    /// The file of the graph has another content: it wins over what is dragged.
    pub(super) fn end_drag(&mut self) {
        let text = plain::read_text(&self.command.graph).unwrap_or_default();
        if self.drag.ends_by(&text) {
            self.leave();
            self.view.refused("the file has been changed meanwhile: it is shown as it is now");
        }
    }

    /// Puts the values back that the last change has replaced, if nobody has changed them since.
    pub(super) fn undo(&mut self) {
        let Some(changes) = self.changes.pop() else { return };
        let old = |put: &Put| Some((put.target.clone(), put.before.clone()?));
        let stand = |now: &[Put]| {
            now.iter().zip(&changes).all(|(now, put)| stands(put, now.before.as_deref()))
        };
        let back: Option<Vec<_>> = changes.iter().map(old).collect();
        let Some(back) = back else {
            return self.view.refused("it was not in the file before: take it out there");
        };
        if let Err(why) = self.edit(&back, stand) {
            self.view.refused(&why);
        }
    }

    /// Puts values into the file of the graph, if what would be changed is as it should be. Gives what was changed, or says why not.
    fn edit(
        &self,
        values: &[(String, String)],
        is_due: impl Fn(&[Put]) -> bool,
    ) -> Result<Vec<Put>, String> {
        let _turn = self.file().turn().map_err(|error| error.to_string())?;
        let edited = self.edited(values)?;
        let changes = Vec::from_iter(
            edited.changes.iter().filter(|put| put.before.as_ref() != Some(&put.after)).cloned(),
        );
        if !is_due(&edited.changes) {
            return Err("somebody has changed it since".into());
        }
        self.file().write(&edited).map_err(|error| error.to_string())?;
        Ok(changes)
    }

    /// The text of the graph's file with these values in it, or why they cannot be.
    fn edited(&self, values: &[(String, String)]) -> Result<Edited, String> {
        let set = |(target, value): (String, String)| Edit::Set { target, value };
        let edits = Vec::from_iter(values.iter().cloned().map(set));
        self.file().edited(&edits, self.catalog).map_err(|error| error.to_string())
    }

    fn file(&self) -> GraphFile<'a> {
        let Watch { graph, options, .. } = self.command;
        GraphFile { graph, roots: &options.roots, draft: options.draft, dry_run: false }
    }
}

/// Whether a value that was put there is what is there now: of what has become a `Draft` by that, its draft.
fn stands(put: &Put, now: Option<&str>) -> bool {
    let is_draft =
        |before: &String, now: &str| put.after == format!("Draft(final: {before}, draft: {now})");
    now.is_some_and(|now| {
        put.after == now || put.before.as_ref().is_some_and(|it| is_draft(it, now))
    })
}
