//! Handles changes of the files on which a watch depends.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::time::Instant;

use super::Session;
use super::state::{Check, Running};
use crate::listen::Event;

impl Session<'_> {
    /// Reads the watched files that the events concern again, except those that are still open for writing.
    pub(super) fn handle_events(&mut self, events: &[Event]) {
        let (mut files, mut moved) = (BTreeSet::new(), false);
        for event in events {
            let mut touched = self.sources.affected_files(event);
            match event {
                Event::Growing(_) => {
                    touched
                        .drain(..)
                        .for_each(|file| self.series.record_growth(&file, Instant::now()));
                }
                Event::Touched(_) => touched.retain(|file| !self.series.is_open(file)),
                Event::Closed(_) => touched.iter().for_each(|file| self.series.record_close(file)),
                Event::Moved(_) | Event::Lost => {
                    moved |= !touched.is_empty();
                    touched.iter().for_each(|file| self.series.record_close(file));
                }
            }
            files.extend(touched);
        }
        self.reread_files(&files, moved);
    }

    /// Reads the given files again. If one has changed or `moved` is true, updates the list of watched files.
    pub(super) fn reread_files(&mut self, files: &BTreeSet<PathBuf>, moved: bool) {
        let mut changed = false;
        for file in files {
            changed |= self.reread_file(file);
        }
        if changed || moved {
            self.rewatch();
        }
    }

    /// Reads a file again. Returns true if its content has changed.
    pub(super) fn reread_file(&mut self, file: &Path) -> bool {
        let Some(shape) = self.contents.refresh(file) else { return false };
        let now = Instant::now();
        self.batch.record_change(file, shape, now);
        self.series.record_change(now);
        if self.command_time.is_some() {
            self.command_time = self.series.command_due();
        }
        self.handle_change(file, shape.is_complete());
        true
    }

    /// Handles a change of a file. `whole` is false if the file may be incomplete.
    fn handle_change(&mut self, file: &Path, whole: bool) {
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
        // Do not cancel the running evaluation while the file is incomplete.
        if whole
            && self
                .running
                .as_ref()
                .is_some_and(|running| !means_the_same(running, is_graph, &self.check))
        {
            self.cancel();
        }
    }

    /// Updates the list of watched files to those on which the result depends now.
    pub(super) fn rewatch(&mut self) {
        let (command, outside) = (self.command, self.has_outside_files);
        let (files, subgraphs, catalog) = (&self.files, &self.subgraphs, self.catalog);
        let here = &self.start_folder;
        for file in
            self.sources.update(|| command.watch_list(here, files, subgraphs, outside, catalog))
        {
            self.reread_file(&file);
        }
        self.contents.keep(self.sources.paths());
        self.series.is_polled = self.sources.polling_reason().is_some();
    }

    /// Reports the list of watched files if it has changed.
    pub(super) fn report_watch_list(&mut self) {
        let now: Vec<PathBuf> = self.sources.paths().map(Path::to_owned).collect();
        let polled = self.sources.polling_reason().map(str::to_owned);
        if !self.command.once
            && self.reported_files.as_ref() != Some(&(now.clone(), polled.clone()))
        {
            self.view.show_watch_list(&now, polled.as_deref());
            self.reported_files = Some((now, polled));
        }
    }
}
