//! What a watch makes of events: which files hold something else now, and what that stops.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::time::Instant;

use super::{Check, Running, Session};
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
        let means_the_same = |running: &Running| match &self.check {
            Check::Good { graph, .. } => is_graph && graph.means_the_same(&running.graph),
            Check::Due | Check::Bad { .. } => false,
        };
        // What may be half a file stops nothing yet.
        if whole && self.running.as_ref().is_some_and(|running| !means_the_same(running)) {
            self.cancel();
        }
    }
}

/// Enters a folder again if another one has taken its place, as after a new checkout: relative paths lead to the current one.
#[cfg(unix)]
pub(super) fn return_to(folder: &Path) {
    use std::os::unix::fs::MetadataExt;
    let place = |path: &Path| {
        let metadata = std::fs::metadata(path).ok()?;
        Some((metadata.dev(), metadata.ino()))
    };
    if place(folder) != place(Path::new(".")) {
        // If it is not there either, the graph cannot be read, which is reported.
        let _ = std::env::set_current_dir(folder);
    }
}

/// On other systems nobody can remove the current folder.
#[cfg(not(unix))]
pub(super) fn return_to(_: &Path) {}
