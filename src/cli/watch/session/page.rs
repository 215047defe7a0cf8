//! Handles the requests of live pages: setting values in the graph file, and drags, which do not change the file.

use std::ops::Range;
use std::sync::Arc;
use std::time::Instant;

use maquette_edit::{Edit, EditedText, ValueChange};
use maquette_graph::{CheckedGraph, Graph};
use maquette_syntax::error::Severity;
use maquette_value::Hash;
use maquette_value::fs;

use super::Session;
use crate::edit::graph_file::GraphFile;
use crate::watch::Watch;
use crate::watch::drag::Values;
use crate::watch::worker::Purpose;

impl<'a> Session<'a> {
    /// Sets values in the graph file, at the request of a live page. The watch notices this change like any other change of the file.
    pub(super) fn set(&mut self, page: u64, values: &Values) {
        let was_dragged = self.drag.release(page);
        match self.edit(values, |_| true) {
            Ok(change) if !change.value_changes.is_empty() => {
                // Skip the evaluation for live pages that is due: the change of the file starts a run, which shows all new values.
                self.has_due_views = false;
                return self.changes.push(change);
            }
            Ok(_) => {}
            Err(why) => self.view.show_refusal(&why),
        }
        if was_dragged {
            self.show_file();
        }
    }

    /// Shows the values of the graph file again, after a drag.
    pub(super) fn show_file(&mut self) {
        self.abandon_view();
        self.has_due_views = true;
    }

    /// Records new values of a drag.
    pub(super) fn drag_to(&mut self, page: u64, values: Values) {
        self.drag.move_to(page, values, Instant::now());
        // Cancel a run that writes outputs, because it would delay the drag. The outputs are written after the drag.
        if self.drag.is_active()
            && self.running.as_ref().is_some_and(|running| running.purpose == Purpose::Outputs)
        {
            self.cancel();
        }
    }

    /// Returns the time at which the running evaluation is to be cancelled because the drag has newer values.
    pub(super) fn abandon_at(&self) -> Option<Instant> {
        let running = self.running.as_ref()?;
        self.drag.abandon_at().filter(|_| !running.cancel.is_cancelled())
    }

    /// Cancels the running evaluation if it is only for live pages and writes no outputs.
    pub(super) fn abandon_view(&mut self) {
        let running = self.running.as_ref();
        if let Some(running) = running.filter(|running| running.purpose != Purpose::Outputs) {
            running.cancel.cancel();
        }
    }

    /// Starts an evaluation of the newest values of the drag, unless they have already been evaluated.
    pub(super) fn start_drag(&mut self) {
        if std::mem::take(&mut self.has_due_views) {
            self.drag.mark_due();
        }
        let Some(values) = self.drag.take() else { return };
        match self.graph_with(&values) {
            Ok((graph, before)) => {
                self.drag.accept_text(before);
                let run = self.last_good.as_ref().map_or(self.runs, |(run, _)| *run);
                self.start_job(run, Arc::new(graph), Vec::new(), false, Purpose::Drag);
            }
            Err(why) if self.drag.note_refusal() => self.view.show_refusal(&why),
            Err(_) => {}
        }
    }

    /// Returns the graph with the given values, and the present text of the graph file.
    fn graph_with(&self, values: &Values) -> Result<(Graph, String), String> {
        let Watch { graph: path, evaluation, .. } = self.command;
        let edited = self.compute_edit(values)?;
        let options = evaluation.graph.to_options().with_text(path, edited.text);
        let CheckedGraph { graph, diagnostics, .. } =
            Graph::load(path, self.catalog, &options).without_unknown_nodes();
        let wrong =
            diagnostics.into_iter().find(|diagnostic| diagnostic.severity == Severity::Error);
        graph
            .map(|graph| (graph, edited.before))
            .ok_or_else(|| wrong.map_or_else(String::new, |diagnostic| diagnostic.message))
    }

    /// Ends a drag if the graph file has changed.
    pub(super) fn end_drag(&mut self) {
        let text = fs::read_text(&self.command.graph).unwrap_or_default();
        if self.drag.end_on_change(&text) {
            self.abandon_view();
            self.view
                .show_refusal("the file has been changed meanwhile; its present values are shown");
        }
    }

