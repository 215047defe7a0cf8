//! Temporary files: files that are still being written.
//!
//! The name of a temporary file has a form that no other file has. The process that writes the file keeps it locked. The system releases
//! the lock when the process ends. So if another process can lock the file, the file is abandoned and can be removed. On file systems
//! without locks, no files are removed.
//!
//! A lock shows that a file is abandoned more reliably than the age of the file or a process id in its name.

use std::collections::BTreeSet;
use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use tempfile::{Builder, NamedTempFile};

const START: &str = ".maquette-";
const END: &str = ".part";

/// The number of random letters and digits in the name of a temporary file.
const LETTERS: usize = 12;

/// Creates a locked temporary file in a folder.
pub(super) fn create(folder: &Path) -> io::Result<NamedTempFile> {
    // Request full permissions; the user's umask restricts them, as for any new file.
    create_with(folder, 0o666)
}

/// Creates a locked temporary file that only this user can read.
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
            // Try another name: another process took this file for an abandoned one, has locked it and will remove it.
            Err(TryLockError::WouldBlock) => {}
            Ok(()) | Err(TryLockError::Error(_)) => return Ok(file),
        }
    }
}

/// Returns true if the file's name has the form of a temporary file.
pub(crate) fn is_temporary(path: &Path) -> bool {
    let name = path.file_name().and_then(|name| name.to_str());
    let letters = name.and_then(|name| name.strip_prefix(START)?.strip_suffix(END));
    letters.is_some_and(|letters| {
        letters.len() == LETTERS && letters.bytes().all(|byte| byte.is_ascii_alphanumeric())
    })
}

/// Returns true if this is a temporary file whose process has ended.
pub(crate) fn is_abandoned(path: &Path) -> bool {
    let is_file = fs::symlink_metadata(path).is_ok_and(|metadata| metadata.is_file());
    fn try_lock(path: &Path) -> Result<Result<(), TryLockError>, io::Error> {
        File::options().append(true).open(path).map(|file| file.try_lock())
    }
    is_temporary(path) && is_file && try_lock(path).is_ok_and(|locked| locked.is_ok())
}

/// Removes abandoned files from a folder before this process first writes to it. This is done once per folder, because a batch writes
/// thousands of files to one folder.
pub(super) fn sweep_once(folder: &Path) {
    static SWEPT: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());
    let folder = std::path::absolute(folder).unwrap_or_else(|_| folder.to_owned());
    let is_new = SWEPT.lock().unwrap_or_else(PoisonError::into_inner).insert(folder.clone());
    if is_new {
        sweep(&folder);
    }
}

/// Removes abandoned temporary files from a folder.
pub(crate) fn sweep(folder: &Path) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if is_abandoned(&path) {
            let _ = super::remove(&path);
        }
    }
}
