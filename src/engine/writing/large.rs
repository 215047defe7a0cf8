//! Fast writing of large files.

use std::fs::File;
use std::io;
use std::path::Path;
use std::time::SystemTime;

/// The minimum size of a large file, in bytes. For smaller files the measures in this module save no time.
const LARGE: usize = 16 << 20;

/// Allocates disk space for a file of `len` bytes before it is written. Without this, the file system ext4 allocates the space when the
/// file replaces another one, and writes the whole file to disk at that time. For 340 MB this takes 140 to 300 ms, twice as long as all
/// other steps of writing the file.
///
/// The length of the file still grows while it is written. So if the machine stops before the whole file is on disk, the file is too short
/// and is not mistaken for a complete one.
pub(super) fn make_room(file: &File, len: usize) {
    #[cfg(target_os = "linux")]
    if LARGE <= len {
        use rustix::fs::{FallocateFlags, fallocate};
        // Ignore an error: a file system without this operation allocates the space later.
        let _ = fallocate(file, FallocateFlags::KEEP_SIZE, 0, len as u64);
    }
    #[cfg(not(target_os = "linux"))]
    let _ = (file, len);
}

/// Gives a large file a modification time that no later write can have. The clock of the file system advances in steps of some
/// milliseconds, but this time is in nanoseconds. So equal metadata proves from then on that the file is unchanged.
pub(super) fn mark(file: &File, len: usize) -> io::Result<()> {
    if LARGE <= len { file.set_modified(SystemTime::now()) } else { Ok(()) }
}

/// Waits until the content of a file is on disk.
pub(crate) fn bring_to_disk(path: &Path) -> io::Result<()> {
    File::open(path)?.sync_data()
}

/// An open handle of a large file that is about to be replaced. The system frees the pages of the old file only when its last handle is
/// closed.
pub(super) struct ReplacedFile(Option<File>);

impl ReplacedFile {
    /// Opens the old file at `path` if the new file, which has `len` bytes and is about to replace it, is large.
    #[cfg(unix)]
    pub(super) fn open(path: &Path, len: usize) -> Self {
        Self((LARGE <= len).then(|| maquette_value::fs::open_no_follow(path).ok()).flatten())
    }

    /// Does nothing, because on this system a file cannot be replaced while it is open.
    #[cfg(not(unix))]
    pub(super) fn open(_: &Path, _: usize) -> Self {
        Self(None)
    }

    /// Closes the handle in a background thread, because freeing the pages takes time.
    pub(super) fn close_in_background(self) {
        if let Self(Some(file)) = self {
            // Ignore an error: if no thread can be started, the handle is closed here.
            let _ = std::thread::Builder::new().spawn(move || drop(file));
        }
    }
}

/// Writes all bytes at the offset `place` of a file. Other threads may write to other parts of the file at the same time.
pub(crate) fn write_at(file: &File, place: usize, bytes: &[u8]) -> io::Result<()> {
    #[cfg(unix)]
    return std::os::unix::fs::FileExt::write_all_at(file, bytes, place as u64);
    #[cfg(windows)]
    {
        use std::os::windows::fs::FileExt;
        let (mut bytes, mut place) = (bytes, place as u64);
        while !bytes.is_empty() {
            match file.seek_write(bytes, place)? {
                0 => return Err(io::ErrorKind::WriteZero.into()),
                count => (bytes, place) = (&bytes[count..], place + count as u64),
            }
        }
        Ok(())
    }
}
