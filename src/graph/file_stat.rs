//! The metadata of files, which tells whether a file has changed without reading it.

use std::fs::Metadata;
use std::path::Path;
use std::time::{Duration, SystemTime};

use serde::{Deserialize, Serialize};

/// The metadata of a file: size, times of modification and status change, device and inode number. Every write to a file changes its
/// metadata, except for a second write within the resolution of the clock.
///
/// A file with unchanged metadata is not read again. As in git, this applies only if the metadata is older than the resolution of the
/// clock, because a later write is then certain to change it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FileStat {
    size: u64,
    /// The time of the last modification, in nanoseconds since 1970.
    modified: u128,
    /// The time of the last status change, in nanoseconds since 1970. Programs cannot set this time. 0 if the system does not provide it.
    changed: i128,
    /// The device and inode number; (0, 0) if the system does not provide them.
    place: (u64, u64),
}

/// The coarsest resolution of the clocks of file systems.
const GRAIN: Duration = Duration::from_secs(2);

/// The coarsest resolution of the clocks of file systems that record fractions of a second. In tests the value is smaller, because tests
/// wait for that time often and run on finer clocks.
pub const FINE_GRAIN: Duration = Duration::from_millis(if cfg!(test) { 40 } else { 100 });

impl FileStat {
    pub fn read(path: &Path) -> Option<Self> {
        std::fs::metadata(path).ok().map(|metadata| Self::new(&metadata))
    }

    /// Returns the metadata of a file after it was moved. `None` if the file was also written to.
    pub fn after_move(before: &Metadata, after: &Metadata) -> Option<Self> {
        let (before, after) = (Self::new(before), Self::new(after));
        (Self { changed: before.changed, ..after } == before).then_some(after)
    }

    pub fn new(metadata: &Metadata) -> Self {
        let modified = metadata
            .modified()
            .ok()
            .and_then(|time: SystemTime| time.duration_since(SystemTime::UNIX_EPOCH).ok())
            .map_or(0, |since| since.as_nanos());
        #[cfg(unix)]
        let (changed, place) = {
            use std::os::unix::fs::MetadataExt;
            let changed = i128::from(metadata.ctime()) * 1_000_000_000;
            (changed + i128::from(metadata.ctime_nsec()), (metadata.dev(), metadata.ino()))
        };
        #[cfg(not(unix))]
        let (changed, place) = (0, (0, 0));
        Self { size: metadata.len(), modified, changed, place }
    }

    /// Returns the size of the file in bytes.
    pub fn size(&self) -> u64 {
        self.size
    }

    /// Returns true if every future write to the file will change the metadata.
    pub fn is_settled(&self) -> bool {
        let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        let is_fine = !self.modified.is_multiple_of(1_000_000_000);
        let grain = if is_fine { FINE_GRAIN } else { GRAIN };
        let last = i128::try_from(self.modified).unwrap_or(i128::MAX).max(self.changed);
        i128::try_from(now.saturating_sub(grain).as_nanos()).is_ok_and(|limit| last < limit)
    }
}
