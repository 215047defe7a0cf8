//! Large files that this process writes repeatedly. Each version is written over the file of the version before the last one, and only
//! the parts that differ are written.
//!
//! A file must appear whole or not at all, so it is never overwritten at its own path. The file that it replaces is not removed but kept
//! next to it for the next write, under the name of a temporary file. Overwriting existing pages costs a third of allocating new ones, and
//! pages with the right content cost nothing. A file is overwritten only if nobody else can notice: it is not open elsewhere, has no other
//! name and is unchanged.
//!
//! The first two versions are new files. Copying the unchanged part from the old file would cost as much as writing it (65 to 90 ms for 337
//! MB), and ext4 cannot share it.
//!
//! If the machine stops before everything is on disk, a recycled file has the right length and time but wrong content. So the next
//! process must not trust it: the file is recorded for that process only after `bring_to_disk`, which runs in the background.

#![cfg_attr(
    target_os = "linux",
    allow(unsafe_code, reason = "no library asks for leases; each use has its proof")
)]

use std::fs::{File, Metadata};
use std::io;
use std::path::Path;

use maquette_graph::file_stat::FileStat;
use tempfile::NamedTempFile;

/// A file that has been replaced, with the known facts about its contents. Dropping this removes the file.
pub(crate) struct RecycledFile<T> {
    file: NamedTempFile,
    stamp: FileStat,
    holds: T,
}

impl<T> RecycledFile<T> {
    /// Returns the file to be overwritten, and the known facts about its contents. Returns `None` if another program may be using the file
    /// or has changed it.
    pub(super) fn reuse(self) -> Option<(NamedTempFile, T)> {
        let Self { file, stamp, holds } = self;
        // From now on, the name of the file tells other programs that the file is being written.
        let is_ours = is_open_only_here(file.as_file())
            && file
                .as_file()
                .metadata()
                .is_ok_and(|it| FileStat::new(&it) == stamp && has_one_name(&it));
        is_ours.then_some((file, holds))
    }

    /// Exchanges a file with the file at `path`, which then can be recycled. The file at `path` must have the stamp `last`. Returns `file`
    /// if the exchange is not possible.
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
        // Another program may have replaced the file at the path just before the exchange. Then the file of that program is the one that is
        // replaced.
        let metadata = old.as_file().metadata().ok().filter(|it| {
            std::fs::symlink_metadata(old.path())
                .is_ok_and(|there| FileStat::new(&there) == FileStat::new(it))
        });
        let stamp = metadata.map(|metadata| FileStat::new(&metadata));
        Ok((file, stamp.map(|stamp| Self { file: old, stamp, holds })))
    }
}

/// Opens and locks the file at this path, if the file has this stamp and no other name.
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

/// Exchanges the names of two files.
#[cfg(target_os = "linux")]
fn exchange(a: &Path, b: &Path) -> io::Result<()> {
    use rustix::fs::{CWD, RenameFlags, renameat_with};
    Ok(renameat_with(CWD, a, CWD, b, RenameFlags::EXCHANGE)?)
}

#[cfg(not(target_os = "linux"))]
fn exchange(_: &Path, _: &Path) -> io::Result<()> {
    Err(io::ErrorKind::Unsupported.into())
}

/// Returns true if no other process has the file open or mapped, as far as the system can tell. It grants a write lease only in that case.
#[cfg(target_os = "linux")]
pub(super) fn is_open_only_here(file: &File) -> bool {
    use std::os::fd::AsRawFd;
    /// The command that chooses the signal which the process gets if another process opens the file during the lease. The chosen signal has
    /// no effect.
    const F_SETSIG: libc::c_int = 10;
    fn set(command: i32, value: libc::c_int, file: &File) -> bool {
        // SAFETY: both commands that are used below take a number, and the file is open.
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