    /// Undoes the last change by a live page, unless somebody has changed the same values since.
    pub(super) fn undo(&mut self) {
        let Some(change) = self.changes.pop() else { return };
        if let Err(why) = self.undo_change(&change) {
            self.view.show_refusal(&why);
        }
    }

    fn undo_change(&self, change: &Change) -> Result<(), String> {
        let turn = self.file().acquire_lock().map_err(|error| error.to_string())?;
        let text = self.file().text().map_err(|error| error.to_string())?;
        if let Some(before) = change.undone_text(&text) {
            let edited = EditedText { text: before, before: text, changes: Vec::new() };
            return self.file().write(&edited).map_err(|error| error.to_string());
        }
        drop(turn);
        // Restore only the values, because other parts of the file have changed since.
        fn old_value(put: &ValueChange) -> Result<(String, String), &str> {
            let before = put.before.clone().ok_or("the value was not in the file before")?;
            match put.after.starts_with(&format!("Draft(final: {before}, draft: ")) {
                true => Err("the value was not a `Draft` before"),
                false => Ok((put.target.clone(), before)),
            }
        }
        let back: Result<Vec<_>, _> = change.value_changes.iter().map(old_value).collect();
        let back = back.map_err(|why| {
            format!("{why}, and the file has been changed since; edit the file instead")
        })?;
        self.edit(&back, |now| {
            now.iter()
                .zip(&change.value_changes)
                .all(|(now, put)| now.before.as_ref() == Some(&put.after))
        })
        .map(drop)
    }

    /// Sets values in the graph file, if `is_due` returns true for the changes that this makes. Returns the change, so that it can be
    /// undone, or an error message.
    fn edit(
        &self,
        values: &[(String, String)],
        is_due: impl Fn(&[ValueChange]) -> bool,
    ) -> Result<Change, String> {
        let _turn = self.file().acquire_lock().map_err(|error| error.to_string())?;
        let edited = self.compute_edit(values)?;
        if !is_due(&edited.changes) {
            return Err("another change edited the value since".into());
        }
        self.file().write(&edited).map_err(|error| error.to_string())?;
        Ok(Change::new(edited))
    }

    /// Returns the text of the graph file with the given values, or an error message.
    fn compute_edit(&self, values: &[(String, String)]) -> Result<EditedText, String> {
        let edits: Vec<_> = values
            .iter()
            .cloned()
            .map(|(target, value): (String, String)| Edit::Set { target, value })
            .collect();
        self.file().compute(&edits, self.catalog).map_err(|error| error.to_string())
    }

    fn file(&self) -> GraphFile<'a> {
        let Watch { graph, evaluation, .. } = self.command;
        let options = &evaluation.graph;
        GraphFile { graph, roots: &options.roots, draft: options.draft, dry_run: false }
    }
}

/// A change of the graph file by a live page, which can be undone.
pub(super) struct Change {
    value_changes: Vec<ValueChange>,
    /// The range of the text that the change has replaced.
    range: Range<usize>,
    before: String,
    /// A hash of the whole text after the change, to find out if the text has been changed again.
    text: Hash,
}

impl Change {
    fn new(edited: EditedText) -> Self {
        let EditedText { text, before, changes } = edited;
        fn is_equal_pair((a, b): &(char, char)) -> bool {
            a == b
        }
        fn length((a, _): (char, char)) -> usize {
            a.len_utf8()
        }
        let start = before.chars().zip(text.chars()).take_while(is_equal_pair).map(length).sum();
        let rest = before[start..].chars().rev().zip(text[start..].chars().rev());
        let end: usize = rest.take_while(is_equal_pair).map(length).sum();
        let value_changes =
            changes.into_iter().filter(|put| put.before.as_ref() != Some(&put.after));
        Self {
            value_changes: value_changes.collect(),
            range: start..text.len() - end,
            before: before[start..before.len() - end].to_owned(),
            text: Hash::compute(text.as_bytes()),
        }
    }

    /// Returns the text before the change, or `None` if the text has been changed again.
    fn undone_text(&self, text: &str) -> Option<String> {
        let is_same = Hash::compute(text.as_bytes()) == self.text;
        is_same.then(|| [&text[..self.range.start], &self.before, &text[self.range.end..]].concat())
    }
}
