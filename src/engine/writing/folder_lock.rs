//! A lock on a folder. It ensures that only one process at a time reads, changes and rewrites files in the folder.
//!
//! The folder itself is locked, so no lock file is left behind. The system releases the lock when the process ends. On systems that cannot
//! lock folders, [`replace`](super::replace) still refuses to overwrite a file that has changed since it was read.

use std::fs::{File, TryLockError};
use std::io;
use std::path::Path;
use std::thread::sleep;
use std::time::{Duration, Instant};

/// The maximum time to wait for another process to release the lock. An edit takes milliseconds, or up to a second on a busy machine.
const LOCK_TIMEOUT: Duration = Duration::from_secs(20);

/// The interval between two attempts to take the lock.
const PAUSE: Duration = Duration::from_millis(2);

/// A lock on a folder of files that people edit, held until it is dropped.
pub struct FolderLock(
    #[expect(dead_code, reason = "it is locked as long as it is open")] Option<File>,
);

impl FolderLock {
    /// Waits until no other process has locked the folder that contains `path`, and locks it. A process that already holds the lock must
    /// not call this again.
    ///
    /// # Errors
    /// An error if another process holds the lock for longer than `LOCK_TIMEOUT`.
    pub fn acquire(path: &Path) -> io::Result<Self> {
        // If the path is a link, lock the folder of its target.
        let real = std::fs::canonicalize(path);
        let Ok(folder) = File::open(super::parent_folder(real.as_deref().unwrap_or(path))) else {
            return Ok(Self(None));
        };
        let start = Instant::now();
        loop {
            match folder.try_lock() {
                Ok(()) => return Ok(Self(Some(folder))),
                Err(TryLockError::Error(_)) => return Ok(Self(None)),
                Err(TryLockError::WouldBlock) if LOCK_TIMEOUT < start.elapsed() => {
                    return Err(super::changed_meanwhile());
                }
                Err(TryLockError::WouldBlock) => sleep(PAUSE),
            }
        }
    }
}
