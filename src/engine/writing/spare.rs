//! Large files that this process writes again and again: each is written over the last but one, only where it differs.
//!
//! A file appears whole or not at all, so it is never written where it lies. The one that it replaces is not removed, but kept beside it under a
//! name of what is being written, for the next time. Pages that are there cost a third of new ones, and those that are right already nothing.
//! It is written over only if nobody else can see that: nobody has it open, it has no other name, and it is as it was left.
//!
//! The first two times a new file is written. Copying the unchanged part from the old file costs what writing costs (65 to 90 ms for 337
//! MB), and ext4 cannot share it. If the machine stops before all is on disk, such a file would have the right length and time: the next
//! process is told of it only when `bring_to_disk` has ended, beside the run.

#![cfg_attr(
    target_os = "linux",
    allow(unsafe_code, reason = "no library asks for leases; each use has its proof")
)]

use std::fs::{File, Metadata};
use std::io;
use std::path::Path;

use maquette_graph::stamp::Stamp;
use tempfile::NamedTempFile;

/// A file that has been replaced, and what is known of its content. It goes when it is dropped.
pub(crate) struct Spare<T> {
    file: NamedTempFile,
    stamp: Stamp,
    holds: T,
}

impl<T> Spare<T> {
    /// The file to be written over, and what is known of its content.
    pub(super) fn reuse(self) -> Option<(NamedTempFile, T)> {
        let Self { file, stamp, holds } = self;
        // Who opens it from now on knows by its name that it is being written.
        let is_ours = is_open_only_here(file.as_file())
            && file
                .as_file()
                .metadata()
                .is_ok_and(|it| Stamp::new(&it) == stamp && has_one_name(&it));
        is_ours.then_some((file, holds))
    }

    /// Moves a file to where the one with this stamp lies, which becomes spare; gives the file back where that cannot be done.
    pub(super) fn exchange(
        file: NamedTempFile,
        path: &Path,
        last: Stamp,
        holds: T,
    ) -> Result<(File, Option<Self>), NamedTempFile> {
        let Some(old) = old_at(path, last) else { return Err(file) };
        if exchange(file.path(), path).is_err() {
            return Err(file);
        }
        let (file, name) = file.into_parts();
        let old = NamedTempFile::from_parts(old, name);
        // Somebody may have put another file there in between, which is then replaced.
        let metadata = old.as_file().metadata().ok().filter(|it| {
            std::fs::symlink_metadata(old.path())
                .is_ok_and(|there| Stamp::new(&there) == Stamp::new(it))
        });
        let stamp = metadata.map(|metadata| Stamp::new(&metadata));
        Ok((file, stamp.map(|stamp| Self { file: old, stamp, holds })))
    }
}

/// The file at this path, locked as one that is being written, if it is the one with this stamp and has no other name.
fn old_at(path: &Path, stamp: Stamp) -> Option<File> {
    maquette_value::plain::is_own(path).then_some(())?;
    let file = File::options().read(true).write(true).open(path).ok()?;
    let metadata = file.metadata().ok()?;
    let is_it = Stamp::new(&metadata) == stamp && has_one_name(&metadata);
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

/// Gives each of two files the name of the other.
#[cfg(target_os = "linux")]
fn exchange(a: &Path, b: &Path) -> io::Result<()> {
    use rustix::fs::{CWD, RenameFlags, renameat_with};
    Ok(renameat_with(CWD, a, CWD, b, RenameFlags::EXCHANGE)?)
}

#[cfg(not(target_os = "linux"))]
fn exchange(_: &Path, _: &Path) -> io::Result<()> {
    Err(io::ErrorKind::Unsupported.into())
}

/// Whether nobody but us has a file open or mapped, as far as the system tells: it gives a lease to write only then.
#[cfg(target_os = "linux")]
pub(super) fn is_open_only_here(file: &File) -> bool {
    use std::os::fd::AsRawFd;
    /// Which signal tells that somebody opens it while we have the lease: one that nobody minds.
    const F_SETSIG: libc::c_int = 10;
    fn set(command: i32, value: libc::c_int, file: &File) -> bool {
        // SAFETY: these commands take a number, and the file is open.
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
