//! Backends that report file events: the operating system, or polling on file systems without events.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::Metadata;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, Weak};
use std::time::{Duration, SystemTime};

use notify::event::{AccessKind, AccessMode, ModifyKind};
use notify::{EventKind, RecommendedWatcher, RecursiveMode, Watcher};

use super::list::WatchList;

/// An event that may mean that files have new contents.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Event {
    /// The contents of these files may have changed.
    Touched(Vec<PathBuf>),
    /// These files were written to and are still open.
    Growing(Vec<PathBuf>),
    /// These files were written to and closed.
    Closed(Vec<PathBuf>),
    /// Files at these paths may have been created, replaced, renamed or deleted.
    Moved(Vec<PathBuf>),
    /// The operating system has lost events, so any file may have changed.
    Lost,
}

/// A function that receives events, on any thread.
pub(crate) type Sink = Arc<dyn Fn(Event) + Send + Sync>;

/// A source of events about watched files.
pub(crate) trait Backend {
    /// Replaces the list of watched paths. Returns the newly watched folders: changes in them before this call were not reported.
    ///
    /// # Errors
    /// A message if the backend cannot report events.
    fn watch(&mut self, list: &WatchList) -> Result<Vec<PathBuf>, String>;

    /// Stops watching a folder that was moved or deleted, so that a new folder with the same name can be watched.
    fn renew(&mut self, folder: &Path);
}

/// A backend that uses the events of the operating system: inotify, FSEvents, or ReadDirectoryChangesW.
///
/// It watches folders instead of files, because a watch on a file does not notice when a new file replaces it.
pub(crate) struct Native {
    watcher: RecommendedWatcher,
    folders: BTreeSet<PathBuf>,
}

impl Native {
    pub(crate) fn new(sink: Sink) -> Result<Self, String> {
        let handler = move |event: notify::Result<notify::Event>| match event {
            Ok(event) if event.need_rescan() => sink(Event::Lost),
            Ok(event) => match event.kind {
                // Only Linux reports when a file is closed after writing.
                EventKind::Modify(ModifyKind::Data(_)) if cfg!(target_os = "linux") => {
                    sink(Event::Growing(event.paths));
                }
                EventKind::Access(AccessKind::Close(AccessMode::Write)) => {
                    sink(Event::Closed(event.paths));
                }
                EventKind::Modify(ModifyKind::Data(_) | ModifyKind::Metadata(_)) => {
                    sink(Event::Touched(event.paths));
                }
                // Ignore the event: the file was only read.
                EventKind::Access(_) => {}
                _ => sink(Event::Moved(event.paths)),
            },
            Err(_) => sink(Event::Lost),
        };
        let watcher =
            notify::recommended_watcher(handler).map_err(|error| describe_error(&error))?;
        Ok(Self { watcher, folders: BTreeSet::new() })
    }
}

/// The error code EMFILE on Linux: the user has too many inotify instances.
const EMFILE: Option<i32> = Some(24);

fn describe_error(error: &notify::Error) -> String {
    match &error.kind {
        notify::ErrorKind::MaxFilesWatch => {
            "the limit of watched folders is reached (fs.inotify.max_user_watches)".into()
        }
        notify::ErrorKind::Io(error) if error.raw_os_error() == EMFILE => {
            "the limit of watching programs is reached (fs.inotify.max_user_instances)".into()
        }
        _ => error.to_string(),
    }
}

impl Backend for Native {
    fn watch(&mut self, list: &WatchList) -> Result<Vec<PathBuf>, String> {
        let removed: Vec<PathBuf> = self.folders.difference(list.folders()).cloned().collect();
        for folder in removed {
            // Ignore an error: a deleted folder cannot be unwatched, and need not be.
            let _ = self.watcher.unwatch(&folder);
            self.folders.remove(&folder);
        }
        let mut new = Vec::new();
        for folder in list.folders() {
            if self.folders.contains(folder) {
                continue;
            }
            match self.watcher.watch(folder, RecursiveMode::NonRecursive) {
                Ok(()) => {
                    self.folders.insert(folder.clone());
                    new.push(folder.clone());
                }
                // Ignore the error: the folder was deleted after the list was made. The watch on its parent folder reports that.
                Err(_) if !folder.is_dir() => {}
                Err(error) => return Err(describe_error(&error)),
            }
        }
        Ok(new)
    }

