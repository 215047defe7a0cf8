//! What pages want of a watch: values in the graph's file, and drags, which leave it alone.

use std::ops::Range;
use std::sync::Arc;
use std::time::Instant;

use maquette_edit::{Edit, Edited, Put};
use maquette_graph::{Checked, Graph};
use maquette_syntax::error::Severity;
use maquette_value::Hash;
use maquette_value::plain;

use super::Session;
use crate::edit::GraphFile;
use crate::watch::Watch;
use crate::watch::drag::Values;
use crate::watch::worker::Purpose;

impl<'a> Session<'a> {
    /// Puts values into the file of the graph. Its change is noticed like one of anybody else.
    pub(super) fn set(&mut self, page: u64, values: &Values) {
        let was_dragged = self.drag.let_go(page);
        match self.edit(values, |_| true) {
            Ok(change) if !change.puts.is_empty() => {
                // The run that follows shows all: until then nothing of the old file comes back.
                self.look = false;
                return self.changes.push(change);
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
        if self.drag.is_on()
            && self.running.as_ref().is_some_and(|running| running.purpose == Purpose::Outputs)
        {
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

    /// Takes the last change back, if nobody has changed since what it changed.
    pub(super) fn undo(&mut self) {
        let Some(change) = self.changes.pop() else { return };
        if let Err(why) = self.take_back(&change) {
            self.view.refused(&why);
        }
    }

    fn take_back(&self, change: &Change) -> Result<(), String> {
        let turn = self.file().turn().map_err(|error| error.to_string())?;
        let text = self.file().text().map_err(|error| error.to_string())?;
        if let Some(before) = change.taken_back(&text) {
            let edited = Edited { text: before, before: text, changes: Vec::new() };
            return self.file().write(&edited).map_err(|error| error.to_string());
        }
        drop(turn);
        // The rest of the file is another one now: only values can be put back.
        fn old(put: &Put) -> Result<(String, String), &str> {
            let before = put.before.clone().ok_or("it was not in the file before")?;
            match put.after.starts_with(&format!("Draft(final: {before}, draft: ")) {
                true => Err("it was no `Draft` before"),
                false => Ok((put.target.clone(), before)),
            }
        }
        let back: Result<Vec<_>, _> = change.puts.iter().map(old).collect();
        let back = back.map_err(|why| {
            format!("{why}, and the file has been changed since: take it out there")
        })?;
        self.edit(&back, |now| {
            now.iter().zip(&change.puts).all(|(now, put)| now.before.as_ref() == Some(&put.after))
        })
        .map(drop)
    }

    /// Puts values into the file of the graph, if what would be changed is as it should be. Gives what was changed, or says why not.
    fn edit(
        &self,
        values: &[(String, String)],
        is_due: impl Fn(&[Put]) -> bool,
    ) -> Result<Change, String> {
        let _turn = self.file().turn().map_err(|error| error.to_string())?;
        let edited = self.edited(values)?;
        if !is_due(&edited.changes) {
            return Err("somebody has changed it since".into());
        }
        self.file().write(&edited).map_err(|error| error.to_string())?;
        Ok(Change::of(edited))
    }

    /// The text of the graph's file with these values in it, or why they cannot be.
    fn edited(&self, values: &[(String, String)]) -> Result<Edited, String> {
        let edits: Vec<_> = values
            .iter()
            .cloned()
            .map(|(target, value): (String, String)| Edit::Set { target, value })
            .collect();
        self.file().edited(&edits, self.catalog).map_err(|error| error.to_string())
    }

    fn file(&self) -> GraphFile<'a> {
        let Watch { graph, options, .. } = self.command;
        GraphFile { graph, roots: &options.roots, draft: options.draft, dry_run: false }
    }
}

/// What was put into the graph's file, and how it is taken back.
pub(super) struct Change {
    puts: Vec<Put>,
    /// Where the text differs, and what stood there before.
    at: Range<usize>,
    before: String,
    /// The text with it.
    text: Hash,
}

impl Change {
    fn of(edited: Edited) -> Self {
        let Edited { text, before, changes } = edited;
        fn alike((a, b): &(char, char)) -> bool {
            a == b
        }
        let length = |(a, _): (char, char)| a.len_utf8();
        let start = before.chars().zip(text.chars()).take_while(alike).map(length).sum();
        let rest = before[start..].chars().rev().zip(text[start..].chars().rev());
        let end: usize = rest.take_while(alike).map(length).sum();
        let puts = changes.into_iter().filter(|put| put.before.as_ref() != Some(&put.after));
        Self {
            puts: puts.collect(),
            at: start..text.len() - end,
            before: before[start..before.len() - end].to_owned(),
            text: Hash::of(text.as_bytes()),
        }
    }

    /// The text without it, if it is as it was left.
    fn taken_back(&self, text: &str) -> Option<String> {
        let is_same = Hash::of(text.as_bytes()) == self.text;
        is_same.then(|| [&text[..self.at.start], &self.before, &text[self.at.end..]].concat())
    }
}
