//! The remote cache with the results of one build of the program.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock};
use std::time::Instant;

use super::address::Address;
use super::client::{Answer, Client, Reply};
use super::uploads::{Upload, Uploads};

/// Maximum time in seconds by which the time spent waiting for the server may exceed the computing time that its files have saved. Beyond
/// this limit, the server is not used again.
pub(crate) const MAX_DEFICIT: f64 = 0.5;

/// The remote cache with the results of one build of the program.
pub struct Remote {
    server: Arc<Server>,
    uploads: Uploads,
}

/// Numbers of requests to a server, by result.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RequestCounts {
    /// Number of downloaded files.
    pub found: usize,
    /// Number of files that the server did not have.
    pub missing: usize,
    /// Number of downloaded files with a wrong checksum or invalid content.
    pub damaged: usize,
    /// Number of uploaded files, including those that the server already had.
    pub sent: usize,
    /// Number of files that were not uploaded, because the server rejected them or the upload would have taken too long.
    pub unsent: usize,
}

pub(crate) struct Server {
    pub(crate) client: Client,
    pub(crate) address: Address,
    /// The name of the folder on the server that contains the files of this build.
    pub(crate) folder: String,
    /// True if the server must not be used again, because it failed or was too slow.
    pub(crate) is_abandoned: AtomicBool,
    /// True if no more files are uploaded, because the server does not accept files.
    pub(crate) is_full: AtomicBool,
    /// The first problem with the server, for a message. Later problems are not stored.
    pub(crate) problem: OnceLock<String>,
    pub(crate) account: Mutex<TimeAccount>,
    pub(crate) counts: Counts,
}

#[derive(Default)]
pub(crate) struct Counts {
    found: AtomicUsize,
    missing: AtomicUsize,
    damaged: AtomicUsize,
    sent: AtomicUsize,
    pub unsent: AtomicUsize,
}

/// The time spent waiting for responses, and the computing time that downloads have saved, both in seconds. Time in which several threads
/// wait counts only once.
#[derive(Default)]
pub(crate) struct TimeAccount {
    waiting: usize,
    since: Option<Instant>,
    waited: f64,
    saved: f64,
}

impl Remote {
    /// Creates the remote cache with the results of one build of the program. `fingerprint` identifies the build.
    pub fn new(address: Address, fingerprint: &str) -> Self {
        let server = Arc::new(Server {
            client: Client::new(address.clone()),
            folder: fingerprint.to_owned(),
            address,
            is_abandoned: AtomicBool::new(false),
            is_full: AtomicBool::new(false),
            problem: OnceLock::new(),
            account: Mutex::default(),
            counts: Counts::default(),
        });
        Self { uploads: Uploads::new(server.clone()), server }
    }

    /// Downloads the file with the name of `path`, and decodes it with `decode`. The limits are `max_bytes` bytes and `max_seconds`
    /// seconds. Returns `None` if the download or the decoding fails.
    pub fn get<T>(
        &self,
        path: &Path,
        max_bytes: u64,
        max_seconds: f64,
        decode: impl FnOnce(Vec<u8>) -> Option<T>,
    ) -> Option<T> {
        let server = &*self.server;
        let remote_name =
            server.name(path).filter(|_| !server.is_abandoned.load(Ordering::Relaxed))?;
        server.begin_wait();
        let answer = server.client.get(&remote_name, max_bytes, max_seconds);
        server.end_wait();
        match answer {
            Answer::Found(bytes) => {
                let found = decode(bytes);
                let counts = &server.counts;
                count(if found.is_some() { &counts.found } else { &counts.damaged });
                if found.is_none() {
                    server.report("a file differs from what was uploaded".into());
                }
                found
            }
            Answer::Missing => {
                count(&server.counts.missing);
                None
            }
            Answer::Failed(why) => {
                server.abandon(why);
                None
            }
        }
    }

    /// Records that a download has saved computing time, in seconds.
    pub fn record_saved_time(&self, seconds: f64) {
        lock(&self.server.account).saved += seconds;
    }

