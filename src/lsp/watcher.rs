//! Polls the files on which open documents depend, because few editors report changes outside of their folders and some report none.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::time::Duration;

use crossbeam_channel::Sender;
use maquette_graph::file_stat::FileStat;

/// An event that does not come as a message of the editor.
pub(super) enum Event {
    /// The process of the editor has ended.
    EditorEnded,
    /// A file on which an open document depends has changed.
    FilesChanged,
}

/// The interval at which the files are polled.
const INTERVAL: Duration = Duration::from_millis(700);

/// The metadata of each polled file, which changes when the file changes. `None` if the file does not exist.
type FileStamps = Mutex<BTreeMap<PathBuf, Option<FileStat>>>;

/// A thread that polls files until this value is dropped.
pub(super) struct Watcher {
    stamps: Arc<FileStamps>,
}

impl Watcher {
    /// Starts a thread that sends an event whenever a polled file has changed.
    pub(super) fn start(events: Sender<Event>) -> Self {
        let stamps = Arc::<FileStamps>::default();
        let weak = Arc::downgrade(&stamps);
        std::thread::spawn(move || poll(&weak, &events));
        Self { stamps }
    }

    /// Replaces the list of files that are polled.
    pub(super) fn watch(&self, files: BTreeSet<PathBuf>) {
        let mut stamps = lock(&self.stamps);
        let mut before = std::mem::take(&mut *stamps);
        for file in files {
            let stamp = before.remove(&file).unwrap_or_else(|| FileStat::read(&file));
            stamps.insert(file, stamp);
        }
    }
}

fn poll(stamps: &Weak<FileStamps>, events: &Sender<Event>) {
    loop {
        std::thread::sleep(INTERVAL);
        let Some(stamps) = stamps.upgrade() else { return };
        // Clone the list, so that the lock is not held while a slow disk is read.
        let known = lock(&stamps).clone();
        let mut has_changed = false;
        for (file, before) in known {
            let now = FileStat::read(&file);
            if now != before {
                has_changed = true;
                if let Some(stamp) = lock(&stamps).get_mut(&file) {
                    *stamp = now;
                }
            }
        }
        if has_changed && events.send(Event::FilesChanged).is_err() {
            return;
        }
    }
}

fn lock(stamps: &FileStamps) -> MutexGuard<'_, BTreeMap<PathBuf, Option<FileStat>>> {
    stamps.lock().unwrap_or_else(PoisonError::into_inner)
}