    fn renew(&mut self, folder: &Path) {
        if self.folders.remove(folder) {
            let _ = self.watcher.unwatch(folder);
        }
    }
}

/// The polling interval. Shorter intervals would load slow networks, and longer ones would be noticed by users.
const POLL_INTERVAL: Duration = Duration::from_millis(500);

/// The minimum age at which the modification time of a file is reliable. The file system FAT stores times in steps of two seconds. So a
/// younger file may change again without a new time.
const MIN_AGE: Duration = Duration::from_secs(2);

/// A backend that polls the watched files twice a second. For file systems without events.
pub(crate) struct Polling {
    metadata: Arc<Mutex<BTreeMap<PathBuf, FileMetadata>>>,
}

/// The metadata of a file. If it has not changed and the file is not too young, the content has not changed.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct FileMetadata {
    length: u64,
    modified: Option<SystemTime>,
    /// The inode and change time of the file, on systems that have them.
    identity: Option<(u64, i64, i64)>,
    /// True if the file was modified so recently that a later change may have the same modification time.
    is_young: bool,
}

impl FileMetadata {
    fn read(path: &Path) -> Self {
        std::fs::metadata(path).map_or_else(|_| Self::default(), |metadata| Self::new(&metadata))
    }

    fn new(metadata: &Metadata) -> Self {
        let modified = metadata.modified().ok();
        let age = modified.and_then(|modified| SystemTime::now().duration_since(modified).ok());
        #[cfg(unix)]
        let identity = {
            use std::os::unix::fs::MetadataExt;
            Some((metadata.ino(), metadata.ctime(), metadata.ctime_nsec()))
        };
        #[cfg(not(unix))]
        let identity = None;
        let young = age.is_none_or(|age| age < MIN_AGE);
        Self { length: metadata.len(), modified, identity, is_young: young }
    }
}

impl Polling {
    pub(crate) fn new(sink: Sink) -> Self {
        let stamps = Arc::<Mutex<_>>::default();
        let weak = Arc::downgrade(&stamps);
        std::thread::spawn(move || poll(&weak, &sink));
        Self { metadata: stamps }
    }
}

/// Polls the files until the [`Polling`] is dropped.
fn poll(stamps: &Weak<Mutex<BTreeMap<PathBuf, FileMetadata>>>, sink: &Sink) {
    loop {
        std::thread::sleep(POLL_INTERVAL);
        let Some(stamps) = stamps.upgrade() else { return };
        let mut touched = Vec::new();
        for (path, before) in &mut *lock(&stamps) {
            let now = FileMetadata::read(path);
            if now != *before || before.is_young {
                touched.push(path.clone());
            }
            *before = now;
        }
        if !touched.is_empty() {
            sink(Event::Touched(touched));
        }
    }
}

fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(|broken| broken.into_inner())
}

impl Backend for Polling {
    fn watch(&mut self, list: &WatchList) -> Result<Vec<PathBuf>, String> {
        let mut stamps = lock(&self.metadata);
        let mut before = std::mem::take(&mut *stamps);
        for file in list.files() {
            let stamp = before.remove(&file.path).unwrap_or_else(|| FileMetadata::read(&file.path));
            stamps.insert(file.path.clone(), stamp);
        }
        Ok(Vec::new())
    }

    fn renew(&mut self, _: &Path) {}
}

/// Returns true if other machines, or the host of a virtual machine, can change files in this folder without causing an event here.
#[cfg(target_os = "linux")]
pub(crate) fn is_remote(folder: &Path) -> bool {
    /// The types of file systems whose files other machines can change without an event here, from linux/magic.h and the headers of the
    /// file systems: NFS, SMB (three generations), Ceph, AFS, Coda, 9P (in WSL and virtual machines), FUSE (sshfs and others), VirtualBox.
    const REMOTE: [u32; 10] = [
        0x6969,
        0x517b,
        0xff53_4d42,
        0xfe53_4d42,
        0x00c3_6400,
        0x5346_414f,
        0x7375_7245,
        0x0102_1997,
        0x6573_5546,
        0x786f_4256,
    ];
    rustix::fs::statfs(folder).is_ok_and(|system| REMOTE.contains(&(system.f_type as u32)))
}

/// Returns false, because this system does not report the type of a file system.
#[cfg(not(target_os = "linux"))]
pub(crate) fn is_remote(_: &Path) -> bool {
    false
}
