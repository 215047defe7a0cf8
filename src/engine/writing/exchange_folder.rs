//! A folder through which a process exchanges large data with another process on the same machine.

use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};

use tempfile::{Builder, TempDir};

/// The start of the names of exchange folders.
const START: &str = "maquette-serve-";

/// The name of a file in each exchange folder. The process that owns the folder keeps this file locked.
const LOCK: &str = "lock";

/// The folder on Linux whose files are in memory (`tmpfs`).
const MEMORY: &str = "/dev/shm";

/// A folder that only this user can access. It is removed when the process ends. The folder of a killed process is removed when the next
/// exchange folder is created.
pub struct ExchangeFolder {
    folder: TempDir,
    _lock: File,
}

impl ExchangeFolder {
    /// Creates an exchange folder in `parent`. Without `parent`, it is created on a file system in memory if there is one, otherwise in the
    /// folder for temporary files.
    pub fn new(parent: Option<&Path>) -> io::Result<Self> {
        let memory = Path::new(MEMORY);
        let temporary = std::env::temp_dir();
        let parents = match parent {
            Some(parent) => vec![parent],
            None => vec![memory, &temporary],
        };
        let made = parents.into_iter().map(Self::create_in);
        made.reduce(|found, next| if found.is_ok() { found } else { next })
            .unwrap_or_else(|| Err(io::ErrorKind::NotFound.into()))
    }

    fn create_in(parent: &Path) -> io::Result<Self> {
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
        // Ignore an error: on a file system without locks, the only consequence is that old exchange folders are never removed.
        let _ = lock.try_lock();
        Ok(Self { folder, _lock: lock })
    }

    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    /// Writes a file to the folder, whole or not at all.
    pub fn put(&self, name: &str, bytes: &[u8]) -> io::Result<()> {
        super::write_whole(&self.path().join(name), bytes).map(|_| ())
    }

    /// Removes a file from the folder. Errors are ignored.
    pub fn drop_file(&self, name: &str) {
        let _ = super::remove(&self.path().join(name));
    }

    /// Returns the path of the file `name` in the folder.
    ///
    /// # Errors
    /// A message if the name could lead out of the folder.
    pub fn path_of(&self, name: &str) -> Result<PathBuf, String> {
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

/// Removes the exchange folders of processes that have ended.
fn sweep(parent: &Path) {
    for entry in fs::read_dir(parent).into_iter().flatten().flatten() {
        let path = entry.path();
        let is_shelf = entry.file_name().to_string_lossy().starts_with(START)
            && fs::symlink_metadata(&path).is_ok_and(|metadata| metadata.is_dir());
        let lock = path.join(LOCK);
        // Check the kind of file before opening it: opening a pipe would block.
        fn is_plain(lock: &Path) -> bool {
            fs::symlink_metadata(lock).is_ok_and(|metadata| metadata.is_file())
        }
        fn try_lock(lock: &Path) -> Result<Result<(), TryLockError>, io::Error> {
            File::options().write(true).open(lock).map(|it| it.try_lock())
        }
        // Skip a folder without a lock file, because another process may just be creating it.
        if is_shelf
            && is_plain(&lock)
            && try_lock(&lock).is_ok_and(|it| {
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
    fn only_folders_of_ended_processes_are_removed() {
        let parent = tempfile::tempdir().unwrap();
        let living = ExchangeFolder::new(Some(parent.path())).unwrap();
        living.put("a", b"1").unwrap();
        let dead = parent.path().join("maquette-serve-dead");
        fs::create_dir(&dead).unwrap();
        fs::write(dead.join(LOCK), "").unwrap();
        fs::write(dead.join("a"), "1").unwrap();
        let other = parent.path().join("other");
        fs::create_dir(&other).unwrap();
        let next = ExchangeFolder::new(Some(parent.path())).unwrap();
        assert!(!dead.exists() && other.exists() && living.path().join("a").exists());
        drop((living, next));
        assert_eq!(fs::read_dir(parent.path()).unwrap().count(), 1);
    }

    /// A named pipe in place of the lock file must not be opened, because opening it would block.
    #[cfg(target_os = "linux")]
    #[test]
    fn a_pipe_instead_of_a_lock_file_does_not_block() {
        let parent = tempfile::tempdir().unwrap();
        let other = parent.path().join("maquette-serve-other");
        fs::create_dir(&other).unwrap();
        let (mode, kind) = (rustix::fs::Mode::RWXU, rustix::fs::FileType::Fifo);
        rustix::fs::mknodat(rustix::fs::CWD, other.join(LOCK), kind, mode, 0).unwrap();
        let shelf = ExchangeFolder::new(Some(parent.path())).unwrap();
        assert!(shelf.path().exists() && other.exists());
    }

    #[test]
    fn names_cannot_lead_out_of_the_folder() {
        let parent = tempfile::tempdir().unwrap();
        let shelf = ExchangeFolder::new(Some(parent.path())).unwrap();
        for name in ["", ".", "..", "../a", "/etc/passwd", "a/b", "lock", "a\\b", "\u{e4}"] {
            assert!(shelf.path_of(name).is_err(), "{name:?}");
        }
        assert_eq!(shelf.path_of("in-1.f64").unwrap(), shelf.path().join("in-1.f64"));
    }
}
