//! How much the cache holds, and what goes when that is too much.

use std::fs;
use std::io::ErrorKind;
use std::path::Path;
use std::sync::atomic::Ordering;
use std::time::{Duration, SystemTime};

use super::folder::{Found, PROGRAMS, TIDIED, What, check, contents};
use super::{Disk, DiskError, FOLDERS, Store};
use crate::writing::{is_abandoned, remove, remove_empty, write_whole};

/// What the cache holds.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Usage {
    /// Results.
    pub entries: usize,
    /// Large columns of results.
    pub columns: usize,
    /// Graphs whose last evaluation is remembered.
    pub graphs: usize,
    /// Programs, or builds of one, that kept something here.
    pub programs: usize,
    /// All files together.
    pub bytes: u64,
}

impl Disk {
    /// What a cache folder holds, of all programs.
    ///
    /// # Errors
    /// If the folder is there and is not a cache of ours.
    pub fn usage(folder: &Path) -> Result<Usage, DiskError> {
        check(folder)?;
        let contents = contents(folder);
        let mut usage = Usage { programs: contents.homes.len(), ..Usage::default() };
        for found in contents.files {
            usage.bytes += found.bytes;
            match found.what {
                What::Kept("entries") => usage.entries += 1,
                What::Kept("columns") => usage.columns += 1,
                What::Kept("graphs") => usage.graphs += 1,
                _ => {}
            }
        }
        Ok(usage)
    }

    /// Drops the files that were not used for longest, until at most `limit` bytes are left, and what a killed process left
    /// half written. Gives the number of bytes that went. What is not ours stays.
    ///
    /// # Errors
    /// If the folder is there and is not a cache of ours, or files that should go cannot be removed; the others are gone then.
    pub fn gc(folder: &Path, limit: u64) -> Result<u64, DiskError> {
        check(folder)?;
        let contents = contents(folder);
        let mut files = contents.files;
        let mut bytes: u64 = files.iter().map(|found| found.bytes).sum();
        let before = bytes;
        let mut kept = None;
        files.sort_by_key(|found| std::cmp::Reverse(found.used));
        while let Some(Found { path, what, bytes: size, .. }) = files.pop() {
            let goes = match what {
                What::Temporary => is_abandoned(&path),
                _ => limit < bytes,
            };
            if !goes {
                continue;
            }
            match remove(&path) {
                Ok(()) => bytes -= size,
                // Another process was quicker.
                Err(error) if error.kind() == ErrorKind::NotFound => bytes -= size,
                Err(error) => {
                    let (count, _) = kept.get_or_insert((0, error));
                    *count += 1;
                }
            }
        }
        for home in contents.homes {
            // Those of programs that are long gone.
            FOLDERS.iter().for_each(|name| remove_empty(&home.join(name)));
            remove_empty(&home);
        }
        let folder = folder.to_owned();
        kept.map_or(Ok(before - bytes), |(count, error)| {
            Err(DiskError::Kept { folder, count, error })
        })
    }
}

impl Store {
    /// Looks after the cache's size, once in a while.
    pub(super) fn tidy(&self) {
        let written = self.written.swap(0, Ordering::Relaxed);
        let stamp = self.folder.join(PROGRAMS).join(TIDIED);
        let last = fs::metadata(&stamp).and_then(|metadata| metadata.modified()).ok();
        let age = last.and_then(|last| SystemTime::now().duration_since(last).ok());
        let due = age.is_none_or(|age| Duration::from_secs(3600) < age);
        if self.trouble.get().is_none() && 0 < written && (due || self.limit / 32 < written) {
            // First, so that other processes need not do the same.
            let _ = write_whole(&stamp, b"");
            let _ = Disk::gc(&self.folder, self.limit);
        }
    }
}
