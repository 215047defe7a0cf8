//! The files that a watch depends on: which of them hold something else, and which are watched from now on.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::time::Instant;

use super::Session;
use super::state::{Check, Running};
use crate::listen::Event;

impl Session<'_> {
    /// Finds out which files have another content now, and reacts to it.
    pub(super) fn files_touched(&mut self, events: &[Event]) {
        let (mut files, mut moved) = (BTreeSet::new(), false);
        for event in events {
            let mut touched = self.sources.touched(event);
            match event {
                Event::Growing(_) => {
                    touched.drain(..).for_each(|file| self.series.grows(&file, Instant::now()));
                }
                Event::Touched(_) => touched.retain(|file| !self.series.is_open(file)),
                Event::Closed(_) => touched.iter().for_each(|file| self.series.closed(file)),
                Event::Moved(_) | Event::Lost => {
                    moved |= !touched.is_empty();
                    touched.iter().for_each(|file| self.series.closed(file));
                }
            }
            files.extend(touched);
        }
        self.files_changed(&files, moved);
    }

    /// Reads files again, and reacts if they hold something else, or were moved.
    pub(super) fn files_changed(&mut self, files: &BTreeSet<PathBuf>, moved: bool) {
        let mut changed = false;
        for file in files {
            changed |= self.reread(file);
        }
        if changed || moved {
            self.rewatch();
        }
    }

    /// Reads a file again; whether it holds something else now.
    pub(super) fn reread(&mut self, file: &Path) -> bool {
        let Some(shape) = self.contents.refresh(file) else { return false };
        let now = Instant::now();
        self.batch.changed(file, shape, now);
        self.series.changed(now);
        if self.command_due.is_some() {
            self.command_due = self.series.command_due();
        }
        self.changed(file, shape.is_whole());
        true
    }

    /// A file holds something else.
    fn changed(&mut self, file: &Path, whole: bool) {
        let is_graph = self.sources.paths().next() == Some(file);
        if is_graph && whole {
            self.check_graph();
        } else {
            self.check = Check::Due;
        }
        if is_graph && whole {
            self.end_drag();
        }
        fn means_the_same(running: &Running, is_graph: bool, check: &Check) -> bool {
            match check {
                Check::Good { graph, .. } => is_graph && graph.means_the_same(&running.graph),
                Check::Due | Check::Bad { .. } => false,
            }
        }
        // What may be half a file stops nothing yet.
        if whole
            && self
                .running
                .as_ref()
                .is_some_and(|running| !means_the_same(running, is_graph, &self.check))
        {
            self.cancel();
        }
    }

    /// Watches what the outcome depends on now.
    pub(super) fn rewatch(&mut self) {
        let (command, outside) = (self.command, self.outside);
        let (files, subgraphs, catalog) = (&self.files, &self.subgraphs, self.catalog);
        let here = &self.here;
        for file in
            self.sources.update(|| command.watch_list(here, files, subgraphs, outside, catalog))
        {
            self.reread(&file);
        }
        self.contents.keep(self.sources.paths());
        self.series.is_polled = self.sources.polled().is_some();
    }

    /// Says what is watched, if it is something else than before.
    pub(super) fn tell_watched(&mut self) {
        let now: Vec<PathBuf> = self.sources.paths().map(Path::to_owned).collect();
        let polled = self.sources.polled().map(str::to_owned);
        if !self.command.once && self.told.as_ref() != Some(&(now.clone(), polled.clone())) {
            self.view.watching(&now, polled.as_deref());
            self.told = Some((now, polled));
        }
    }
}
