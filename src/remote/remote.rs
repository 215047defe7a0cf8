//! A server of results, for one build.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock};
use std::time::Instant;

use super::address::Address;
use super::client::{Answer, Client, Reply};
use super::uploads::{Upload, Uploads};

/// How many seconds a server may cost more than it saves.
pub(crate) const CREDIT: f64 = 0.5;

/// A server of results, for one build.
pub struct Remote {
    server: Arc<Server>,
    uploads: Uploads,
}

/// What a server was asked for so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Exchange {
    /// Files that it had.
    pub found: usize,
    /// Files that it did not have.
    pub missing: usize,
    /// Files that were not what they should be.
    pub damaged: usize,
    /// Files that it took.
    pub sent: usize,
    /// Files that were not sent, because it takes none or it would have taken too long.
    pub unsent: usize,
}

pub(crate) struct Server {
    pub(crate) client: Client,
    pub(crate) address: Address,
    /// The folder of this build's files.
    pub(crate) home: String,
    /// It is neither asked nor sent anything any more.
    pub(crate) is_left: AtomicBool,
    /// It is sent nothing any more.
    pub(crate) is_full: AtomicBool,
    /// The first trouble with it, which alone is told.
    pub(crate) trouble: OnceLock<String>,
    pub(crate) account: Mutex<Account>,
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

/// The seconds that are waited for answers, on however many threads at once, and those that need not be computed.
#[derive(Default)]
pub(crate) struct Account {
    waiting: usize,
    since: Option<Instant>,
    waited: f64,
    saved: f64,
}

impl Remote {
    /// The server for the results of this build.
    pub fn new(address: Address, fingerprint: &str) -> Self {
        let server = Arc::new(Server {
            client: Client::new(address.clone()),
            home: fingerprint.to_owned(),
            address,
            is_left: AtomicBool::new(false),
            is_full: AtomicBool::new(false),
            trouble: OnceLock::new(),
            account: Mutex::default(),
            counts: Counts::default(),
        });
        Self { uploads: Uploads::new(server.clone()), server }
    }

    /// What the server has of the file of this name: at most `most` bytes that took no longer than `worth` seconds and are what
    /// `judged` makes something of.
    pub fn get<T>(
        &self,
        path: &Path,
        most: u64,
        worth: f64,
        judged: impl FnOnce(Vec<u8>) -> Option<T>,
    ) -> Option<T> {
        let server = &*self.server;
        let name = server.name(path).filter(|_| !server.is_left.load(Ordering::Relaxed))?;
        server.begin();
        let answer = server.client.get(&name, most, worth);
        server.end();
        match answer {
            Answer::Is(bytes) => {
                let found = judged(bytes);
                let counts = &server.counts;
                count(if found.is_some() { &counts.found } else { &counts.damaged });
                if found.is_none() {
                    server.tell("it gives something else than what was put there".into());
                }
                found
            }
            Answer::IsNot => {
                count(&server.counts.missing);
                None
            }
            Answer::Fails(why) => {
                server.leave(why);
                None
            }
        }
    }

    /// Takes notice that so many seconds of computing are saved.
    pub fn has_saved(&self, seconds: f64) {
        lock(&self.server.account).saved += seconds;
    }

    /// Sends a file some time; one that is not `new` only if the server has none of its name.
    pub fn put(&self, path: PathBuf, is_new: bool) {
        self.uploads.send(Upload { path, is_new });
    }

    /// Waits a moment until the server has what it was to be sent; drops what is left then.
    pub fn finish(&self) {
        self.uploads.finish();
    }

    /// The first trouble with the server, in words.
    pub fn trouble(&self) -> Option<&str> {
        self.server.trouble.get().map(String::as_str)
    }

    /// What the server was asked for so far.
    pub fn exchange(&self) -> Exchange {
        let Counts { found, missing, damaged, sent, unsent } = &self.server.counts;
        let [found, missing, damaged, sent, unsent] =
            [found, missing, damaged, sent, unsent].map(|count| count.load(Ordering::Relaxed));
        Exchange { found, missing, damaged, sent, unsent }
    }
}

/// Whether there is a server that answers at this address; else why not.
pub fn reach(address: &Address) -> Result<(), String> {
    Client::new(address.clone()).reach()
}

impl Server {
    /// What the server calls a file.
    pub(crate) fn name(&self, path: &Path) -> Option<String> {
        Some(format!("{}/{}", self.home, path.file_name()?.to_str()?))
    }

    /// Sends a file, unless that is not wanted any more.
    pub(crate) fn take(&self, upload: &Upload, cancelled: impl Fn() -> bool) {
        let taken = self.try_take(upload, cancelled);
        count(if taken { &self.counts.sent } else { &self.counts.unsent });
    }

    pub(crate) fn try_take(
        &self,
        Upload { path, is_new }: &Upload,
        cancelled: impl Fn() -> bool,
    ) -> bool {
        let is_over = self.is_left.load(Ordering::Relaxed) || self.is_full.load(Ordering::Relaxed);
        if is_over || cancelled() {
            return false;
        }
        let opened = std::fs::File::open(path).and_then(|file| Ok((file.metadata()?.len(), file)));
        // Who has cleared the cache meanwhile does not care.
        let (Ok((length, file)), Some(name)) = (opened, self.name(path)) else { return false };
        if !is_new {
            match self.client.head(&name) {
                Ok(there) if there == Some(length) => return true,
                Ok(_) => {}
                Err(why) => {
                    self.leave(why);
                    return false;
                }
            }
        }
        let reply =
            self.client.put(&name, length, super::uploads::Until { file, cancelled: &cancelled });
        match reply {
            Reply::Took => return true,
            Reply::TooLarge => self.tell(format!("it takes no file of {length} bytes")),
            Reply::Refuses(why) => {
                self.is_full.store(true, Ordering::Relaxed);
                self.tell(format!("it takes no results: {why}"));
            }
            Reply::Fails(_) if cancelled() => {}
            Reply::Fails(why) => self.leave(why),
        }
        false
    }

    /// Leaves the server alone from now on.
    pub(crate) fn leave(&self, why: String) {
        self.is_left.store(true, Ordering::Relaxed);
        self.tell(format!("{why}; it is left alone"));
    }

    pub(crate) fn tell(&self, trouble: String) {
        let _ = self.trouble.set(format!("the server of results {}: {trouble}", self.address));
    }

    pub(crate) fn begin(&self) {
        let account = &mut *lock(&self.account);
        account.waiting += 1;
        account.since.get_or_insert_with(Instant::now);
    }

    pub(crate) fn end(&self) {
        let account = &mut *lock(&self.account);
        account.waiting -= 1;
        if account.waiting == 0
            && let Some(since) = account.since.take()
        {
            account.waited += since.elapsed().as_secs_f64();
        }
        if account.saved + CREDIT < account.waited {
            self.leave("it costs more time than it saves".into());
        }
    }
}

pub(crate) fn count(count: &AtomicUsize) {
    count.fetch_add(1, Ordering::Relaxed);
}

/// Locks even if another thread panicked while it held the lock: what these locks guard is whole after every step.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(|broken| broken.into_inner())
}
