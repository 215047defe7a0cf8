//! Files that open texts depend on, looked at again and again: few editors report changes outside of their folders, and some report none.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::time::Duration;

use crossbeam_channel::Sender;
use maquette_graph::stamp::Stamp;

/// Something that happens outside of the editor's messages.
pub(super) enum Event {
    /// The process of the editor has ended.
    EditorEnded,
    /// A file that an open text depends on has changed.
    FilesChanged,
}

/// How often files are looked at.
const PERIOD: Duration = Duration::from_millis(700);

/// What changes with each file; `None` if there is none.
type Stamps = Mutex<BTreeMap<PathBuf, Option<Stamp>>>;

/// Looks at files until it is dropped.
pub(super) struct Watcher {
    stamps: Arc<Stamps>,
}

impl Watcher {
    /// Sends an event for each look that finds something changed.
    pub(super) fn start(events: Sender<Event>) -> Self {
        let stamps = Arc::<Stamps>::default();
        let weak = Arc::downgrade(&stamps);
        std::thread::spawn(move || look(&weak, &events));
        Self { stamps }
    }

    /// Looks at these files instead of the ones before.
    pub(super) fn watch(&self, files: BTreeSet<PathBuf>) {
        let mut stamps = lock(&self.stamps);
        let mut before = std::mem::take(&mut *stamps);
        for file in files {
            let stamp = before.remove(&file).unwrap_or_else(|| Stamp::of(&file));
            stamps.insert(file, stamp);
        }
    }
}

fn look(stamps: &Weak<Stamps>, events: &Sender<Event>) {
    loop {
        std::thread::sleep(PERIOD);
        let Some(stamps) = stamps.upgrade() else { return };
        // Nothing waits for a slow disk.
        let known = lock(&stamps).clone();
        let mut has_changed = false;
        for (file, before) in known {
            let now = Stamp::of(&file);
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

fn lock(stamps: &Stamps) -> MutexGuard<'_, BTreeMap<PathBuf, Option<Stamp>>> {
    stamps.lock().unwrap_or_else(PoisonError::into_inner)
}
