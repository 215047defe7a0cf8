//! What makes large files fast to write.

use std::fs::File;
use std::io;
use std::path::Path;
use std::time::SystemTime;

#[cfg(unix)]
use maquette_value::plain;

/// From so many bytes on it pays.
const LARGE: usize = 16 << 20;

/// Has the system find room for so many bytes before they are written. By itself ext4 finds it when the file is moved into the place of
/// another one, and writes it all to disk meanwhile: of 340 MB that takes twice as long as everything else.
/// That is 140 to 300 ms more than the copy.
///
/// The file's length grows as it is written: if the machine itself stops before it is on disk, it is too short, and so not taken for the
/// file that it should have become.
pub(super) fn make_room(file: &File, len: usize) {
    #[cfg(target_os = "linux")]
    if LARGE <= len {
        use rustix::fs::{FallocateFlags, fallocate};
        // A file system that cannot do it finds the room later.
        let _ = fallocate(file, FallocateFlags::KEEP_SIZE, 0, len as u64);
    }
    #[cfg(not(target_os = "linux"))]
    let _ = (file, len);
}

/// Gives a file of so many bytes, if they are many, a time of change that no later write gives it: the system's clock goes by ticks of some
/// milliseconds, this one tells nanoseconds. So its stamp proves at once that it is as it was left.
pub(super) fn mark(file: &File, len: usize) -> io::Result<()> {
    if LARGE <= len { file.set_modified(SystemTime::now()) } else { Ok(()) }
}

/// Waits until the content of a file is on disk.
pub(crate) fn bring_to_disk(path: &Path) -> io::Result<()> {
    File::open(path)?.sync_data()
}

/// A file that is about to be replaced by a large one. The system gives back what it holds of it when nobody has it open any more.
pub(super) struct Old(Option<File>);

impl Old {
    /// The one at this path, if it is about to be replaced by so many bytes.
    #[cfg(unix)]
    pub(super) fn at(path: &Path, len: usize) -> Self {
        Self((LARGE <= len).then(|| plain::open_own(path).ok()).flatten())
    }

    /// Elsewhere a file that is open is not replaced.
    #[cfg(not(unix))]
    pub(super) fn at(_: &Path, _: usize) -> Self {
        Self(None)
    }

    /// Gives it back beside whatever is done next.
    pub(super) fn forget(self) {
        if let Self(Some(file)) = self {
            // Without another thread it is given back here.
            let _ = std::thread::Builder::new().spawn(move || drop(file));
        }
    }
}

/// Writes all bytes at a place of a file, whatever other threads write elsewhere.
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
