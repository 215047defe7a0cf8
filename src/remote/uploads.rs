//! Uploads files to the remote cache in the background.

use std::fs::File;
use std::io::{self, Read};
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::sync::{Arc, Condvar, Mutex};
use std::time::{Duration, Instant};

use super::remote::{Server, count, lock};

/// A file to upload. The queue contains only paths, so it needs little memory.
pub(super) struct Upload {
    pub(super) path: PathBuf,
    /// True if the file has just been written, false if it was on disk before.
    pub(super) is_new: bool,
}

/// The maximum number of files in the queue. Further files are not uploaded.
const QUEUE: usize = 4096;

/// The maximum time that a run waits for uploads at its end.
const FINISH_TIMEOUT: Duration = Duration::from_secs(1);

pub(super) struct Uploads {
    server: Arc<Server>,
    queue: Arc<Queue>,
    sender: Mutex<Option<SyncSender<(u64, Upload)>>>,
}

#[derive(Default)]
struct Queue {
    /// The number of files that are queued or being uploaded.
    waiting: Mutex<usize>,
    changed: Condvar,
    /// The number of times that the queue was dropped. A file that was queued before the last time is not uploaded.
    dropped: AtomicU64,
}

impl Queue {
    fn is_dropped(&self, time: u64) -> bool {
        self.dropped.load(Ordering::Relaxed) != time
    }

    /// Records that a file is not queued any more. `time` is the value of `dropped` when the file was queued.
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

    /// Waits at most [`FINISH_TIMEOUT`] for uploads. The uploads that have not ended by then are dropped.
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

/// Does not wait for the current upload. The thread ends by itself.
impl Drop for Uploads {
    fn drop(&mut self) {
        self.queue.dropped.fetch_add(1, Ordering::Relaxed);
    }
}

/// A file whose reading can be cancelled.
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
