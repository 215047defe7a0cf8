//! Recycles large files that this process writes repeatedly. Each new version overwrites the file of the version before the previous one,
//! and only the parts that differ are written.
//!
//! A file must appear whole or not at all, so it is never overwritten at its own path. Instead, a replaced file is kept in the same folder
//! under the name of a temporary file, and the next write overwrites it. Overwriting existing pages costs a third of allocating new ones;
//! pages that already have the right content cost nothing. A file is overwritten only if nobody can notice: it is unchanged, has no other
//! name (hard link), and is not open in another process.
//!
//! The first two versions are new files. Copying the unchanged part from the old file would cost as much as writing it (65 to 90 ms for 337
//! MB), and the file system ext4 cannot share it between files.
//!
//! If the machine stops before everything is on disk, a recycled file has the right length and time but wrong content. So later processes
//! must not trust it: the file is recorded for them only after `bring_to_disk`, which runs in the background.

#![cfg_attr(
    target_os = "linux",
    allow(unsafe_code, reason = "no library asks for leases; each use has its proof")
)]

use std::fs::{File, Metadata};
use std::io;
use std::path::Path;

use maquette_graph::file_stat::FileStat;
use tempfile::NamedTempFile;

/// A file that has been replaced, with what is known about its content. Dropping this value removes the file.
pub(crate) struct RecycledFile<T> {
    file: NamedTempFile,
    stamp: FileStat,
    holds: T,
}

impl<T> RecycledFile<T> {
    /// Returns the file so that it can be overwritten, and what is known about its content. Returns `None` if another program may have
    /// opened or changed the file.
    pub(super) fn reuse(self) -> Option<(NamedTempFile, T)> {
        let Self { file, stamp, holds } = self;
        // From here on, the lock and the name of the file tell other programs that it is being written.
        let is_ours = is_open_only_here(file.as_file())
            && file
                .as_file()
                .metadata()
                .is_ok_and(|it| FileStat::new(&it) == stamp && has_one_name(&it));
        is_ours.then_some((file, holds))
    }

    /// Exchanges `file` with the file at `path`, which must have the metadata `last`. Returns both: the replaced file as one that can be
    /// recycled, or `None` if another program interfered. If the exchange is not possible, returns `file` as the error.
    pub(super) fn exchange(
        file: NamedTempFile,
        path: &Path,
        last: FileStat,
        holds: T,
    ) -> Result<(File, Option<Self>), NamedTempFile> {
        let Some(old) = old_at(path, last) else { return Err(file) };
        if exchange(file.path(), path).is_err() {
            return Err(file);
        }
        let (file, name) = file.into_parts();
        let old = NamedTempFile::from_parts(old, name);
        // Check the replaced file again: another program may have put a different file at the path just before the exchange.
        let metadata = old.as_file().metadata().ok().filter(|it| {
            std::fs::symlink_metadata(old.path())
                .is_ok_and(|there| FileStat::new(&there) == FileStat::new(it))
        });
        let stamp = metadata.map(|metadata| FileStat::new(&metadata));
        Ok((file, stamp.map(|stamp| Self { file: old, stamp, holds })))
    }
}

/// Opens and locks the file at this path. Returns `None` if the file has other metadata than `stamp`, or another name (hard link).
fn old_at(path: &Path, stamp: FileStat) -> Option<File> {
    maquette_value::fs::is_regular_file(path).then_some(())?;
    let file = File::options().read(true).write(true).open(path).ok()?;
    let metadata = file.metadata().ok()?;
    let is_it = FileStat::new(&metadata) == stamp && has_one_name(&metadata);
    (is_it && file.try_lock().is_ok()).then_some(file)
}

#[cfg(unix)]
fn has_one_name(metadata: &Metadata) -> bool {
    use std::os::unix::fs::MetadataExt;
    metadata.nlink() == 1
}

#[cfg(not(unix))]
fn has_one_name(_: &Metadata) -> bool {
    false
}

/// Exchanges the names of two files in one step.
#[cfg(target_os = "linux")]
fn exchange(a: &Path, b: &Path) -> io::Result<()> {
    use rustix::fs::{CWD, RenameFlags, renameat_with};
    Ok(renameat_with(CWD, a, CWD, b, RenameFlags::EXCHANGE)?)
}

#[cfg(not(target_os = "linux"))]
fn exchange(_: &Path, _: &Path) -> io::Result<()> {
    Err(io::ErrorKind::Unsupported.into())
}

/// Returns true if no other process has the file open or mapped. To find out, requests a write lease, which Linux grants only in that case.
#[cfg(target_os = "linux")]
pub(super) fn is_open_only_here(file: &File) -> bool {
    use std::os::fd::AsRawFd;
    /// The `fcntl` command that selects the signal sent if another process opens the file during the lease. The selected signal has no
    /// effect.
    const F_SETSIG: libc::c_int = 10;
    fn set(command: i32, value: libc::c_int, file: &File) -> bool {
        // SAFETY: both commands used below take a number, and the file is open.
        unsafe { libc::fcntl(file.as_raw_fd(), command, value) == 0 }
    }
    set(F_SETSIG, libc::SIGURG, file)
        && set(libc::F_SETLEASE, libc::F_WRLCK, file)
        && set(libc::F_SETLEASE, libc::F_UNLCK, file)
}

#[cfg(not(target_os = "linux"))]
fn is_open_only_here(_: &File) -> bool {
    false
}
