//! A background thread that writes results to disk while other threads compute.

use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Sender, SyncSender, channel, sync_channel};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;

use maquette_graph::files::KnownFile;
use maquette_value::{AnyValue, Hash};

use super::super::cache::{Outcome, Values};
use super::super::lock;
use super::super::snapshot::Snapshot;
use super::{Store, entry, record};
use crate::writing::bring_to_disk;

/// A task for the writing thread.
pub(super) enum Job {
    /// Write a result. If `trusted` is false, existing files of its columns are overwritten.
    Entry {
        key: Hash,
        /// The type of the node that computed the result.
        node: String,
        outcome: Arc<Outcome>,
        values: Values,
        trusted: bool,
    },
    Record {
        path: PathBuf,
        snapshot: Arc<Snapshot>,
        files: Vec<KnownFile>,
    },
    /// Write a note about output files, after these files are on disk.
    Note {
        path: PathBuf,
        note: Vec<u8>,
        files: Vec<PathBuf>,
    },
    /// Signal the sender: all earlier jobs are finished.
    Done(Sender<()>),
}

/// The maximum number of queued jobs. If the queue is full, sending a job blocks.
const MAX_QUEUED_JOBS: usize = 64;

/// The maximum total size of queued values, in bytes. A job that would exceed it is written by the sending thread itself, so the queue
/// never holds much memory.
const MAX_WAITING_BYTES: usize = 64 << 20;

/// The write error if the bytes of a result no longer match its hash.
const CHANGED: &str = "something wrote into the memory of a result after it was computed";

pub(super) struct Writer {
    store: Arc<Store>,
    waiting: Arc<AtomicUsize>,
    entries: AtomicUsize,
    thread: Mutex<Option<(SyncSender<Job>, JoinHandle<()>)>>,
}

impl Writer {
    pub(super) fn new(store: Arc<Store>) -> Self {
        let (waiting, entries) = (Arc::default(), AtomicUsize::new(0));
        Self { store, waiting, entries, thread: Mutex::default() }
    }

    /// Returns the number of entries that were sent to the writer so far.
    pub(super) fn entries(&self) -> usize {
        self.entries.load(Ordering::Relaxed)
    }

    pub(super) fn send(&self, job: Job) {
        let bytes = job.bytes();
        if let Job::Entry { .. } = job {
            self.entries.fetch_add(1, Ordering::Relaxed);
        }
        if MAX_WAITING_BYTES < self.waiting.fetch_add(bytes, Ordering::Relaxed) + bytes {
            self.waiting.fetch_sub(bytes, Ordering::Relaxed);
            return job.run(&self.store);
        }
        let sender = self.sender();
        // Sending cannot fail: the writing thread ends only after all senders are dropped.
        let _ = sender.send(job);
    }

    /// Waits until all jobs sent so far are finished.
    pub(super) fn wait(&self) {
        if lock(&self.thread).is_some() {
            let (sender, receiver) = channel();
            self.send(Job::Done(sender));
            let _ = receiver.recv();
        }
    }

    fn sender(&self) -> SyncSender<Job> {
        let mut thread = lock(&self.thread);
        let (sender, _) = thread.get_or_insert_with(|| {
            let (sender, receiver) = sync_channel::<Job>(MAX_QUEUED_JOBS);
            let (store, waiting) = (self.store.clone(), self.waiting.clone());
            (
                sender,
                std::thread::spawn(move || {
                    for job in receiver {
                        let bytes = job.bytes();
                        job.run(&store);
                        waiting.fetch_sub(bytes, Ordering::Relaxed);
                    }
                }),
            )
        });
        sender.clone()
    }
}

impl Drop for Writer {
    fn drop(&mut self) {
        if let Some((sender, thread)) = lock(&self.thread).take() {
            drop(sender);
            let _ = thread.join();
        }
    }
}

impl Job {
    fn bytes(&self) -> usize {
        match self {
            Self::Entry { outcome, .. } => outcome.bytes,
            _ => 0,
        }
    }

    pub(super) fn run(self, store: &Store) {
        match self {
            Self::Entry { key, node, outcome, values, trusted } => {
                let kept: Vec<_> = values.iter().map(AnyValue::encode).collect();
                if !kept.iter().all(|kept| kept.is_intact) {
                    return store.stop(CHANGED);
                }
                // Write the columns before the entry that refers to them, so that an entry on disk is complete.
                for column in kept.iter().flat_map(|kept| &kept.columns) {
                    let is_new = store.write_column(&**column, trusted);
                    store.share(|| store.column_path(column.hash()), is_new);
                }
                let bytes = entry::write(key, &node, &outcome, &kept);
                store.write_checked(&store.entry_path(key), &bytes);
                store.share(|| store.entry_path(key), true);
            }
            Self::Record { path, snapshot, files } => {
                store.write_checked(&path, &record::write(&snapshot, &files));
                // A snapshot is the last job of an evaluation, so apply the size limit of the cache now.
                store.tidy();
            }
            Self::Note { path, note, files } => {
                if files.iter().all(|file| bring_to_disk(file).is_ok()) {
                    store.write_checked(&path, &note);
                }
            }
            Self::Done(sender) => drop(sender.send(())),
        }
    }
}
