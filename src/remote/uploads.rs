//! Uploads files to the remote cache in the background.

use std::fs::File;
use std::io::{self, Read};
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::sync::{Arc, Condvar, Mutex};
use std::time::{Duration, Instant};

use super::remote::{Server, count, lock};

/// A file in the queue of uploads. Only its path is stored, so a long queue needs little memory.
pub(super) struct Upload {
    pub(super) path: PathBuf,
    /// True if this program has just written the file. False if it was in the cache on disk before.
    pub(super) is_new: bool,
}

/// Maximum number of files in the queue. Further files are not uploaded.
const QUEUE: usize = 4096;

/// Maximum time that the program waits for uploads before it exits.
const FINISH_TIMEOUT: Duration = Duration::from_secs(1);

pub(super) struct Uploads {
    server: Arc<Server>,
    queue: Arc<Queue>,
    sender: Mutex<Option<SyncSender<(u64, Upload)>>>,
}

#[derive(Default)]
struct Queue {
    /// Number of files that are queued or being uploaded.
    waiting: Mutex<usize>,
    changed: Condvar,
    /// Number of times that the queue was dropped. A file is not uploaded if the queue was dropped after the file had been queued.
    dropped: AtomicU64,
}

impl Queue {
    fn is_dropped(&self, time: u64) -> bool {
        self.dropped.load(Ordering::Relaxed) != time
    }

    /// Records that a file has left the queue. `time` is the value of `dropped` at the time when the file was queued.
    fn leave(&self, time: u64) {
        let mut waiting = lock(&self.waiting);
        if !self.is_dropped(time) {
            *waiting -= 1;
            self.changed.notify_all();
        }
    }
}

impl Uploads {
    pub(super) fn new(server: Arc<Server>) -> Self {
        Self { server, queue: Arc::default(), sender: Mutex::default() }
    }

    pub(super) fn send(&self, upload: Upload) {
        let mut sender = lock(&self.sender);
        let sender = sender.get_or_insert_with(|| {
            let (sender, receiver) = sync_channel::<(u64, Upload)>(QUEUE);
            let (server, queue) = (self.server.clone(), self.queue.clone());
            std::thread::spawn(move || {
                for (time, upload) in receiver {
                    server.upload(&upload, || queue.is_dropped(time));
                    queue.leave(time);
                }
            });
            sender
        });
        let time = {
            let mut waiting = lock(&self.queue.waiting);
            *waiting += 1;
            self.queue.dropped.load(Ordering::Relaxed)
        };
        if sender.try_send((time, upload)).is_err() {
            self.queue.leave(time);
            count(&self.server.counts.unsent);
        }
    }

    /// Waits for uploads for at most [`FINISH_TIMEOUT`], then drops the rest of the queue.
    pub(super) fn finish(&self) {
        let end = Instant::now() + FINISH_TIMEOUT;
        let mut waiting = lock(&self.queue.waiting);
        while 0 < *waiting {
            let left = end.saturating_duration_since(Instant::now());
            if left.is_zero() {
                let files = std::mem::take(&mut *waiting);
                self.queue.dropped.fetch_add(1, Ordering::Relaxed);
                return self
                    .server
                    .report(format!("it is too slow: the last {files} files are not uploaded"));
            }
            let woken = self.queue.changed.wait_timeout(waiting, left);
            waiting = woken.unwrap_or_else(|broken| broken.into_inner()).0;
        }
    }
}

/// Drops the queue without waiting for the current upload. The thread then ends by itself.
impl Drop for Uploads {
    fn drop(&mut self) {
        self.queue.dropped.fetch_add(1, Ordering::Relaxed);
    }
}

/// An opened file to upload. Reading it fails as soon as `cancelled` returns true.
pub(super) struct CancellableFile<'a> {
    pub(super) file: File,
    pub(super) cancelled: &'a dyn Fn() -> bool,
}

impl Read for CancellableFile<'_> {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        match (self.cancelled)() {
            true => Err(io::Error::other("the upload was cancelled")),
            false => self.file.read(into),
        }
    }
}
