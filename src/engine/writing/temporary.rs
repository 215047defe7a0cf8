//! Files that are being written.
//!
//! Each has a name of a form that nothing else has, and is locked by the process that writes it. The system takes a lock away with
//! its process: a file that can be locked is no longer written by anybody. On file systems without locks nothing is swept.
//!
//! No age of a file and no process id tells as reliably that its process has ended.

use std::collections::BTreeSet;
use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use tempfile::{Builder, NamedTempFile};

const START: &str = ".maquette-";
const END: &str = ".part";

/// How many letters and digits stand between both.
const LETTERS: usize = 12;

/// A new file in a folder, locked.
pub(super) fn create(folder: &Path) -> io::Result<NamedTempFile> {
    // What the user's umask leaves of it, as for any new file.
    create_with(folder, 0o666)
}

/// The same, which nobody but its user may read.
pub(super) fn create_private(folder: &Path) -> io::Result<NamedTempFile> {
    create_with(folder, 0o600)
}

#[cfg_attr(not(unix), expect(unused_variables, reason = "there are no such permissions"))]
fn create_with(folder: &Path, permissions: u32) -> io::Result<NamedTempFile> {
    let mut builder = Builder::new();
    builder.prefix(START).suffix(END).rand_bytes(LETTERS);
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(fs::Permissions::from_mode(permissions));
    }
    loop {
        let file = builder.tempfile_in(folder)?;
        match file.as_file().try_lock() {
            // Somebody took it for one that was left behind, and removes it.
            Err(TryLockError::WouldBlock) => {}
            Ok(()) | Err(TryLockError::Error(_)) => return Ok(file),
        }
    }
}

/// Whether a file's name says that it is, or was, being written.
pub(crate) fn is_temporary(path: &Path) -> bool {
    let name = path.file_name().and_then(|name| name.to_str());
    let letters = name.and_then(|name| name.strip_prefix(START)?.strip_suffix(END));
    letters.is_some_and(|letters| {
        letters.len() == LETTERS && letters.bytes().all(|byte| byte.is_ascii_alphanumeric())
    })
}

/// Whether no process writes a temporary file any more.
pub(crate) fn is_abandoned(path: &Path) -> bool {
    let is_file = fs::symlink_metadata(path).is_ok_and(|metadata| metadata.is_file());
    fn locked(path: &Path) -> Result<Result<(), TryLockError>, io::Error> {
        File::options().append(true).open(path).map(|file| file.try_lock())
    }
    is_temporary(path) && is_file && locked(path).is_ok_and(|locked| locked.is_ok())
}

/// Sweeps a folder before this process first writes there: a batch writes thousands of files to one folder.
pub(super) fn sweep_once(folder: &Path) {
    static SWEPT: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());
    let folder = std::path::absolute(folder).unwrap_or_else(|_| folder.to_owned());
    let is_new = SWEPT.lock().unwrap_or_else(PoisonError::into_inner).insert(folder.clone());
    if is_new {
        sweep(&folder);
    }
}

/// Removes what processes that were killed while they wrote have left in a folder.
pub(crate) fn sweep(folder: &Path) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if is_abandoned(&path) {
            let _ = super::remove(&path);
        }
    }
}
