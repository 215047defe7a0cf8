//! The sources of file events: the system, or polling where the system has none.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::Metadata;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, Weak};
use std::time::{Duration, SystemTime};

use notify::event::{AccessKind, AccessMode, ModifyKind};
use notify::{EventKind, RecommendedWatcher, RecursiveMode, Watcher};

use super::list::WatchList;

/// Something may have happened.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Event {
    /// To what these files hold.
    Touched(Vec<PathBuf>),
    /// The same, but who writes to these files has not closed them.
    Growing(Vec<PathBuf>),
    /// The same, and who wrote to these files has closed them.
    Closed(Vec<PathBuf>),
    /// Under one of these names there may be something else now, or nothing.
    Moved(Vec<PathBuf>),
    /// Nobody knows where: the system dropped events.
    Lost,
}

/// Takes events, on any thread.
pub(crate) type Sink = Arc<dyn Fn(Event) + Send + Sync>;

/// A source of events.
pub(crate) trait Backend {
    /// Watches this list instead of the one before. Gives the folders that were not watched until now: what happened there
    /// before was not reported.
    ///
    /// # Errors
    /// In words, if events will not come.
    fn watch(&mut self, list: &WatchList) -> Result<Vec<PathBuf>, String>;

    /// A folder was moved or deleted: under its name there may be another one, which has to be watched anew.
    fn renew(&mut self, folder: &Path);
}

/// The events of the system: inotify, FSEvents, ReadDirectoryChangesW.
///
/// It watches folders, not files: a file that is replaced by another one of its name is not the file that was watched.
pub(crate) struct Native {
    watcher: RecommendedWatcher,
    folders: BTreeSet<PathBuf>,
}

impl Native {
    pub(crate) fn new(sink: Sink) -> Result<Self, String> {
        let handler = move |event: notify::Result<notify::Event>| match event {
            Ok(event) if event.need_rescan() => sink(Event::Lost),
            Ok(event) => match event.kind {
                // Elsewhere nobody tells of the end.
                EventKind::Modify(ModifyKind::Data(_)) if cfg!(target_os = "linux") => {
                    sink(Event::Growing(event.paths));
                }
                EventKind::Access(AccessKind::Close(AccessMode::Write)) => {
                    sink(Event::Closed(event.paths));
                }
                EventKind::Modify(ModifyKind::Data(_) | ModifyKind::Metadata(_)) => {
                    sink(Event::Touched(event.paths));
                }
                // Somebody has only looked.
                EventKind::Access(_) => {}
                _ => sink(Event::Moved(event.paths)),
            },
            Err(_) => sink(Event::Lost),
        };
        let watcher = notify::recommended_watcher(handler).map_err(|error| in_words(&error))?;
        Ok(Self { watcher, folders: BTreeSet::new() })
    }
}

/// EMFILE of Linux: here that the user's programs watch as many times as they may.
const TOO_MANY: Option<i32> = Some(24);

fn in_words(error: &notify::Error) -> String {
    match &error.kind {
        notify::ErrorKind::MaxFilesWatch => {
            "the system lets watch no more folders (fs.inotify.max_user_watches)".into()
        }
        notify::ErrorKind::Io(error) if error.raw_os_error() == TOO_MANY => {
            "the system lets watch no more programs (fs.inotify.max_user_instances)".into()
        }
        _ => error.to_string(),
    }
}

impl Backend for Native {
    fn watch(&mut self, list: &WatchList) -> Result<Vec<PathBuf>, String> {
        let gone: Vec<PathBuf> = self.folders.difference(list.folders()).cloned().collect();
        for folder in gone {
            // A folder that was deleted is not watched any more.
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
                // It went away after the list was made; the folder above tells.
                Err(_) if !folder.is_dir() => {}
                Err(error) => return Err(in_words(&error)),
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

/// How often files are polled. Shorter is a load on slow networks, longer is noticed by the user.
const PERIOD: Duration = Duration::from_millis(500);

/// A file that changed less than this before it was looked at may change again without another time: FAT counts in two seconds.
const YOUNG: Duration = Duration::from_secs(2);

/// Looks at the watched files twice a second, for file systems without events.
pub(crate) struct Polling {
    stamps: Arc<Mutex<BTreeMap<PathBuf, Stamp>>>,
}

/// What tells that a file may have changed, without reading it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct Stamp {
    length: u64,
    modified: Option<SystemTime>,
    /// The file itself and its last change of any kind, where the system knows them.
    identity: Option<(u64, i64, i64)>,
    /// Too young to be told from its next change.
    young: bool,
}

impl Stamp {
    fn of(path: &Path) -> Self {
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
        let young = age.is_none_or(|age| age < YOUNG);
        Self { length: metadata.len(), modified, identity, young }
    }
}

impl Polling {
    pub(crate) fn new(sink: Sink) -> Self {
        let stamps = Arc::<Mutex<_>>::default();
        let weak = Arc::downgrade(&stamps);
        std::thread::spawn(move || poll(&weak, &sink));
        Self { stamps }
    }
}

/// Looks until nobody wants to know any more.
fn poll(stamps: &Weak<Mutex<BTreeMap<PathBuf, Stamp>>>, sink: &Sink) {
    loop {
        std::thread::sleep(PERIOD);
        let Some(stamps) = stamps.upgrade() else { return };
        let mut touched = Vec::new();
        for (path, before) in &mut *lock(&stamps) {
            let now = Stamp::of(path);
            if now != *before || before.young {
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
        let mut stamps = lock(&self.stamps);
        let mut before = std::mem::take(&mut *stamps);
        for file in list.files() {
            let stamp = before.remove(&file.path).unwrap_or_else(|| Stamp::of(&file.path));
            stamps.insert(file.path.clone(), stamp);
        }
        Ok(Vec::new())
    }

    fn renew(&mut self, _: &Path) {}
}

/// Whether other machines, or the host of this one, can change files of this folder without an event here.
#[cfg(target_os = "linux")]
pub(crate) fn is_remote(folder: &Path) -> bool {
    /// The types of linux/magic.h and of the file systems' own headers: NFS, SMB (three generations), Ceph, AFS, Coda, 9P (as
    /// in WSL and virtual machines), FUSE (sshfs and others), VirtualBox.
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

/// Whether other machines can change files of this folder without an event here: not known on this system.
#[cfg(not(target_os = "linux"))]
pub(crate) fn is_remote(_: &Path) -> bool {
    false
}
