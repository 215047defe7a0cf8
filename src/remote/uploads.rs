//! What is sent to a server, by a thread that nobody waits for longer than a moment.

use std::fs::File;
use std::io::{self, Read};
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::sync::{Arc, Condvar, Mutex};
use std::time::{Duration, Instant};

use super::remote::{Server, count, lock};

/// A file to send: its name alone, so that what waits needs no memory.
pub(super) struct Upload {
    pub(super) path: PathBuf,
    /// Whether it was not on disk before.
    pub(super) is_new: bool,
}

/// Files that may wait; what comes then is not sent.
const QUEUE: usize = 4096;

/// How long the end of a run waits for what is not sent yet.
const LAST_WAIT: Duration = Duration::from_secs(1);

pub(super) struct Uploads {
    server: Arc<Server>,
    queue: Arc<Queue>,
    sender: Mutex<Option<SyncSender<(u64, Upload)>>>,
}

#[derive(Default)]
struct Queue {
    /// How many files wait or are being sent.
    waiting: Mutex<usize>,
    is_less: Condvar,
    /// How often what waited was dropped: what came before is not sent any more.
    dropped: AtomicU64,
}

impl Queue {
    fn is_dropped(&self, time: u64) -> bool {
        self.dropped.load(Ordering::Relaxed) != time
    }

    /// Takes notice that a file which came at this time does not wait any more.
    fn leave(&self, time: u64) {
        let mut waiting = lock(&self.waiting);
        if !self.is_dropped(time) {
            *waiting -= 1;
            self.is_less.notify_all();
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
                    server.take(&upload, || queue.is_dropped(time));
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

    /// Waits a moment for what is not sent yet, and drops the rest.
    pub(super) fn finish(&self) {
        let end = Instant::now() + LAST_WAIT;
        let mut waiting = lock(&self.queue.waiting);
        while 0 < *waiting {
            let left = end.saturating_duration_since(Instant::now());
            if left.is_zero() {
                let files = std::mem::take(&mut *waiting);
                self.queue.dropped.fetch_add(1, Ordering::Relaxed);
                return self.server.tell(format!(
                    "it is too slow for the last {files} files, which it does not get"
                ));
            }
            let woken = self.queue.is_less.wait_timeout(waiting, left);
            waiting = woken.unwrap_or_else(|broken| broken.into_inner()).0;
        }
    }
}

/// The thread ends by itself: what it is sending is not waited for.
impl Drop for Uploads {
    fn drop(&mut self) {
        self.queue.dropped.fetch_add(1, Ordering::Relaxed);
    }
}

/// A file that is read as long as it is wanted.
pub(super) struct Until<'a> {
    pub(super) file: File,
    pub(super) cancelled: &'a dyn Fn() -> bool,
}

impl Read for Until<'_> {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        match (self.cancelled)() {
            true => Err(io::Error::other("it is not wanted any more")),
            false => self.file.read(into),
        }
    }
}
