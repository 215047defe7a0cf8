//! How much the cache holds, and what goes when that is too much.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::{Duration, SystemTime};

use super::program::is_fingerprint;
use super::{Disk, FOLDERS, Store};

/// How the names of files that are being written begin.
pub(super) const TEMPORARY: &str = ".maquette-";

/// The file that tells backup programs to leave a folder out (bford.info/cachedir), and us that it is ours.
const TAG: &str = "CACHEDIR.TAG";
const TAG_TEXT: &str =
    "Signature: 8a477f597d28d172789f06886806bc55\n# Results that maquette can compute again.\n";

/// A process that was killed may leave files behind that it was writing; whatever is older is no longer being written.
const ABANDONED: Duration = Duration::from_secs(600);

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

struct Found {
    path: PathBuf,
    used: SystemTime,
    bytes: u64,
}

/// Marks the folder as a cache.
pub(super) fn tag(folder: &Path) -> io::Result<()> {
    let path = folder.join(TAG);
    if path.exists() { Ok(()) } else { fs::write(path, TAG_TEXT) }
}

impl Disk {
    /// What a cache folder holds, of all programs.
    pub fn usage(folder: &Path) -> Usage {
        let mut usage = Usage { programs: homes(folder).len(), ..Usage::default() };
        for found in files(folder) {
            usage.bytes += found.bytes;
            match found.path.parent().and_then(Path::file_name).and_then(|name| name.to_str()) {
                Some("entries") => usage.entries += 1,
                Some("columns") => usage.columns += 1,
                Some("graphs") => usage.graphs += 1,
                _ => {}
            }
        }
        usage
    }

    /// Drops the files that were not used for longest, until at most `limit` bytes are left, and what a killed process left
    /// half written. Gives the number of bytes that went.
    pub fn gc(folder: &Path, limit: u64) -> u64 {
        let mut files = files(folder);
        let now = SystemTime::now();
        let age = |found: &Found| now.duration_since(found.used).unwrap_or_default();
        let mut bytes: u64 = files.iter().map(|found| found.bytes).sum();
        let before = bytes;
        files.sort_by_key(|found| std::cmp::Reverse(found.used));
        while let Some(found) = files.pop() {
            let goes = match is_temporary(&found.path) {
                // Somebody is writing it, or was killed.
                true => ABANDONED < age(&found),
                false => limit < bytes,
            };
            if goes && fs::remove_file(&found.path).is_ok() {
                bytes -= found.bytes;
            }
        }
        for home in homes(folder) {
            // Only empty folders can be removed: those of programs that are long gone.
            for name in FOLDERS {
                let _ = fs::remove_dir(home.join(name));
            }
            let _ = fs::remove_dir(home);
        }
        before - bytes
    }

    /// Drops everything. Gives the number of bytes that went.
    ///
    /// # Errors
    /// If the folder is there and is not a cache of ours.
    pub fn clear(folder: &Path) -> io::Result<u64> {
        if folder.exists() && !folder.join(TAG).exists() {
            let message = format!("{} is no cache of maquette: it has no {TAG}", folder.display());
            return Err(io::Error::other(message));
        }
        Ok(Self::gc(folder, 0))
    }
}

impl Store {
    /// Looks after the cache's size, once in a while.
    pub(super) fn tidy(&self) {
        let written = self.written.swap(0, Ordering::Relaxed);
        let stamp = self.folder.join("programs").join("tidied");
        let last = fs::metadata(&stamp).and_then(|metadata| metadata.modified()).ok();
        let age = last.and_then(|last| SystemTime::now().duration_since(last).ok());
        let due = age.is_none_or(|age| Duration::from_secs(3600) < age);
        if self.trouble.get().is_none() && 0 < written && (due || self.limit / 32 < written) {
            // First, so that other processes need not do the same.
            let _ = fs::write(&stamp, "");
            Disk::gc(&self.folder, self.limit);
        }
    }
}

/// The folders of programs.
fn homes(folder: &Path) -> Vec<PathBuf> {
    let name = |path: &PathBuf| {
        path.file_name().is_some_and(|name| is_fingerprint(&name.to_string_lossy()))
    };
    list(folder).filter(name).collect()
}

/// Every file that is a result.
fn files(folder: &Path) -> Vec<Found> {
    let folders = homes(folder).into_iter();
    let folders = folders.flat_map(|home| FOLDERS.map(|name| home.join(name)));
    let folders = folders.chain([folder.join("programs")]);
    let found = folders.flat_map(|folder| list(&folder)).filter_map(|path| {
        let metadata = fs::symlink_metadata(&path).ok().filter(fs::Metadata::is_file)?;
        Some(Found { used: metadata.modified().ok()?, bytes: metadata.len(), path })
    });
    found.collect()
}

fn list(folder: &Path) -> impl Iterator<Item = PathBuf> + use<> {
    fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path())
}

fn is_temporary(path: &Path) -> bool {
    path.file_name().is_some_and(|name| name.to_string_lossy().starts_with(TEMPORARY))
}