    /// Queues an upload. Set `is_new` for a new result. Otherwise the file is uploaded only if the server does not have it.
    pub fn put(&self, path: PathBuf, is_new: bool) {
        self.uploads.send(Upload { path, is_new });
    }

    /// Waits for the uploads in the queue for a limited time, then drops the rest.
    pub fn finish(&self) {
        self.uploads.finish();
    }

    /// Returns the first problem with the server. `None` if there was no problem.
    pub fn problem(&self) -> Option<&str> {
        self.server.problem.get().map(String::as_str)
    }

    /// Returns the numbers of requests so far.
    pub fn request_counts(&self) -> RequestCounts {
        let Counts { found, missing, damaged, sent, unsent } = &self.server.counts;
        let [found, missing, damaged, sent, unsent] =
            [found, missing, damaged, sent, unsent].map(|count| count.load(Ordering::Relaxed));
        RequestCounts { found, missing, damaged, sent, unsent }
    }
}

/// Checks that the server at an address responds.
pub fn check_server(address: &Address) -> Result<(), String> {
    Client::new(address.clone()).check()
}

impl Server {
    /// Returns the name that the file at a local path has on the server.
    pub(crate) fn name(&self, path: &Path) -> Option<String> {
        Some(format!("{}/{}", self.folder, path.file_name()?.to_str()?))
    }

    /// Uploads a file. Stops if `cancelled` returns true.
    pub(crate) fn upload(&self, upload: &Upload, cancelled: impl Fn() -> bool) {
        let taken = self.try_upload(upload, cancelled);
        count(if taken { &self.counts.sent } else { &self.counts.unsent });
    }

    pub(crate) fn try_upload(
        &self,
        Upload { path, is_new }: &Upload,
        cancelled: impl Fn() -> bool,
    ) -> bool {
        let is_over =
            self.is_abandoned.load(Ordering::Relaxed) || self.is_full.load(Ordering::Relaxed);
        if is_over || cancelled() {
            return false;
        }
        let opened = std::fs::File::open(path).and_then(|file| Ok((file.metadata()?.len(), file)));
        // Opening the file fails if the cache on disk was cleared after the upload was queued.
        let (Ok((length, file)), Some(name)) = (opened, self.name(path)) else { return false };
        if !is_new {
            match self.client.head(&name) {
                Ok(there) if there == Some(length) => return true,
                Ok(_) => {}
                Err(why) => {
                    self.abandon(why);
                    return false;
                }
            }
        }
        let reply = self.client.put(
            &name,
            length,
            super::uploads::CancellableFile { file, cancelled: &cancelled },
        );
        match reply {
            Reply::Stored => return true,
            Reply::TooLarge => self.report(format!("it accepts no file of {length} bytes")),
            Reply::Refused(why) => {
                self.is_full.store(true, Ordering::Relaxed);
                self.report(format!("it accepts no results: {why}"));
            }
            Reply::Failed(_) if cancelled() => {}
            Reply::Failed(why) => self.abandon(why),
        }
        false
    }

    /// Stops using the server, and stores the reason as its problem.
    pub(crate) fn abandon(&self, why: String) {
        self.is_abandoned.store(true, Ordering::Relaxed);
        self.report(format!("{why}; it is not used any more"));
    }

    pub(crate) fn report(&self, trouble: String) {
        let _ = self.problem.set(format!("the server of results {}: {trouble}", self.address));
    }

    pub(crate) fn begin_wait(&self) {
        let account = &mut *lock(&self.account);
        account.waiting += 1;
        account.since.get_or_insert_with(Instant::now);
    }

    pub(crate) fn end_wait(&self) {
        let account = &mut *lock(&self.account);
        account.waiting -= 1;
        if account.waiting == 0
            && let Some(since) = account.since.take()
        {
            account.waited += since.elapsed().as_secs_f64();
        }
        if account.saved + MAX_DEFICIT < account.waited {
            self.abandon("it has cost more time than it saved".into());
        }
    }
}

pub(crate) fn count(count: &AtomicUsize) {
    count.fetch_add(1, Ordering::Relaxed);
}

/// Locks a mutex even if a thread has panicked while holding the lock. This is safe, because all changes leave the guarded data consistent.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(|broken| broken.into_inner())
}
