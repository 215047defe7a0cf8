//! Stamps of files: what the system tells of a file without reading it, so that later writes are noticed.

use std::fs::Metadata;
use std::path::Path;
use std::time::{Duration, SystemTime};

use serde::{Deserialize, Serialize};

/// What the system tells of a file without reading it. A file that is written to gets another stamp, unless it is written twice
/// within the clock's grain.
///
/// A stamp has the size, the times of content and status, the device and the number of a file. A file with an unchanged stamp is not read
/// again if the stamp is so old that a later write would have changed it, as in git.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Stamp {
    size: u64,
    /// Nanoseconds since 1970.
    modified: u128,
    /// The change of anything about the file, which no program can set: 0 where the system does not tell it.
    changed: i128,
    /// Device and number of the file: 0 where the system does not tell it.
    place: (u64, u64),
}

/// Clocks of file systems are at most this coarse,
const GRAIN: Duration = Duration::from_secs(2);

/// and those that tell parts of a second this coarse; tests wait for it often, where it is known to be finer.
pub const FINE_GRAIN: Duration = Duration::from_millis(if cfg!(test) { 40 } else { 100 });

impl Stamp {
    pub fn of(path: &Path) -> Option<Self> {
        std::fs::metadata(path).ok().map(|metadata| Self::new(&metadata))
    }

    /// That of a file that was moved between both; none if it was written to, too.
    pub fn moved(before: &Metadata, after: &Metadata) -> Option<Self> {
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

    /// The size of the file.
    pub fn size(&self) -> u64 {
        self.size
    }

    /// Whether a write after this moment would have given another stamp.
    pub fn is_settled(&self) -> bool {
        let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        let is_fine = !self.modified.is_multiple_of(1_000_000_000);
        let grain = if is_fine { FINE_GRAIN } else { GRAIN };
        let last = i128::try_from(self.modified).unwrap_or(i128::MAX).max(self.changed);
        i128::try_from(now.saturating_sub(grain).as_nanos()).is_ok_and(|limit| last < limit)
    }
}
