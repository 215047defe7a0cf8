//! One after the other: who reads a file, changes it and writes it again keeps others from doing so meanwhile.
//!
//! The folder itself is locked, so that nothing is left in it, and the system takes the lock away with its process. Where folders
//! cannot be locked, a file that has been changed meanwhile is not replaced ([`replace`](super::replace)).

use std::fs::{File, TryLockError};
use std::io;
use std::path::Path;
use std::thread::sleep;
use std::time::{Duration, Instant};

/// How long somebody else may take: an edit takes milliseconds, on a busy machine a second.
const PATIENCE: Duration = Duration::from_secs(20);

/// How often to look whether it is our turn.
const PAUSE: Duration = Duration::from_millis(2);

/// The right to change files that people write in a folder, until it is dropped.
pub struct Turn(#[expect(dead_code, reason = "it is locked as long as it is open")] Option<File>);

impl Turn {
    /// Waits until nobody else changes what is beside a file. Who has a turn does not ask for another one.
    ///
    /// # Errors
    /// Somebody takes too long.
    pub fn beside(path: &Path) -> io::Result<Self> {
        // A link is changed where it leads to.
        let real = std::fs::canonicalize(path);
        let Ok(folder) = File::open(super::beside(real.as_deref().unwrap_or(path))) else {
            return Ok(Self(None));
        };
        let start = Instant::now();
        loop {
            match folder.try_lock() {
                Ok(()) => return Ok(Self(Some(folder))),
                Err(TryLockError::Error(_)) => return Ok(Self(None)),
                Err(TryLockError::WouldBlock) if PATIENCE < start.elapsed() => {
                    return Err(super::changed_meanwhile());
                }
                Err(TryLockError::WouldBlock) => sleep(PAUSE),
            }
        }
    }
}
