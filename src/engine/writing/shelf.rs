//! A folder of one process, through which it hands large pieces of data to another one on the same machine.

use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};

use tempfile::{Builder, TempDir};

/// Before the names of shelves.
const START: &str = "maquette-serve-";

/// The file in a shelf that its process holds locked.
const LOCK: &str = "lock";

/// Where memory can be written to as files, on Linux.
const MEMORY: &str = "/dev/shm";

/// A folder that nobody but its user may look into. It goes with the process; what killed ones have left goes with the next.
pub struct Shelf {
    folder: TempDir,
    _lock: File,
}

impl Shelf {
    /// A new one in this folder; else in memory where the system has such files, or among temporary files.
    pub fn new(parent: Option<&Path>) -> io::Result<Self> {
        let memory = Path::new(MEMORY);
        let temporary = std::env::temp_dir();
        let parents = match parent {
            Some(parent) => vec![parent],
            None => vec![memory, &temporary],
        };
        let made = parents.into_iter().map(Self::within);
        made.reduce(|found, next| if found.is_ok() { found } else { next })
            .unwrap_or_else(|| Err(io::ErrorKind::NotFound.into()))
    }

    fn within(parent: &Path) -> io::Result<Self> {
        sweep(parent);
        let mut builder = Builder::new();
        builder.prefix(START);
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            builder.permissions(fs::Permissions::from_mode(0o700));
        }
        let folder = builder.tempdir_in(parent)?;
        let lock = File::create_new(folder.path().join(LOCK))?;
        // Where there are no locks nothing is swept.
        let _ = lock.try_lock();
        Ok(Self { folder, _lock: lock })
    }

    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    /// Puts a file there: whole or, where there is no room for it, not at all.
    pub fn put(&self, name: &str, bytes: &[u8]) -> io::Result<()> {
        super::write_whole(&self.path().join(name), bytes).map(|_| ())
    }

    /// Takes a file away.
    pub fn drop_file(&self, name: &str) {
        let _ = super::remove(&self.path().join(name));
    }

    /// The path of a file there.
    ///
    /// # Errors
    /// In words, if such a name may lead elsewhere.
    pub fn place(&self, name: &str) -> Result<PathBuf, String> {
        if name.is_empty()
            || name.starts_with('.')
            || name == LOCK
            || !name.bytes().all(|byte: u8| byte.is_ascii_alphanumeric() || b"-_.".contains(&byte))
        {
            let allowed = "letters, digits, `-`, `_` and `.`, and no `.` at its beginning";
            return Err(format!("`{name}` cannot name a file here: names are of {allowed}"));
        }
        Ok(self.path().join(name))
    }
}

/// Removes the shelves of processes that are no more.
fn sweep(parent: &Path) {
    for entry in fs::read_dir(parent).into_iter().flatten().flatten() {
        let path = entry.path();
        let is_shelf = entry.file_name().to_string_lossy().starts_with(START)
            && fs::symlink_metadata(&path).is_ok_and(|metadata| metadata.is_dir());
        let lock = path.join(LOCK);
        // To open a pipe would wait for its reader.
        fn is_plain(lock: &Path) -> bool {
            fs::symlink_metadata(lock).is_ok_and(|metadata| metadata.is_file())
        }
        fn locked(lock: &Path) -> Result<Result<(), TryLockError>, io::Error> {
            File::options().write(true).open(lock).map(|it| it.try_lock())
        }
        // One without a lock is being made.
        if is_shelf
            && is_plain(&lock)
            && locked(&lock).is_ok_and(|it| {
                !matches!(it, Err(TryLockError::WouldBlock | TryLockError::Error(_)))
            })
        {
            let _ = fs::remove_dir_all(&path);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_killed_process_left_goes_and_what_a_living_one_has_stays() {
        let parent = tempfile::tempdir().unwrap();
        let living = Shelf::new(Some(parent.path())).unwrap();
        living.put("a", b"1").unwrap();
        let dead = parent.path().join("maquette-serve-dead");
        fs::create_dir(&dead).unwrap();
        fs::write(dead.join(LOCK), "").unwrap();
        fs::write(dead.join("a"), "1").unwrap();
        let other = parent.path().join("other");
        fs::create_dir(&other).unwrap();
        let next = Shelf::new(Some(parent.path())).unwrap();
        assert!(!dead.exists() && other.exists() && living.path().join("a").exists());
        drop((living, next));
        assert_eq!(fs::read_dir(parent.path()).unwrap().count(), 1);
    }

    /// To open a pipe would wait until somebody reads from it.
    #[cfg(target_os = "linux")]
    #[test]
    fn a_pipe_in_the_place_of_a_lock_stops_nobody() {
        let parent = tempfile::tempdir().unwrap();
        let other = parent.path().join("maquette-serve-other");
        fs::create_dir(&other).unwrap();
        let (mode, kind) = (rustix::fs::Mode::RWXU, rustix::fs::FileType::Fifo);
        rustix::fs::mknodat(rustix::fs::CWD, other.join(LOCK), kind, mode, 0).unwrap();
        let shelf = Shelf::new(Some(parent.path())).unwrap();
        assert!(shelf.path().exists() && other.exists());
    }

    #[test]
    fn no_name_leads_out() {
        let parent = tempfile::tempdir().unwrap();
        let shelf = Shelf::new(Some(parent.path())).unwrap();
        for name in ["", ".", "..", "../a", "/etc/passwd", "a/b", "lock", "a\\b", "\u{e4}"] {
            assert!(shelf.place(name).is_err(), "{name:?}");
        }
        assert_eq!(shelf.place("in-1.f64").unwrap(), shelf.path().join("in-1.f64"));
    }
}
